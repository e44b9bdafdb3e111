"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const study = data.study;
  const CONFIG = {
    responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"],
    showSendToCloud: false, plotlyServerURL: "", // nothing leaves the reader's machine
  };
  const INK = "#22272e", GREY = "#6b7480", ALERT = "#b3123a";
  const DASHES = ["solid", "dash", "dashdot", "longdash"];
  const SYMBOLS = ["circle", "square", "diamond", "triangle-up", "triangle-down", "pentagon", "star"];
  const PRINT_PX = 680; // the width of charts on paper
  const drawn = {};

  const unpack = ({ bdata }) =>
    Array.from(new Float32Array(Uint8Array.from(atob(bdata), (c) => c.charCodeAt(0)).buffer));
  const faint = (hex, opacity) =>
    `rgba(${[1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)).join(",")},${opacity})`;
  const colour = (n) => study.colours[n % study.colours.length];
  const dash = (n) => DASHES[Math.floor(n / study.colours.length) % DASHES.length];

  // Text as it is, since Plotly takes some of it for HTML; labels in lines that fit beside each other.
  const plainText = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  function inLines(label, letters) {
    const lines = [], pieces = new RegExp(`.{1,${letters}}`, "gu"); // of words that are longer than a line
    for (const word of label.split(" ").flatMap((w) => (letters < 8 ? w : w.match(pieces) || w))) {
      const last = lines[lines.length - 1];
      if (last !== undefined && last.length + 1 + word.length <= letters) lines[lines.length - 1] = `${last} ${word}`;
      else lines.push(word);
    }
    return lines;
  }
  function besideEachOther(labels, width) {
    const letters = Math.max(4, Math.floor(width / labels.length / 7.5));
    const broken = labels.map((label) => inLines(label, letters));
    const fits = broken.every((lines) => lines.every((text) => text.length <= letters));
    return {
      tickmode: "array", tickvals: labels.map((_, n) => n), tickangle: fits ? 0 : undefined,
      ticktext: fits ? broken.map((lines) => lines.map(plainText).join("<br>")) : labels.map(plainText),
      more: fits ? 17 * (Math.max(...broken.map((lines) => lines.length)) - 1) : 0,
    };
  }

  // What is chosen: an outcome, factors in the roles of a chart, levels of all others.

  function select(box, words, labels, chosen, change) {
    const label = document.createElement("label"), picker = document.createElement("select");
    labels.forEach((text, n) => picker.add(new Option(text, n, n === chosen, n === chosen)));
    picker.addEventListener("change", () => change(Number(picker.value)));
    label.append(`${words} `, picker);
    box.append(label);
  }

  function pickers(chart, choice) {
    const box = document.getElementById(`${chart.id}-pickers`);
    const again = () => { pickers(chart, choice); redraw(chart.id); };
    const factors = study.factors, roles = Object.keys(choice.roles);
    box.replaceChildren();
    if (choice.outcome !== undefined) {
      select(box, "", study.outcomes.map((o) => o.title), choice.outcome, (n) => { choice.outcome = n; again(); });
    }
    if (factors.length > choice.few) {
      for (const role of roles) {
        select(box, role, factors.map((f) => f.name), choice.roles[role], (n) => {
          const other = roles.find((r) => choice.roles[r] === n);
          if (other) choice.roles[other] = choice.roles[role];
          choice.roles[role] = n;
          again();
        });
      }
    }
    factors.forEach((factor, f) => {
      if (study.grid && !roles.some((r) => choice.roles[r] === f) && factor.labels.length > 1) {
        select(box, factor.name, factor.labels, choice.at[f], (n) => { choice.at[f] = n; again(); });
      }
    });
  }

  // The cell with these levels in place of those chosen.
  function cellAt(choice, levels) {
    const at = choice.at.slice();
    for (const [f, n] of levels) if (f !== undefined) at[f] = n;
    return study.cells.findIndex((cell) => cell.at.every((n, f) => n === at[f]));
  }

  const levelsOf = (f) => (f === undefined ? [""] : study.factors[f].labels);

  // Heat maps.

  function drawMaps(chart, choice, width) {
    const { across, up } = choice.roles, outcome = study.outcomes[choice.outcome];
    const columns = levelsOf(across), rows = levelsOf(up);
    const roomy = (width - 150) / columns.length > 76, alone = outcome.without && !outcome.same_without;
    const text = (n) => {
      if (n < 0 || outcome.value[n] === null) return "no run";
      const value = `<b>${outcome.text[n]}</b>`;
      if (!roomy) return value;
      return `${value}<br><span style='font-size:11px'>${outcome.interval[n]}${alone ? `<br>without ${outcome.without.text[n]}` : ""}</span>`;
    };
    const hover = (n) => {
      if (n < 0 || outcome.value[n] === null) return "no run was flown";
      const cell = study.cells[n];
      return `cell ${plainText(cell.name)}<br>${cell.runs} runs<br>${outcome.text[n]} (${outcome.interval[n]})` +
        (outcome.without ? `<br>without avoidance ${outcome.without.text[n]} (${outcome.without.interval[n]})` : "");
    };
    const places = rows.map((_, r) => columns.map((__, c) => cellAt(choice, [[across, c], [up, r]])));
    const [zmin, zmax] = outcome.bounds;
    const steps = study.ramp.map((hex, n) => [n / (study.ramp.length - 1), hex]);
    const scale = outcome.low_is_bad ? steps.map(([x], n) => [x, steps[steps.length - 1 - n][1]]) : steps;
    const x = columns.map((_, c) => c), y = rows.map((_, r) => r);
    const ink = (n) => {
      const share = (outcome.value[n] - zmin) / (zmax - zmin);
      return (outcome.low_is_bad ? 1 - share : share) > 0.45 ? "#ffffff" : INK;
    };
    const annotations = places.flatMap((row, r) => row.map((n, c) => ({
      x: c, y: r, text: text(n), showarrow: false,
      font: { size: roomy ? 13 : 12, color: n < 0 || outcome.value[n] === null ? GREY : ink(n) },
    })));
    const trace = {
      type: "heatmap", x, y, z: places.map((row) => row.map((n) => (n < 0 ? null : outcome.value[n]))),
      customdata: places.map((row) => row.map(hover)), hovertemplate: "%{customdata}<extra></extra>",
      hoverongaps: false, colorscale: scale, zmin, zmax, xgap: 2, ygap: 2,
      colorbar: { thickness: 12, outlinewidth: 0, ticksuffix: outcome.unit === "%" ? " %" : "", tickfont: { size: 11 } },
    };
    const beside = besideEachOther(columns, width - 150);
    const above = { tickmode: "array", tickvals: y, ticktext: rows.map((label) => inLines(label, 18).map(plainText).join("<br>")) };
    const ticks = ({ tickmode, tickvals, ticktext, tickangle }, title) => ({
      title: { text: title, standoff: 8 }, tickmode, tickvals, ticktext, tickangle,
      showgrid: false, zeroline: false, ticks: "", automargin: true, fixedrange: true, showticklabels: title !== "",
    });
    note(chart, outcome.same_without && `Without avoidance, in all cells: ${outcome.same_without}`);
    const height = Math.max(240, 120 + 78 * rows.length) + beside.more;
    return [[trace], {
      ...chart.layout, height, annotations,
      xaxis: ticks(beside, study.factors[across].name),
      yaxis: ticks(above, up === undefined ? "" : study.factors[up].name),
    }];
  }

  // Curves with bands, or points with intervals where levels are no numbers.

  function series(choice, x, outcome, level, lines) {
    const labels = levelsOf(x), numbers = study.factors[x].numbers;
    const places = labels.map((_, n) => cellAt(choice, [[x, n], [lines, level]]));
    const points = places.map((n, k) => ({ n, x: numbers ? numbers[k] : k }))
      .filter(({ n }) => n >= 0 && outcome.value[n] !== null);
    if (numbers) points.sort((a, b) => a.x - b.x);
    return points;
  }

  function drawCurves(chart, choice, width) {
    const { along, lines } = choice.roles, outcome = study.outcomes[choice.outcome];
    const factor = study.factors[along], named = levelsOf(lines), numeric = factor.numbers;
    const traces = [], count = named.length;
    named.forEach((label, k) => {
      const points = series(choice, along, outcome, k, lines);
      const x = points.map((p) => p.x + (numeric ? 0 : (k - (count - 1) / 2) * Math.min(0.16, 0.6 / count)));
      const of = (column) => points.map((p) => column[p.n]);
      const name = lines === undefined ? "with avoidance" : `${study.factors[lines].name} ${plainText(label)}`;
      const hover = points.map(({ n }) => `cell ${plainText(study.cells[n].name)}<br>${outcome.text[n]} (${outcome.interval[n]})`);
      const value = of(outcome.value), low = of(outcome.low), high = of(outcome.high), look = colour(k);
      if (numeric) {
        const edge = { type: "scatter", mode: "lines", x, line: { width: 0 }, hoverinfo: "skip", showlegend: false, legendgroup: name };
        traces.push({ ...edge, y: low.map((v, n) => v ?? value[n]) });
        traces.push({ ...edge, y: high.map((v, n) => v ?? value[n]), fill: "tonexty", fillcolor: faint(look, 0.16) });
      }
      traces.push({
        type: "scatter", cliponaxis: false, mode: numeric ? "lines+markers" : "markers", name, legendgroup: name, x, y: value,
        line: { color: look, width: 2.2, dash: dash(k) }, marker: { color: look, size: 8, symbol: SYMBOLS[k % SYMBOLS.length] },
        text: hover, hovertemplate: "%{text}<extra></extra>",
        error_y: numeric ? undefined : {
          type: "data", symmetric: false, color: look, thickness: 1.5,
          array: value.map((v, n) => (high[n] ?? v) - v), arrayminus: value.map((v, n) => v - (low[n] ?? v)),
        },
      });
      if (outcome.without && (k === count - 1 || !outcome.same_without)) traces.push(withoutCurve(points, x, outcome, k, name, numeric));
    });
    const { more, ...places } = besideEachOther(factor.labels, width - 84);
    const ticks = numeric ? {} : { ...places, range: [-0.5, factor.labels.length - 0.5] };
    note(chart, "");
    return [traces, {
      ...chart.layout, ...legendRoom(chart, traces, numeric ? 0 : more),
      xaxis: { ...axis(factor.title), ...ticks },
      yaxis: { ...axis(outcome.label), rangemode: outcome.unit === "%" ? "tozero" : "normal" },
    }];
  }

  function withoutCurve(points, x, outcome, k, name, numeric) {
    const same = outcome.same_without;
    return {
      type: "scatter", mode: numeric ? "lines+markers" : "markers", x: same ? points.map((p) => p.x) : x,
      y: points.map(({ n }) => outcome.without.value[n]),
      name: same ? "without avoidance" : `${name}, without`, legendgroup: same ? "without" : name,
      line: { color: same ? GREY : colour(k), width: 1.8, dash: "dot" },
      marker: { color: same ? GREY : colour(k), size: 6, symbol: "x-thin", line: { width: 1.5, color: same ? GREY : colour(k) } },
      text: points.map(({ n }) => `without avoidance<br>${outcome.without.text[n]} (${outcome.without.interval[n]})`),
      hovertemplate: "%{text}<extra></extra>",
    };
  }

  // Points of a design that was drawn, against each factor.

  function drawPoints(chart, choice, width) {
    const outcome = study.outcomes[choice.outcome], count = study.factors.length;
    const across = Math.max(1, Math.min(count, 3, Math.floor(width / 330))), down = Math.ceil(count / across);
    const layout = { ...chart.layout, height: 90 + 290 * down, grid: { rows: down, columns: across, pattern: "independent", xgap: 0.16, ygap: 0.24 }, showlegend: false };
    const cells = study.cells.map((cell, n) => ({ cell, n })).filter(({ n }) => outcome.value[n] !== null);
    const few = cells.length <= study.most_bars;
    const traces = study.factors.map((factor, f) => {
      const row = f === 0 ? "" : f + 1;
      layout[`xaxis${row}`] = axis(factor.title);
      layout[`yaxis${row}`] = { ...axis(f % across ? "" : outcome.label), rangemode: outcome.unit === "%" ? "tozero" : "normal" };
      const value = cells.map(({ n }) => outcome.value[n]);
      const reach = (column, sign) => cells.map(({ n }) => (column[n] === null ? 0 : sign * (column[n] - outcome.value[n])));
      return {
        type: few ? "scatter" : "scattergl", mode: "markers", xaxis: `x${row}`, yaxis: `y${row}`,
        x: cells.map(({ cell }) => cell.numbers[f]), y: value,
        marker: { color: colour(0), size: few ? 7 : 4, opacity: few ? 0.9 : 0.5 },
        error_y: few ? { type: "data", symmetric: false, array: reach(outcome.high, 1), arrayminus: reach(outcome.low, -1), color: faint(colour(0), 0.35), thickness: 1, width: 0 } : undefined,
        text: cells.map(({ cell, n }) => `cell ${plainText(cell.name)}<br>${outcome.text[n]} (${outcome.interval[n]})`),
        hovertemplate: "%{text}<extra></extra>",
      };
    });
    note(chart, outcome.same_without && `Without avoidance, in all cells: ${outcome.same_without}`);
    return [traces, layout];
  }

  // Survival of the least separation.

  function survivalTraces(packed, name, look, dashed, k) {
    const curve = Object.fromEntries(Object.entries(packed).map(([column, values]) => [column, unpack(values)]));
    const percent = (values) => values.map((v) => 100 * v);
    const edge = { type: "scatter", mode: "lines", x: curve.at, hoverinfo: "skip", showlegend: false, legendgroup: name };
    const line = {
      ...edge, y: percent(curve.share), name, showlegend: true, hoverinfo: undefined,
      line: { shape: "vh", color: look, width: dashed ? 1.8 : 2.2, dash: dashed ? "dot" : dash(k) },
      hovertemplate: `${name}<br>%{y:.1f} % of runs keep %{x:.3f} or more<extra></extra>`,
    };
    if (dashed) return [line];
    const none = { shape: "vh", width: 0 };
    return [
      { ...edge, y: percent(curve.low), line: none },
      { ...edge, y: percent(curve.high), line: none, fill: "tonexty", fillcolor: faint(look, 0.13) },
      line,
    ];
  }

  function drawSurvival(chart, choice) {
    const { curves, without, same_without: same, chosen, end } = study.survival;
    const { lines } = choice.roles;
    const listed = chosen.length
      ? chosen.map((n) => [n, `cell ${plainText(study.cells[n].name)}`])
      : levelsOf(lines).map((label, k) => [cellAt(choice, [[lines, k]]), lines === undefined ? "with avoidance" : `${study.factors[lines].name} ${plainText(label)}`]);
    const traces = [];
    listed.forEach(([n, name], k) => {
      if (curves[n]) traces.push(...survivalTraces(curves[n], name, colour(k), false, k));
      if (!same && without[n]) traces.push(...survivalTraces(without[n], `${name}, without`, colour(k), true, k));
    });
    if (same) traces.push(...survivalTraces(Object.values(without)[0], "without avoidance", GREY, true, 0));
    note(chart, chosen.length && chosen.length < study.cells.length && `${chosen.length} of ${study.cells.length} cells, from the least to the greatest probability of a loss.`);
    return [traces, {
      ...chart.layout, ...legendRoom(chart, traces),
      xaxis: { ...axis("Least separation of a run / required"), range: [0, end] },
      yaxis: { ...axis("Runs that keep at least that (%)"), range: [0, 101] },
      shapes: [{ type: "line", x0: 1, x1: 1, yref: "y domain", y0: 0, y1: 1, line: { color: ALERT, width: 1.6, dash: "dash" } }],
      annotations: [{ x: 1, y: 0.02, yref: "y domain", text: "required", showarrow: false, xanchor: "left", xshift: 4, yanchor: "bottom", font: { color: ALERT, size: 12 } }],
    }];
  }

  // Charts.

  function axis(title) {
    return {
      title: { text: title, standoff: 8, font: { size: 13 } }, gridcolor: "#e8ebef", zeroline: false,
      linecolor: "#c3c9d1", showline: true, ticks: "outside", tickcolor: "#c3c9d1", ticklen: 4, automargin: true,
    };
  }

  // Room for the rows of a legend above the chart.
  function legendRoom(chart, traces, more = 0) {
    const width = widthOf(chart), names = traces.filter((t) => t.showlegend !== false && t.name).map((t) => t.name);
    const each = 56 + 7.2 * Math.max(4, ...names.map((n) => n.length));
    const rows = Math.ceil(names.length / Math.max(1, Math.floor((width - 84) / each)));
    return { height: chart.layout.height + 20 * Math.max(0, rows - 1) + more, margin: { ...chart.layout.margin, t: 32 + 20 * rows } };
  }

  let printing = false;
  const place = (chart) => document.getElementById(`plot-${chart.id}`);
  const widthOf = (chart) => (printing ? PRINT_PX : place(chart).clientWidth || 600);
  function note(chart, text) { document.getElementById(`${chart.id}-note`).textContent = text || ""; }

  function plain(chart, choice) {
    const content = chart.choices.length ? chart.choices[choice.content] : chart;
    note(chart, content.note);
    return [content.traces, { ...chart.layout, ...content.layout }];
  }

  const DRAW = { maps: drawMaps, curves: drawCurves, points: drawPoints, survival: drawSurvival, "": plain };

  function redraw(id) {
    const { chart, choice } = drawn[id];
    const [traces, layout] = DRAW[chart.live](chart, choice, widthOf(chart));
    const size = printing ? { width: PRINT_PX, autosize: false } : { autosize: true };
    return Plotly.react(place(chart), traces, { ...layout, ...size }, { ...CONFIG, responsive: !printing });
  }

  function choiceOf(chart) {
    const varied = study.factors.map((f, n) => n).filter((n) => study.factors[n].labels.length > 1);
    const order = [...varied, ...study.factors.map((f, n) => n).filter((n) => !varied.includes(n))];
    const numeric = order.filter((n) => study.factors[n].numbers);
    const at = study.factors.map(() => 0);
    if (chart.live === "maps") return { outcome: 0, at, few: 2, roles: rolesOf({ across: order[0], up: order[1] }) };
    if (chart.live === "curves") {
      const along = numeric.length ? numeric[0] : order[0];
      return { outcome: 0, at, few: 1, roles: rolesOf({ along, lines: order.find((n) => n !== along) }) };
    }
    if (chart.live === "points") return { outcome: 0, at, few: Infinity, roles: {} };
    if (study.survival.chosen.length) return { at, few: Infinity, roles: {} };
    return { at, few: 1, roles: rolesOf({ lines: order[0] }) };
  }
  const rolesOf = (roles) => Object.fromEntries(Object.entries(roles).filter(([, f]) => f !== undefined));

  async function begin(chart) {
    if (chart.live) {
      drawn[chart.id] = { chart, choice: choiceOf(chart) };
      if (!study.survival.chosen.length || chart.live !== "survival") pickers(chart, drawn[chart.id].choice);
    } else {
      drawn[chart.id] = { chart, choice: { content: 0 } };
      const picker = document.getElementById(`${chart.id}-pick`);
      if (picker) picker.addEventListener("change", () => { drawn[chart.id].choice.content = Number(picker.value); redraw(chart.id); });
    }
    await redraw(chart.id);
  }

  let asked = 0;
  window.addEventListener("resize", () => {
    clearTimeout(asked);
    asked = setTimeout(() => { if (!printing) Object.keys(drawn).forEach(redraw); }, 150);
  });
  window.addEventListener("beforeprint", () => { printing = true; Object.keys(drawn).forEach(redraw); });
  window.addEventListener("afterprint", () => { printing = false; Object.keys(drawn).forEach(redraw); });

  (async () => {
    for (const chart of data.charts) await begin(chart);
    document.documentElement.dataset.ready = "yes";
  })();
})();
