"use strict";
/* Separation over time, links, and lists. */
Fleet.strip = function (canvas) {
  const WINDOW_S = 120, TOP = 4, LEFT = 34;
  const history = new Map();
  let now = 0;

  function draw() {
    const { pen, w, h } = Fleet.sheet(canvas);
    const x = (t) => LEFT + (w - LEFT - 90) * (1 - (now - t) / WINDOW_S), y = (v) => h - 18 - (h - 28) * Math.min(v, TOP) / TOP;
    pen.fillStyle = "#fbe9ed"; pen.fillRect(LEFT, y(1), w - LEFT - 90, y(0) - y(1));
    pen.strokeStyle = pen.fillStyle = Fleet.GREY; pen.lineWidth = 1;
    for (let v = 0; v <= TOP; v++) { pen.globalAlpha = 0.25; Fleet.line(pen, [[LEFT, y(v)], [w - 90, y(v)]]); pen.globalAlpha = 1; pen.fillText(String(v), LEFT - 14, y(v) + 4); }
    for (let t = Math.ceil(Math.max(0, now - WINDOW_S) / 30) * 30; t <= now; t += 30) pen.fillText(`${t} s`, x(t) - 8, h - 4);
    let last = [];
    for (const [name, track] of history) {
      const least = track.values[track.values.length - 1][1];
      pen.strokeStyle = least < 1 ? Fleet.ALERT : track.colour; pen.lineWidth = 1.6;
      Fleet.line(pen, track.values.map(([t, v]) => [x(t), y(v)]));
      last.push([name, least]);
    }
    last = last.sort((a, b) => a[1] - b[1]).slice(0, 8);
    last.forEach(([name, v], n) => { pen.fillStyle = v < 1 ? Fleet.ALERT : "#22272e"; pen.fillText(`${name}  ${v.toFixed(2)}`, w - 84, 14 + 15 * n); });
  }

  return {
    show(view, about) {
      if (view.t_s < now) history.clear();
      now = view.t_s;
      const colours = new Map(about.uavs.map((u) => [u.id, u.colour]));
      for (const p of view.pairs) {
        const name = `${p.a}–${p.b}`;
        if (!history.has(name)) history.set(name, { colour: colours.get(p.a), values: [] });
        const values = history.get(name).values;
        if (!values.length || values[values.length - 1][0] < now) values.push([now, p.apart]); // not while it is paused
      }
      for (const [name, track] of history) {
        track.values = track.values.filter(([t]) => t >= now - WINDOW_S);
        if (!track.values.length || track.values[track.values.length - 1][0] < now - 5) history.delete(name);
      }
      draw();
    },
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
        if (!about.recorded && !about.read_only) {
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
