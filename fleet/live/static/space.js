"use strict";
/* The same in space: a plain perspective, heights stretched. */
Fleet.space = function (canvas, stretch) {
  let shown = null, about = null, trails = null, turn = 0.6, tilt = 0.5, far = 0, drag = null, own = false;
  const RIM = 24;

  function frame() {
    const points = shown.uavs.length ? shown.uavs.map((u) => u.ned_m) : about.uavs.map((u) => u.route[0]);
    const low = [0, 1, 2].map((k) => Math.min(...points.map((p) => p[k]))), high = [0, 1, 2].map((k) => Math.max(...points.map((p) => p[k])));
    return { centre: low.map((x, k) => (x + high[k]) / 2), size: Math.max(high[0] - low[0], high[1] - low[1], 1500), ground: high[2] + 60 };
  }

  function camera(centre, w, h) {
    const [sa, ca, se, ce] = [Math.sin(turn), Math.cos(turn), Math.sin(tilt), Math.cos(tilt)], zoom = 0.9 * Math.max(h, w / 2);
    return (ned) => {
      const n = ned[0] - centre[0], e = ned[1] - centre[1], up = (centre[2] - ned[2]) * stretch;
      const right = e * ca - n * sa, ahead = e * sa + n * ca;
      const depth = far + ahead * ce - up * se;
      const high = ahead * se + up * ce, k = zoom / Math.max(depth, 10);
      return [w / 2 + right * k, h / 2 - high * k];
    };
  }

  function zone(pen, at, uav, look, lost) {
    const ring = (down) => Array.from({ length: RIM + 1 }, (_, k) => at([
      uav.ned_m[0] + look.radius_m * Math.cos((2 * Math.PI * k) / RIM), uav.ned_m[1] + look.radius_m * Math.sin((2 * Math.PI * k) / RIM), uav.ned_m[2] + down]));
    const low = ring(look.half_height_m), high = ring(-look.half_height_m);
    const dead = Fleet.UNMANNED.has(uav.mode);
    pen.strokeStyle = pen.fillStyle = lost ? Fleet.ALERT : dead ? "#9aa3ad" : look.colour;
    pen.lineWidth = lost ? 2 : 1; pen.globalAlpha = 0.16;
    pen.beginPath(); high.forEach(([x, y], n) => (n ? pen.lineTo(x, y) : pen.moveTo(x, y))); pen.fill();
    pen.globalAlpha = 0.8; Fleet.line(pen, low); Fleet.line(pen, high);
    for (let k = 0; k < RIM; k += 4) Fleet.line(pen, [low[k], high[k]]);
    pen.globalAlpha = 1;
  }

  function draw() {
    if (!shown) return;
    const { pen, w, h } = Fleet.sheet(canvas), { centre, size, ground } = frame();
    if (!own) far = 1.7 * size;
    const at = camera(centre, w, h), looks = new Map(about.uavs.map((u) => [u.id, u]));
    const lost = new Set(shown.pairs.filter((p) => p.apart < 1).flatMap((p) => [p.a, p.b]));
    pen.strokeStyle = "#e3e7eb"; pen.lineWidth = 1;
    const metres = size > 12000 ? 5000 : size > 4000 ? 1000 : 500, half = Math.ceil(size / metres / 1.6);
    const corner = [Math.round(centre[0] / metres), Math.round(centre[1] / metres)];
    for (let k = -half; k <= half; k++) {
      const line = (f) => Fleet.line(pen, [-half, half].map((j) => at(f(j))));
      line((j) => [(corner[0] + k) * metres, (corner[1] + j) * metres, ground]);
      line((j) => [(corner[0] + j) * metres, (corner[1] + k) * metres, ground]);
    }
    for (const u of shown.uavs) { pen.strokeStyle = "#c2c9d0"; Fleet.line(pen, [at(u.ned_m), at([u.ned_m[0], u.ned_m[1], ground])]); }
    for (const [id, trail] of trails) { pen.strokeStyle = looks.get(id).colour; pen.lineWidth = 2; Fleet.trail(pen, at, trail); }
    pen.setLineDash([6, 3]); pen.lineWidth = 1;
    for (const [id, path] of Object.entries(shown.paths)) { pen.strokeStyle = looks.get(Number(id)).colour; Fleet.line(pen, path.map(at)); }
    pen.setLineDash([]);
    for (const u of shown.uavs) zone(pen, at, u, looks.get(u.id), lost.has(u.id));
    Fleet.commanding(pen, at, shown.uavs);
    pen.fillStyle = "#22272e";
    for (const u of shown.uavs) { const [x, y] = at(u.ned_m); pen.beginPath(); pen.arc(x, y, 3, 0, 2 * Math.PI); pen.fill(); pen.fillText(String(u.id), x + 6, y - 6); }
  }

  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); drag = [e.offsetX, e.offsetY, turn, tilt]; });
  canvas.addEventListener("pointermove", (e) => {
    if (!drag) return;
    turn = drag[2] + (e.offsetX - drag[0]) / 150;
    tilt = Math.min(1.5, Math.max(0.05, drag[3] + (e.offsetY - drag[1]) / 150));
    draw();
  });
  canvas.addEventListener("pointerup", () => { drag = null; });
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); own = true; far *= Math.exp(e.deltaY / 600); draw(); }, { passive: false });

  return { show(view, what, flown) { shown = view; about = what; trails = flown; draw(); }, redraw: draw };
};
