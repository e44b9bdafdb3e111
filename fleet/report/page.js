"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const ARRAYS = { f4: Float32Array, u1: Uint8Array, i2: Int16Array, i4: Int32Array };
  const CONFIG = {
    responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"],
    showSendToCloud: false, plotlyServerURL: "", // nothing leaves the reader's machine
  };
  const ALERT = "#b3123a";
  const RIM = 20; // corners of a zone drawn in space
  const MOST = 4000; // messages drawn at once
  const unpack = (column) =>
    new ARRAYS[column.dtype](Uint8Array.from(atob(column.bdata), (c) => c.charCodeAt(0)).buffer);
  const plots = {};
  let now = data.first_s;

  // Where everybody is. A gap in the times, or NaN, is an absence.

  const uavs = data.moving.uavs.map((u) => ({
    id: u.id, colour: u.colour, t: unpack(u.t), n: unpack(u.n), e: unpack(u.e), u: unpack(u.u),
  }));

  function before(times, t) {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle + 1; else high = middle;
    }
    return low - 1;
  }

  function place(uav, t) {
    const k = Math.min(before(uav.t, t + 1e-4), uav.t.length - 2);
    if (uav.t.length < 2 || k < 0) return null;
    const share = Math.min(1, Math.max(0, (t - uav.t[k]) / (uav.t[k + 1] - uav.t[k])));
    const between = (column) => column[k] + (share ? share * (column[k + 1] - column[k]) : 0);
    const at = { n: between(uav.n), e: between(uav.e), u: between(uav.u) };
    return Number.isFinite(at.n) ? at : null;
  }

  function lost(places) {
    const found = new Set();
    places.forEach((a, i) => places.forEach((b, j) => {
      const height = uavs[i].half_height_m + uavs[j].half_height_m;
      if (!a || !b || i >= j || Math.abs(a.u - b.u) >= height) return;
      const reach = uavs[i].radius_m + uavs[j].radius_m;
      if (Math.hypot(a.n - b.n, a.e - b.e) < reach) found.add(i).add(j);
    }));
    return found;
  }

  // What moves with time.

  const visible = (gd) => {
    const box = gd.getBoundingClientRect();
    return box.bottom > -200 && box.top < window.innerHeight + 200;
  };

  function movePlan(gd, places, bad) {
    const shapes = places.flatMap((p, i) => !p ? [] : [{
      type: "circle", xref: "x", yref: "y", x0: p.e - uavs[i].radius_m, x1: p.e + uavs[i].radius_m,
      y0: p.n - uavs[i].radius_m, y1: p.n + uavs[i].radius_m,
      fillcolor: bad.has(i) ? ALERT : uavs[i].colour, opacity: 0.28, layer: "below",
      line: { color: bad.has(i) ? ALERT : uavs[i].colour, width: 1.5 },
    }]);
    const last = gd.data.length - 1;
    Plotly.update(gd, { x: [places.map((p) => p && p.e)], y: [places.map((p) => p && p.n)] }, { shapes }, [last]);
  }

  function cylinders(places) {
    const x = [], y = [], z = [];
    places.forEach((p, i) => {
      const r = uavs[i].radius_m, h = uavs[i].half_height_m;
      const at = p || { n: NaN, e: NaN, u: NaN };
      for (const side of [-h, h]) {
        for (let k = 0; k < RIM; k++) {
          const angle = (2 * Math.PI * k) / RIM;
          x.push(at.e + r * Math.cos(angle)); y.push(at.n + r * Math.sin(angle)); z.push(at.u + side);
        }
        x.push(at.e); y.push(at.n); z.push(at.u + side);
      }
    });
    return { x, y, z };
  }

  function faces() {
    const i = [], j = [], k = [], owner = [];
    const ring = RIM + 1;
    uavs.forEach((_, n) => {
      const low = 2 * ring * n, high = low + ring;
      for (let a = 0; a < RIM; a++) {
        const b = (a + 1) % RIM;
        i.push(low + a, low + b, low + RIM, high + RIM);
        j.push(low + b, high + b, low + a, high + a);
        k.push(high + a, high + a, low + b, high + b);
        owner.push(n, n, n, n);
      }
    });
    return { i, j, k, owner };
  }
  const mesh = faces();

  function moveScene(gd, places, bad) {
    const zones = cylinders(places);
    const colours = mesh.owner.map((n) => (bad.has(n) ? ALERT : uavs[n].colour));
    const last = gd.data.length - 1;
    Plotly.restyle(gd, {
      x: [zones.x, places.map((p) => p && p.e)],
      y: [zones.y, places.map((p) => p && p.n)],
      z: [zones.z, places.map((p) => p && p.u)],
      facecolor: [colours, null],
    }, [last - 1, last]);
  }

  // Messages around a moment.

  const said = data.messages;
  const columns = {};
  for (const name of ["src", "dst", "kind", "fate", "sent_s", "got_s"]) columns[name] = unpack(said[name]);
  const slowest = columns.got_s.reduce((most, got, n) => Math.max(most, got - columns.sent_s[n] || 0), 0);

  function window_s() { return Number(document.getElementById("messages-window").value); }

  function messageTraces(t, half) {
    const traces = said.kinds.map((k) => ({
      type: "scatter", mode: "lines+markers", name: k.kind, uid: k.kind, x: [null], y: [null], text: [""],
      line: { color: k.colour, width: k.kind === "adsb" ? 1 : 1.8 },
      marker: { symbol: ["circle"], angleref: "previous", size: [0], color: [k.colour], line: { width: 0 }, opacity: 1 },
      hovertemplate: "%{text}<extra></extra>",
      visible: k.kind === "adsb" && said.processes.length > 6 ? "legendonly" : true,
    }));
    let drawn = 0;
    for (let n = before(columns.sent_s, t - half - slowest); n < columns.sent_s.length && drawn < MOST; n++) {
      if (n < 0) continue;
      const sent = columns.sent_s[n], came = Number.isFinite(columns.got_s[n]);
      if (sent > t + half) break;
      if ((came ? columns.got_s[n] : sent) < t - half) continue;
      drawn++;
      const trace = traces[columns.kind[n]], from = columns.src[n], to = columns.dst[n];
      const x = came ? columns.got_s[n] : sent + 0.03 * half;
      const y = came ? to : from + 0.3 * (to - from);
      const text = `${said.kinds[columns.kind[n]].kind}: ${said.processes[from]} to ${said.processes[to]}<br>` +
        `sent ${sent.toFixed(2)} s, ` +
        (came ? `came ${x.toFixed(2)} s (${said.fates[columns.fate[n]]})` : `lost: ${said.fates[columns.fate[n]]}`);
      trace.x.push(sent, x, null); trace.y.push(from, y, null); trace.text.push(text, text, "");
      const colour = came ? said.kinds[columns.kind[n]].colour : ALERT;
      trace.marker.symbol.push("circle", came ? "arrow" : "x-thin-open", "circle");
      trace.marker.size.push(0, came ? 8 : 6, 0);
      trace.marker.color.push(colour, colour, colour);
    }
    return traces;
  }

  function moveMessages(gd, force) {
    const half = window_s();
    const layout = gd.layout;
    layout.xaxis.range = [now - half, now + half];
    layout.xaxis.autorange = false;
    const gone = said.absent.filter(([, start, end]) => end > now - half && start < now + half);
    layout.shapes = gone.map(([at, start, end]) => ({
      type: "rect", x0: start, x1: end, y0: at - 0.3, y1: at + 0.3, fillcolor: "#22272e", opacity: 0.18, line: { width: 0 },
    }));
    layout.shapes.push({ type: "line", x0: now, x1: now, yref: "y domain", y0: 0, y1: 1, line: { color: "#22272e", width: 1.5 }, opacity: 0.55 });
    Plotly.react(gd, messageTraces(now, half), layout, CONFIG);
  }

  function moveCursor(gd) {
    const full = gd._fullLayout;
    if (!full || !full.xaxis || !full._size) return;
    const x = full.xaxis._offset + full.xaxis.l2p(now), size = full._size;
    const inside = x >= size.l - 1 && x <= size.l + size.w + 1;
    Object.assign(gd.cursor.style, {
      left: `${x}px`, top: `${size.t}px`, height: `${size.h}px`, display: inside ? "block" : "none",
    });
  }

  let asked = false;
  function redraw() {
    asked = false;
    const places = uavs.map((u) => place(u, now));
    const bad = lost(places);
    for (const { gd, chart } of Object.values(plots)) {
      if (chart.live === "cursor") moveCursor(gd);
      else if (!visible(gd)) gd.stale = true;
      else refresh(gd, chart, places, bad);
    }
  }

  function refresh(gd, chart, places, bad) {
    gd.stale = false;
    if (chart.live === "plan") movePlan(gd, places, bad);
    if (chart.live === "scene") moveScene(gd, places, bad);
    if (chart.live === "messages") moveMessages(gd);
  }

  function setTime(t) {
    now = Math.min(data.moving.end_s, Math.max(0, t));
    slider.value = now;
    shown.textContent = `${now.toFixed(1)} s`;
    if (!asked) { asked = true; requestAnimationFrame(redraw); }
  }

  // Controls.

  const slider = document.getElementById("time"), shown = document.getElementById("time-shown");
  const play = document.getElementById("play"), speed = document.getElementById("speed");
  let playing = false, stamp = 0;
  slider.addEventListener("input", () => setTime(Number(slider.value)));
  play.addEventListener("click", () => {
    playing = !playing;
    play.textContent = playing ? "Pause" : "Play";
    if (playing && now >= data.moving.end_s) setTime(0);
    stamp = performance.now();
    if (playing) requestAnimationFrame(advance);
  });
  function advance(at) {
    if (!playing) return;
    const passed_s = Math.min(0.25, Math.max(0, at - stamp) / 1000); // never skip much
    setTime(now + passed_s * Number(speed.value));
    stamp = at;
    if (now >= data.moving.end_s) play.click(); else requestAnimationFrame(advance);
  }
  for (const row of document.querySelectorAll("[data-t]")) {
    row.addEventListener("click", () => setTime(Number(row.dataset.t)));
  }
  const windowPicker = document.getElementById("messages-window");
  if (windowPicker) windowPicker.addEventListener("change", () => moveMessages(plots.messages.gd));
  window.addEventListener("scroll", () => {
    if (Object.values(plots).some(({ gd }) => gd.stale && visible(gd))) setTime(now);
  }, { passive: true });

  // Charts.

  function followClicks(gd) {
    let down = null;
    gd.addEventListener("mousedown", (e) => { down = [e.clientX, e.clientY]; }, true);
    window.addEventListener("mouseup", (e) => {
      if (!down || Math.hypot(e.clientX - down[0], e.clientY - down[1]) > 3) { down = null; return; }
      down = null;
      const box = gd.getBoundingClientRect(), size = gd._fullLayout._size;
      const x = e.clientX - box.left - size.l, y = e.clientY - box.top - size.t;
      if (x >= 0 && x <= size.w && y >= 0 && y <= size.h) setTime(gd._fullLayout.xaxis.p2l(x));
    }, true);
  }

  let following = false;
  function followZoom(gd, change) {
    if (following || !Object.keys(change).some((k) => /^xaxis\d*\.(range|autorange)/.test(k))) return;
    const range = gd._fullLayout.xaxis.range.slice();
    following = true;
    const others = Object.values(plots).filter((p) => p.chart.live === "cursor" && p.gd !== gd);
    Promise.all(others.map((p) => Plotly.relayout(p.gd, { "xaxis.range": range })))
      .finally(() => { following = false; });
  }

  function pick(gd, chart, n) {
    const choice = chart.choices[n];
    document.getElementById(`${chart.id}-note`).textContent = choice.note;
    const layout = { ...chart.layout, ...choice.layout };
    return Plotly.react(gd, choice.traces, layout, CONFIG);
  }

  async function draw(chart) {
    const gd = document.getElementById(`plot-${chart.id}`);
    const first = chart.choices.length ? chart.choices[0] : chart;
    if (chart.live === "scene") {
      const zones = first.traces.length - 2;
      Object.assign(first.traces[zones], cylinders(uavs.map((u) => place(u, now))),
        { i: mesh.i, j: mesh.j, k: mesh.k, facecolor: mesh.owner.map((n) => uavs[n].colour), opacity: 0.45, flatshading: true, lighting: { ambient: 0.85, diffuse: 0.4 } });
    }
    await Plotly.newPlot(gd, first.traces, { ...chart.layout, ...(first === chart ? {} : first.layout) }, CONFIG);
    plots[chart.id] = { gd, chart };
    if (chart.choices.length) {
      document.getElementById(`${chart.id}-note`).textContent = first.note;
      document.getElementById(`${chart.id}-pick`).addEventListener("change", (e) => pick(gd, chart, Number(e.target.value)));
    }
    if (chart.live === "cursor") {
      gd.cursor = document.createElement("div");
      gd.cursor.className = "cursor";
      gd.appendChild(gd.cursor);
      gd.on("plotly_afterplot", () => moveCursor(gd));
      gd.on("plotly_relayout", (change) => followZoom(gd, change));
      followClicks(gd);
      moveCursor(gd);
    } else if (chart.live) {
      const places = uavs.map((u) => place(u, now));
      refresh(gd, chart, places, lost(places));
    }
  }

  (async () => {
    for (const chart of data.charts) {
      await draw(chart);
      await new Promise((go) => setTimeout(go, 0)); // let the page answer in between
    }
    setTime(now);
    document.documentElement.dataset.ready = "yes";
  })();
})();
