"use strict";
/* The plan view: north is up, lengths are metres. */
const Fleet = window.Fleet = {};
Fleet.ALERT = "#b3123a"; Fleet.GREY = "#5c6672";
Fleet.UNMANNED = new Set(["unmanned", "held"]);

/* Whether faults can be added: not to a log, nor where the page only shows. */
Fleet.canChange = (about) => !about.recorded && !about.read_only;

/* A canvas as sharp as the screen, in CSS pixels. */
Fleet.sheet = function (canvas) {
  const scale = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * scale) || canvas.height !== Math.round(h * scale)) {
    canvas.width = Math.round(w * scale); canvas.height = Math.round(h * scale);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, w, h);
  pen.font = "12px system-ui, DejaVu Sans, sans-serif";
  return { pen, w, h };
};

Fleet.line = function (pen, points) {
  pen.beginPath();
  points.forEach(([x, y], n) => (n ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
};

/* The path that was flown, but where nothing is known of some seconds: no straight line is drawn for these. */
Fleet.trail = function (pen, at, trail) {
  const GAP_S = 5, pieces = [];
  trail.forEach((point, n) => {
    if (!n || point.t_s - trail[n - 1].t_s > GAP_S) pieces.push([]);
    pieces[pieces.length - 1].push(at(point.ned_m));
  });
  for (const piece of pieces) Fleet.line(pen, piece);
};

/* Lines from each computing UAV to those that fly its commands; `at` says where on a canvas a place is. */
Fleet.commanding = function (pen, at, uavs) {
  const places = new Map(uavs.map((u) => [u.id, u.ned_m]));
  pen.strokeStyle = "#22272e"; pen.lineWidth = 1; pen.setLineDash([2, 3]);
  for (const u of uavs) if (u.by !== null && u.by !== u.id && places.has(u.by)) Fleet.line(pen, [at(places.get(u.by)), at(u.ned_m)]);
  pen.setLineDash([]);
};

/* Groups after a drawing: the second goes beside the first, which loses whom both have; a third begins anew. */
Fleet.grouped = function (groups, drawn) {
  const first = groups.length === 1 ? groups[0].filter((id) => !drawn.includes(id)) : [];
  return first.length ? [first, drawn] : [drawn];
};

Fleet.plan = function (canvas, onGroups) {
  const GROUPS = [Fleet.ALERT, "#1f5fbf"];
  let shown = null, about = null, trails = null, centre = [0, 0], scale = 0.05, own = false, drag = null, box = null, groups = [];

  const to = (ned) => [canvas.clientWidth / 2 + (ned[1] - centre[1]) * scale, canvas.clientHeight / 2 - (ned[0] - centre[0]) * scale];

  function fit() {
    const points = [...shown.uavs.map((u) => u.ned_m), ...Object.values(shown.paths).flat()];
    if (!points.length) return;
    const room = Math.max(400, 1.1 * Math.max(...about.uavs.map((u) => u.radius_m)));
    const low = [0, 1].map((k) => Math.min(...points.map((p) => p[k])) - room);
    const high = [0, 1].map((k) => Math.max(...points.map((p) => p[k])) + room);
    centre = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    scale = Math.min(canvas.clientWidth / (high[1] - low[1]), canvas.clientHeight / (high[0] - low[0]));
  }

  function grid(pen, w, h) {
    const metres = [100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000].find((m) => m * scale > 60) || 100000;
    pen.strokeStyle = "#edf0f3"; pen.lineWidth = 1;
    const from = [centre[0] - h / 2 / scale, centre[1] - w / 2 / scale];
    for (let n = Math.ceil(from[0] / metres) * metres; to([n, 0])[1] > 0; n += metres) Fleet.line(pen, [[0, to([n, 0])[1]], [w, to([n, 0])[1]]]);
    for (let e = Math.ceil(from[1] / metres) * metres; to([0, e])[0] < w; e += metres) Fleet.line(pen, [[to([0, e])[0], 0], [to([0, e])[0], h]]);
    pen.strokeStyle = pen.fillStyle = Fleet.GREY; pen.lineWidth = 2;
    Fleet.line(pen, [[12, h - 12], [12 + metres * scale, h - 12]]);
    pen.fillText(metres >= 1000 ? `${metres / 1000} km` : `${metres} m`, 14, h - 17);
  }

  function aircraft(pen, uav, look, lost) {
    const [x, y] = to(uav.ned_m), dead = Fleet.UNMANNED.has(uav.mode);
    const colour = dead ? "#9aa3ad" : look.colour;
    pen.globalAlpha = 0.22; pen.fillStyle = lost ? Fleet.ALERT : colour;
    pen.beginPath(); pen.arc(x, y, look.radius_m * scale, 0, 2 * Math.PI); pen.fill();
    pen.globalAlpha = 1; pen.strokeStyle = lost ? Fleet.ALERT : colour; pen.lineWidth = lost ? 2 : 1; pen.stroke();
    pen.save(); pen.translate(x, y); pen.rotate(uav.heading_rad);
    const group = groups.findIndex((ids) => ids.includes(uav.id));
    pen.fillStyle = colour; pen.strokeStyle = GROUPS[group] || "#22272e"; pen.lineWidth = group < 0 ? 1 : 3;
    pen.beginPath(); pen.moveTo(0, -9); pen.lineTo(6, 7); pen.lineTo(0, 3); pen.lineTo(-6, 7); pen.closePath(); pen.fill(); pen.stroke();
    pen.restore();
    pen.fillStyle = "#22272e";
    pen.fillText(`${uav.id}${uav.by !== null || dead ? ` ${uav.mode}` : ""}`, x + 10, y - 8);
    pen.fillText(`${Math.round(-uav.ned_m[2])} m`, x + 10, y + 5);
  }

  function draw() {
    if (!shown) return;
    if (!own) fit();
    const { pen, w, h } = Fleet.sheet(canvas);
    grid(pen, w, h);
    const looks = new Map(about.uavs.map((u) => [u.id, u]));
    const lost = new Set(shown.pairs.filter((p) => p.apart < 1).flatMap((p) => [p.a, p.b]));
    pen.setLineDash([3, 5]); pen.lineWidth = 1;
    for (const u of about.uavs) { pen.strokeStyle = u.colour; pen.globalAlpha = 0.5; Fleet.line(pen, u.route.map(to)); }
    pen.setLineDash([]); pen.globalAlpha = 1;
    for (const [id, trail] of trails) { pen.strokeStyle = looks.get(id).colour; pen.lineWidth = 2; Fleet.trail(pen, to, trail); }
    pen.setLineDash([6, 3]);
    for (const [id, path] of Object.entries(shown.paths)) { pen.strokeStyle = looks.get(Number(id)).colour; pen.lineWidth = 1.2; Fleet.line(pen, path.map(to)); }
    pen.setLineDash([]);
    Fleet.commanding(pen, to, shown.uavs);
    for (const u of shown.uavs) aircraft(pen, u, looks.get(u.id), lost.has(u.id));
    if (box) { pen.strokeStyle = GROUPS[groups.length % 2]; pen.strokeRect(box[0], box[1], box[2] - box[0], box[3] - box[1]); }
  }

  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    if (e.shiftKey && about && Fleet.canChange(about)) box = [e.offsetX, e.offsetY, e.offsetX, e.offsetY]; else drag = [e.offsetX, e.offsetY, ...centre];
  });
  canvas.addEventListener("pointermove", (e) => {
    if (box) { box[2] = e.offsetX; box[3] = e.offsetY; draw(); }
    if (drag) { own = true; centre = [drag[2] + (e.offsetY - drag[1]) / scale, drag[3] - (e.offsetX - drag[0]) / scale]; draw(); }
  });
  canvas.addEventListener("pointerup", () => {
    if (box && shown) {
      const [left, right] = [Math.min(box[0], box[2]), Math.max(box[0], box[2])], [top, bottom] = [Math.min(box[1], box[3]), Math.max(box[1], box[3])];
      const within = ([x, y]) => x >= left && x <= right && y >= top && y <= bottom;
      const drawn = shown.uavs.filter((u) => within(to(u.ned_m))).map((u) => u.id);
      groups = drawn.length ? Fleet.grouped(groups, drawn) : [];
      onGroups(groups);
    }
    box = drag = null; draw();
  });
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); own = true; scale *= Math.exp(-e.deltaY / 600); draw(); }, { passive: false });
  canvas.addEventListener("dblclick", () => { own = false; draw(); });

  return { show(view, what, flown) { shown = view; about = what; trails = flown; draw(); }, redraw: draw, forget() { groups = []; draw(); } };
};
