"use strict";
/* The page: takes what comes, has it drawn once a frame, and asks for what is clicked. */
(function () {
  const TRAIL_S = 60, STRETCH = 4;
  const SPEEDS = { live: [["as fast as it goes", 0], ["¼ ×", 0.25], ["1 ×", 1], ["2 ×", 2], ["5 ×", 5], ["20 ×", 20]], log: [["¼ ×", 0.25], ["1 ×", 1], ["2 ×", 2], ["5 ×", 5], ["20 ×", 20], ["100 ×", 100]] };
  const $ = (id) => document.getElementById(id), canvas = (id) => document.querySelector(`#${id} canvas`);
  const trails = new Map();
  let about = null, view = null, asked = false, socket = null, over = "", pending = [], rate = null, parting = false;

  const ask = (change) => {
    if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(change));
    else told({ good: false, text: "there is no connection to the run" });
  };
  const told = (outcome) => { $("outcome").textContent = outcome.text; $("outcome").className = outcome.good ? "" : "bad"; };
  const others = (chosen) => about.processes.filter((p) => !chosen.includes(p)).map((p) => (p === 0 ? "coordinator" : p));

  const partition = document.querySelector("[name=partition]");
  const plan = Fleet.plan(canvas("plan"), ([first, second]) => {
    const rest = first ? others(first) : [];
    partition.value = first && rest.length ? `${first.join(",")}/${(second || rest).join(",")}` : "";
    if (partition.value) told({ good: true, text: `a partition of UAV ${first.join(", ")} from ${second
      ? `UAV ${second.join(", ")}; who is in neither group hears both: press Add`
      : "the rest: press Add, or draw the other group"}` });
  });
  const strip = Fleet.strip(canvas("strip"));
  const drawn = [plan, Fleet.space(canvas("space"), STRETCH), strip, Fleet.matrix(canvas("links")),
    Fleet.lists($("groups"), $("events"), $("rules"), (n) => ask({ end: [n] }))];
  $("stretch").textContent = STRETCH;

  function draw() {
    asked = false;
    if (over) $("state").textContent = over;
    if (!view || !about) return;
    for (const one of drawn) one.show(view, about, trails);
    const least = view.pairs.length ? `, least separation ${view.pairs[0].apart.toFixed(2)}` : "";
    const speed = rate === null ? "" : `, ${rate.toFixed(1)} × real time`;
    $("state").textContent = over || `${view.t_s.toFixed(1)} of ${about.end_s} s${view.paused ? ", paused" : speed}${least}`;
    $("state").classList.toggle("over", Boolean(over));
    $("pause").textContent = view.paused ? "Go on" : "Pause";
    $("step").disabled = !view.paused || Boolean(over);
    if (document.activeElement !== $("speed")) $("speed").value = String(view.speed);
    if (document.activeElement !== $("when")) $("when").value = view.t_s;
    processes();
  }

  function processes() {
    for (const box of document.querySelectorAll("#processes .row")) {
      const p = Number(box.dataset.process), down = view.down.includes(p), held = view.held.includes(p);
      box.classList.toggle("down", down); box.classList.toggle("held", held);
      const [kill, pause] = box.querySelectorAll("button");
      kill.textContent = down ? "Restart" : "Kill"; pause.textContent = held ? "Continue" : "Pause"; pause.disabled = down;
    }
  }

  function process(p) {
    const box = document.createElement("span"), name = p === 0 ? "coordinator" : String(p);
    box.className = "row"; box.dataset.process = p; box.append(p === 0 ? "Coordinator" : `UAV ${p}`);
    const named = (kind) => view.rules.filter((r) => r.on && r.kind === kind && r.node === name).map((r) => r.n);
    for (const kind of ["kill", "pause"]) {
      const button = document.createElement("button");
      button.textContent = kind;
      button.addEventListener("click", () => {
        const on = (kind === "kill" ? view.down : view.held).includes(p);
        ask(on ? { end: named(kind) } : { faults: { [kind]: [name] } });
      });
      box.append(button);
    }
    return box;
  }

  function begin() {
    $("title").textContent = about.title; document.title = `${about.title}, live`;
    $("warnings").textContent = about.warnings.join("; "); $("warnings").hidden = !about.warnings.length;
    $("speed").replaceChildren(...SPEEDS[about.recorded ? "log" : "live"].map(([text, value]) => new Option(text, value)));
    $("when").hidden = !about.recorded; $("when").max = about.end_s;
    $("cutting").hidden = !Fleet.canChange(about);
    $("processes").replaceChildren(...(Fleet.canChange(about) ? about.processes.map(process) : []));
    for (const control of document.querySelectorAll("#faults input, #faults button")) control.disabled = !Fleet.canChange(about);
    for (const control of document.querySelectorAll("#pace button, #pace select, #pace input")) control.disabled = about.read_only;
    trails.clear(); strip.clear();
  }

  /* A moment's positions and separation; moments come in order of time. */
  function note(moment) {
    for (const u of moment.uavs) {
      if (!trails.has(u.id)) trails.set(u.id, []);
      const trail = trails.get(u.id);
      if (!trail.length || trail[trail.length - 1].t_s < moment.t_s) trail.push({ t_s: moment.t_s, ned_m: u.ned_m });
    }
    strip.note(moment, about);
  }

  function keep(next) {
    const seconds = performance.now() / 1000;
    if (view && next.t_s < view.t_s) { trails.clear(); strip.clear(); pending = []; }
    for (const moment of [...(next.past || []), next]) note(moment); // of a log all that was flown since the last view
    for (const [id, trail] of trails) trails.set(id, trail.filter((p) => p.t_s >= next.t_s - TRAIL_S));
    pending = [...pending, [seconds, next.t_s]].filter(([s]) => s > seconds - 3);
    const [from, to] = [pending[0], pending[pending.length - 1]];
    rate = to[0] - from[0] > 0.5 ? (to[1] - from[1]) / (to[0] - from[0]) : null;
    view = next;
    if (!asked) { asked = true; requestAnimationFrame(draw); }
  }

  /* The field is emptied once its partition is in the plan: what is refused can be mended. */
  function parted(good) {
    if (parting && good) { partition.value = ""; plan.forget(); }
    parting = false;
  }

  function connect() {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live${location.search}`);
    socket.addEventListener("message", (event) => {
      const message = JSON.parse(event.data);
      if (message.about) { about = message.about; begin(); }
      if (message.view) keep(message.view);
      if (message.outcome) { told(message.outcome); parted(message.outcome.good); }
      if (message.over) { over = message.over; draw(); }
    });
    socket.addEventListener("close", () => { if (!over) { over = "the page's server has gone"; draw(); } });
  }

  $("pause").addEventListener("click", () => ask({ paused: !view.paused }));
  $("step").addEventListener("click", () => ask({ steps: 1 }));
  $("speed").addEventListener("change", (e) => { ask({ speed: Number(e.target.value) }); e.target.blur(); });
  $("when").addEventListener("input", (e) => ask({ to_s: Number(e.target.value) }));
  $("when").addEventListener("change", (e) => e.target.blur());
  $("clear").addEventListener("click", () => ask({ clear: true }));
  $("faults").addEventListener("submit", (e) => {
    e.preventDefault();
    const faults = {};
    for (const input of e.target.querySelectorAll("input")) if (input.value.trim()) faults[input.name] = [input.value.trim()];
    if (!Object.keys(faults).length) return;
    parting = Boolean(faults.partition);
    ask({ faults });
  });
  window.addEventListener("resize", () => drawn.forEach((one) => one.redraw && one.redraw()));
  connect();
})();
