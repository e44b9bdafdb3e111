"use strict";
/* Separation over time, links, and lists. */
Fleet.strip = function (canvas) {
  const WINDOW_S = 120, TOP = 4, LEFT = 34, RIGHT = 100, APART = 14, DASHES = [[], [7, 3], [2, 3], [9, 3, 2, 3]];
  const history = new Map();
  let now = 0, colours = ["#000"];

  /* A place that no pair shown has: its colour, and with it a dash pattern where colours run out. */
  function look() {
    const taken = new Set([...history.values()].map((track) => track.place));
    let place = 0;
    while (taken.has(place)) place++;
    return { place, colour: colours[place % colours.length], dash: DASHES[Math.floor(place / colours.length) % DASHES.length], values: [] };
  }

  /* Where labels stand: at the ends of their lines, but none on another. */
  function spread(labels, low) {
    labels.sort((a, b) => a.y - b.y);
    let free = 4;
    for (const label of labels) { label.at = Math.max(label.y, free); free = label.at + APART; }
    let last = low;
    for (const label of [...labels].reverse()) { label.at = Math.min(label.at, last); last = label.at - APART; }
  }

  function draw() {
    const { pen, w, h } = Fleet.sheet(canvas), end = w - RIGHT;
    const x = (t) => LEFT + (end - LEFT) * (1 - (now - t) / WINDOW_S), y = (v) => h - 18 - (h - 28) * Math.min(v, TOP) / TOP;
    pen.fillStyle = "#fbe9ed"; pen.fillRect(LEFT, y(1), end - LEFT, y(0) - y(1));
    pen.strokeStyle = pen.fillStyle = Fleet.GREY; pen.lineWidth = 1;
    for (let v = 0; v <= TOP; v++) { pen.globalAlpha = 0.25; Fleet.line(pen, [[LEFT, y(v)], [end, y(v)]]); pen.globalAlpha = 1; pen.fillText(String(v), LEFT - 14, y(v) + 4); }
    for (let t = Math.ceil(Math.max(0, now - WINDOW_S) / 30) * 30; t <= now; t += 30) pen.fillText(`${t} s`, x(t) - 8, h - 4);
    const labels = [];
    for (const [name, { colour, dash, values }] of history) {
      const [t, v] = values[values.length - 1];
      pen.strokeStyle = colour; pen.setLineDash(dash); pen.lineWidth = v < 1 ? 2.6 : 1.6;
      Fleet.line(pen, values.map(([when, value]) => [x(when), y(value)]));
      labels.push({ text: `${name}  ${v > TOP ? `> ${TOP}` : v.toFixed(2)}`, colour, lost: v < 1, x: x(t), y: y(v) });
    }
    pen.setLineDash([]); pen.lineWidth = 0.7;
    spread(labels, h - 20);
    const font = pen.font;
    for (const label of labels) {
      pen.strokeStyle = pen.fillStyle = label.colour; pen.font = label.lost ? `bold ${font}` : font;
      Fleet.line(pen, [[label.x, label.y], [end + 8, label.at]]);
      pen.fillText(label.text, end + 11, label.at + 4);
    }
    pen.font = font;
  }

  return {
    clear() { history.clear(); },
    note(moment, about) {
      now = moment.t_s;
      colours = about.pair_colours;
      for (const [name, track] of history) {
        track.values = track.values.filter(([t]) => t >= now - WINDOW_S);
        if (!track.values.length || track.values[track.values.length - 1][0] < now - 5) history.delete(name);
      }
      for (const p of moment.pairs) {
        const name = `${p.a}–${p.b}`;
        if (!history.has(name)) history.set(name, look());
        const values = history.get(name).values;
        if (!values.length || values[values.length - 1][0] < now) values.push([now, p.apart]); // not while it is paused
      }
    },
    show: draw,
    redraw: draw,
  };
};

Fleet.matrix = function (canvas) {
  let shown = null, about = null;

  function shade(lost) { // cividis, from blue (nothing lost) to yellow (all)
    const ends = [[0, 34, 78], [124, 123, 120], [254, 232, 56]], at = Math.min(1, lost) * 2, k = Math.min(1, Math.floor(at)), f = at - k;
    return `rgb(${[0, 1, 2].map((c) => Math.round(ends[k][c] + f * (ends[k + 1][c] - ends[k][c]))).join(",")})`;
  }

  function draw() {
    if (!shown) return;
    const { pen, w, h } = Fleet.sheet(canvas), names = about.processes, n = names.length;
    const size = Math.min((w - 40) / n, (h - 24) / n, 44), at = new Map(names.map((p, k) => [p, k]));
    const label = (p) => (p === 0 ? "C" : String(p));
    pen.fillStyle = Fleet.GREY;
    names.forEach((p, k) => { if (size > 11) { pen.fillText(label(p), 30 + size * (k + 0.35), 14); pen.fillText(label(p), 8, 22 + size * (k + 0.65)); } });
    pen.fillStyle = "#edf0f3"; pen.fillRect(28, 18, size * n, size * n);
    for (const [src, dst, lost, latency] of shown.links) {
      const x = 28 + size * at.get(dst), y = 18 + size * at.get(src);
      pen.fillStyle = shade(lost); pen.fillRect(x + 0.5, y + 0.5, size - 1, size - 1);
      if (size > 20) { pen.fillStyle = lost > 0.6 ? "#22272e" : "#fff"; pen.fillText(lost < 1 ? latency.toFixed(1) : "–", x + size / 2 - 9, y + size / 2 + 4); }
    }
  }

  return { show(view, what) { shown = view; about = what; draw(); }, redraw: draw };
};

/* Lists: of groups, of what is said, and of rules with a button to end each. */
Fleet.lists = function (groups, events, rules, end) {
  const item = (text, kind) => { const li = document.createElement("li"); li.textContent = text; if (kind) li.className = kind; return li; };
  const elector = (g) => (g.elector === g.computing ? "itself" : g.elector === 0 ? "the coordinator" : `UAV ${g.elector}`);
  let newest = -1;
  return {
    show(view, about) {
      groups.replaceChildren(...view.groups.map((g) => item(
        `term ${g.term}: UAV ${g.computing} computes for ${g.members.join(", ")}${g.rivals ? `, elected by ${elector(g)}` : ""}`,
        g.rivals ? "rival" : g.fresh ? "" : "old")));
      const last = view.events.length ? view.events[view.events.length - 1].n : 0;
      if (last !== newest) {
        newest = last;
        events.replaceChildren(...view.events.slice().reverse().map((e) => {
          const li = item("", e.kind), time = document.createElement("time");
          time.textContent = `${e.t_s.toFixed(1)} s`;
          li.append(time, e.text);
          return li;
        }));
      }
      const told = JSON.stringify(view.rules);
      if (rules.dataset.told === told) return;
      rules.dataset.told = told;
      rules.replaceChildren(...view.rules.map((r) => {
        const li = item(`${r.text} `, r.on ? "" : "later");
        if (Fleet.canChange(about)) {
          const button = document.createElement("button");
          button.textContent = "End"; button.addEventListener("click", () => end(r.n));
          li.append(button);
        }
        return li;
      }));
      if (!view.rules.length) rules.append(item("none in force", "later"));
    },
  };
};
