// The drawing of the space: two canvases, one for what stays and one for the pulse, and the hand on it.

const spaceNode = document.getElementById("space");
const stillCanvas = document.getElementById("space-still");
const pulseCanvas = document.getElementById("space-pulse");
const spaceTip = document.getElementById("space-tip");
let sceneView = "path";
let eyePoint = null; // where the reader's eye is; null: as the point of view says
let spaceInk = null;
let shapes = [];
let hoverPlaces = []; // points of the trace, in pixels
let spaceWords = []; // rectangles of what is written
let pulseMarks = {}; // what moves, by name: points in space

const spaceSize = () => [Math.max(spaceNode.clientWidth, 40), Math.max(spaceNode.clientHeight, 40)];

function inkNow() {
  const style = getComputedStyle(document.body);
  return Object.fromEntries(["event", "arrival", "accent", "truth", "mirror", "quiet", "hair", "wash", "ink", "card"]
    .map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

// A canvas of the panel's size, cleared, measured in the page's pixels.
function clearedCanvas(canvas, width, height) {
  const scale = window.devicePixelRatio || 1;
  const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const g = canvas.getContext("2d");
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.clearRect(0, 0, width, height);
  return g;
}

function eyeOfView(name, width, height) {
  if (name === "camera" && camera) {
    const points = camera.field_mm.filter(isPlace);
    if (points.length) return eyeAt(camera.center_mm, points, width, height, 26);
  }
  const toEye = name === "path" ? [-0.28, 0.3, 0.92] : [-0.75, 0.42, 0.62];
  // All corners of the box that are drawn: the one nearest to the eye is not.
  const corners = cornersOf(boxes[name === "path" ? "path" : "scene"]).sort((p, q) => dot(p, toEye) - dot(q, toEye)).slice(0, 7);
  return fittedEye(anglesOf(toEye), corners, width, height, width > 500 ? 34 : 28);
}

const eyeNow = () => eyePoint || eyeOfView(sceneView, ...spaceSize());

function traceLine(g, placed) {
  g.beginPath();
  placed.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
}

function drawShape(g, shape, eye, project) {
  if (!shape.points.every(isPlace)) return;
  if (shape.tube) { drawTube(g, shape, project, eye); return; }
  const near = inFront(shape.points, eye, Boolean(shape.closed)).map(project);
  if (near.length < 2) return;
  traceLine(g, near);
  if (shape.closed) g.closePath();
  g.setLineDash(shape.dash || []);
  if (shape.fill) {
    g.globalAlpha = shape.fillAlpha || shape.alpha;
    g.fillStyle = shape.fill;
    g.fill();
  }
  if (shape.stroke) {
    g.globalAlpha = shape.alpha || 1;
    g.strokeStyle = shape.stroke;
    g.lineWidth = shape.width;
    g.lineCap = shape.cap || "butt";
    g.lineJoin = "round";
    g.stroke();
  }
  g.globalAlpha = 1;
  g.setLineDash([]);
}

// The outline of a tube whose cross-sections are ellipses of one standard deviation.
function drawTube(g, shape, project, eye) {
  const placed = shape.points.map(project);
  if (placed.some((p) => p[2] < NEAR * eye.distance)) return;
  const [first, last] = [placed[0], placed[placed.length - 1]];
  const long = Math.hypot(last[0] - first[0], last[1] - first[1]) || 1;
  const across = [-(last[1] - first[1]) / long, (last[0] - first[0]) / long];
  const reach = shape.tube.map((i, k) => Math.hypot(...[0, 3].map((q) => {
    const axis = [0, 1, 2].map((m) => tubeFactor * trace.half_axes_mm[6 * i + q + m]);
    const end = project(plus(shape.points[k], axis));
    return (end[0] - placed[k][0]) * across[0] + (end[1] - placed[k][1]) * across[1];
  })));
  if (!reach.every(Number.isFinite)) return;
  const side = (sign) => placed.map(([x, y], k) => [x + sign * reach[k] * across[0], y + sign * reach[k] * across[1]]);
  traceLine(g, [...side(1), ...side(-1).reverse()]);
  g.globalAlpha = shape.alpha;
  g.fillStyle = shape.fill;
  g.fill();
  g.globalAlpha = 1;
}

// --- axes ----------------------------------------------------------------------------------

const NAMES = ["x", "y", "z"];

// Which side of the box, along each axis, is behind everything as the eye sees it.
function farSides(box, eye) {
  const at = eyePlace(eye);
  return box.map(([low, high], k) => (at[k] > (low + high) / 2 ? 0 : 1));
}

function drawBox(g, box, eye, project, ink) {
  const far = farSides(box, eye);
  const line = (a, b) => drawShape(g, { points: [a, b], stroke: ink.hair, width: 1 }, eye, project);
  const steps = box.map(([low, high], k) => ticksBetween(low, high, ticksAlong(box, k, far, project)));
  for (let k = 0; k < 3; k += 1) {
    const [a, b] = [(k + 1) % 3, (k + 2) % 3];
    const at = (u, v) => { const p = []; p[k] = box[k][far[k]]; p[a] = u; p[b] = v; return p; };
    const face = [at(box[a][0], box[b][0]), at(box[a][1], box[b][0]), at(box[a][1], box[b][1]), at(box[a][0], box[b][1])];
    drawShape(g, { points: face, closed: true, fill: ink.wash, fillAlpha: 0.75, stroke: ink.hair, width: 1 }, eye, project);
    for (const u of steps[a]) line(at(u, box[b][0]), at(u, box[b][1]));
    for (const v of steps[b]) line(at(box[a][0], v), at(box[a][1], v));
  }
  return steps;
}

// The edge along an axis that carries its numbers: on the rim of the box, low for x and z, left for y.
function labelledEdge(box, k, far, project) {
  const [a, b] = [(k + 1) % 3, (k + 2) % 3];
  const ends = (i, j) => [0, 1].map((side) => { const p = []; p[k] = box[k][side]; p[a] = box[a][i]; p[b] = box[b][j]; return p; });
  const edges = [ends(far[a], 1 - far[b]), ends(1 - far[a], far[b])];
  const score = (edge) => { const [p, q] = edge.map(project); return k === 1 ? -(p[0] + q[0]) : p[1] + q[1]; };
  return score(edges[0]) > score(edges[1]) ? edges[0] : edges[1];
}

function ticksAlong(box, k, far, project) {
  const [p, q] = labelledEdge(box, k, far, project).map(project);
  if (!(p[2] > 0 && q[2] > 0)) return 3;
  return Math.max(1, Math.min(8, Math.hypot(q[0] - p[0], q[1] - p[1]) / (k === 1 ? 34 : 62)));
}

function writeAxes(room, box, steps, eye, project, ink) {
  const far = farSides(box, eye);
  const middle = project(box.map(([low, high]) => (low + high) / 2));
  const titles = [];
  for (let k = 0; k < 3; k += 1) {
    const edge = labelledEdge(box, k, far, project);
    const [p, q] = edge.map(project);
    if (!(p[2] > 0 && q[2] > 0)) continue;
    const long = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1;
    let out = [-(q[1] - p[1]) / long, (q[0] - p[0]) / long];
    const centre = [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2];
    if ((centre[0] - middle[0]) * out[0] + (centre[1] - middle[1]) * out[1] < 0) out = [-out[0], -out[1]];
    const beside = ([x, y], far1) => [x + out[0] * far1, y + out[1] * far1];
    const wide = 14 + 16 * Math.abs(out[0]);
    const step = steps[k].length > 1 ? steps[k][1] - steps[k][0] : Math.abs(steps[k][0]) || 1;
    for (const value of steps[k]) {
      const at = edge[0].slice();
      at[k] = value;
      room.put(tickText(value, step), [beside(project(at), wide)], ink.quiet, ink.card);
    }
    const along = [(q[0] - p[0]) / long, (q[1] - p[1]) / long];
    const beyond = ([x, y], far1) => [x + along[0] * far1, y + along[1] * far1];
    titles.push([`${NAMES[k]} (mm)`, [beside(centre, wide + 18), beyond(q, 22), beyond(p, -22), beyond(q, 34), beside(q, wide + 18),
      beside(p, wide + 18), beside(centre, wide + 34)]]);
  }
  // Numbers first: a title finds a place elsewhere, a number does not.
  for (const [text, places] of titles) room.put(text, places, ink.quiet, ink.card);
}

// --- the still part ------------------------------------------------------------------------

function nameThings(room, eye, project, ink) {
  const around = ([x, y]) => [[x, y - 15], [x, y + 15], [x + 28, y], [x - 28, y], [x, y - 30], [x, y + 30]];
  const put = (text, p) => {
    const at = isPlace(p) ? project(p) : [0, 0, -1];
    if (text && at[2] > NEAR * eye.distance) room.put(text, around(at), ink.ink, ink.card);
  };
  vertices.forEach((p, k) => put(vertexNames[k], p));
  if (!camera) return;
  if (sceneView !== "camera" || eyePoint) put(lookerName(), camera.center_mm);
  const outline = camera.field_mm.filter(isPlace).map(project).filter((p) => p[2] > 0);
  room.put("field of view", outline.map(([x, y]) => [x, y - 11]).concat(outline.map(([x, y]) => [x, y + 11])), ink.arrival, ink.card);
}

const lookerName = () => (eye === 0 ? "camera" : "second camera");

function drawStill() {
  const [width, height] = spaceSize();
  const g = clearedCanvas(stillCanvas, width, height);
  const look = eyeNow();
  const project = projector(look, width, height);
  const box = boxes[sceneView === "scene" ? "scene" : "path"];
  g.font = "11px system-ui, sans-serif";
  const steps = drawBox(g, box, look, project, spaceInk);
  const depth = (shape) => (shape.under ? 1e12 : 0) + (shape.over ? -1e12 : 0)
    + project(times(shape.points.reduce(plus, [0, 0, 0]), 1 / shape.points.length))[2];
  const inOrder = shapes.map((shape) => [depth(shape), shape]).sort((a, b) => b[0] - a[0]);
  for (const [, shape] of inOrder) drawShape(g, shape, look, project);
  drawDots(g, look, project);
  const room = wordRoom(g, width, height);
  g.font = "12.5px system-ui, sans-serif";
  nameThings(room, look, project, spaceInk);
  g.font = "11px system-ui, sans-serif";
  writeAxes(room, box, steps, look, project, spaceInk);
  hoverPlaces = Array.from(trace.leg, (_, i) => project(tracePoint(i)));
  spaceWords = room.taken;
}

function drawDots(g, look, project) {
  const dotAt = (p, radius) => {
    const [x, y, depth] = isPlace(p) ? project(p) : [0, 0, -1];
    if (!(depth > NEAR * look.distance)) return;
    g.beginPath();
    g.arc(x, y, radius, 0, 2 * Math.PI);
    g.fill();
  };
  g.fillStyle = spaceInk.ink;
  vertices.forEach((p, k) => dotAt(p, k === 0 ? 5 : 2.5));
  if (camera) dotAt(camera.center_mm, 5);
}

// --- the pulse -----------------------------------------------------------------------------

function drawPulse(now) {
  const [width, height] = spaceSize();
  const g = clearedCanvas(pulseCanvas, width, height);
  const look = eyeNow();
  const project = projector(look, width, height);
  const sight = camera && now.clock === "arrival" ? [now.place, camera.center_mm] : [];
  pulseMarks = { "to the camera": sight, pulse: now.body, "pulse centre": [now.place], "other clock": [now.ghost] };
  if (sight.length) drawShape(g, { points: sight, stroke: spaceInk.arrival, width: 1.8, dash: [2, 5] }, look, project);
  drawShape(g, { points: now.body, stroke: spaceInk.accent, width: 11, cap: "round" }, look, project);
  for (const other of now.others) drawShape(g, { points: other.body, stroke: spaceInk.accent, width: 11, cap: "round" }, look, project);
  const circle = (p, radius, fill, stroke) => {
    if (!isPlace(p)) return;
    const [x, y, depth] = project(p);
    if (!(depth > NEAR * look.distance)) return;
    g.beginPath();
    g.arc(x, y, radius, 0, 2 * Math.PI);
    if (fill) { g.fillStyle = fill; g.fill(); }
    g.strokeStyle = stroke;
    g.lineWidth = 2;
    g.stroke();
  };
  circle(now.ghost, 7, null, spaceInk.quiet);
  for (const other of now.others) circle(other.place, 6, spaceInk.accent, spaceInk.card);
  circle(now.place, 6, spaceInk.accent, spaceInk.card);
}

function movePulse(now) {
  if (spaceInk && nLegs) drawPulse(now);
}

function drawScene() {
  spaceInk = inkNow();
  shapes = stillShapes(spaceInk);
  drawStill();
  if (nLegs) drawPulse(current());
  writeLegend();
}

// What each mark means, and only those that are there.
function writeLegend() {
  const node = document.getElementById("scene-legend");
  const seen = Array.from(trace.in_view).some((x) => x === 1);
  const entries = [["path", "path", nLegs > 0], ["seen", "in the camera's view", Boolean(camera) && seen],
    ["truth", "truth", Boolean(payload.truth)],
    ["tube", `one standard deviation${tubeFactor > 1 ? `, enlarged ${tubeFactor}\u00d7` : ""}`, tubeFactor > 0],
    ["field", "field of view, where the path is", Boolean(camera)],
    ["mirror", "a mirror's place", mirrors.length > 0],
    ["ring", "the other clock's pulse at this reading", hasArrival]];
  node.replaceChildren();
  for (const [mark, text, there] of entries) {
    if (!there) continue;
    const item = element("li", undefined, node);
    element("i", undefined, item).className = `mark ${mark}`;
    item.append(text);
  }
  document.getElementById("scene-note").textContent = nLegs ? `Pulse ${show(path.pulse_fwhm_ps, 0, "ps")} long${path.pulse_fwhm_known ? "" : " (assumed)"}: `
    + `${show(path.pulse_fwhm_ps * C / path.path_index, 1, "mm")} in flight. Drag to turn, then scroll to zoom; point at the path for a point with its errors.` : "";
}

// --- the hand ------------------------------------------------------------------------------

let spaceAsked = false;

// However often the hand moves, one drawing per frame.
function redrawSpace() {
  if (spaceAsked) return;
  spaceAsked = true;
  requestAnimationFrame(() => {
    spaceAsked = false;
    drawStill();
    movePulse(current());
  });
}

function setView(name) {
  sceneView = name;
  eyePoint = null;
  for (const button of document.querySelectorAll("[data-view]")) {
    button.setAttribute("aria-pressed", String(button.dataset.view === name));
  }
  redrawSpace();
}

function turnBy(turn, tilt) {
  const eyeBefore = eyeNow();
  const limit = Math.PI / 2 - 0.01;
  eyePoint = { ...eyeBefore, turn: eyeBefore.turn + turn, tilt: Math.min(limit, Math.max(-limit, eyeBefore.tilt + tilt)) };
  redrawSpace();
}

function zoomBy(factor) {
  const eyeBefore = eyeNow();
  eyePoint = { ...eyeBefore, distance: Math.min(1e6, Math.max(1, eyeBefore.distance * factor)) };
  redrawSpace();
}

function pointAt(event) {
  const frame = spaceNode.getBoundingClientRect();
  const [x, y] = [event.clientX - frame.left, event.clientY - frame.top];
  let best = -1;
  let near = 14;
  hoverPlaces.forEach((p, i) => {
    const apart = Math.hypot(p[0] - x, p[1] - y);
    if (p[2] > 0 && apart < near) { near = apart; best = i; }
  });
  showTip(spaceTip, best < 0 ? "" : pathText(best), x, y, spaceNode);
}

// A note beside the pointer, inside its panel; no text: no note.
function showTip(tip, text, x, y, panel) {
  tip.hidden = !text;
  if (!text) return;
  tip.textContent = text;
  tip.style.left = `${Math.max(0, x + 16 + tip.offsetWidth > panel.clientWidth ? x - 12 - tip.offsetWidth : x + 16)}px`;
  tip.style.top = `${Math.max(0, Math.min(y - 10, panel.clientHeight - tip.offsetHeight))}px`;
}

function prepareSpaceEvents() {
  const held = new Map();
  spaceNode.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, [event.clientX, event.clientY]);
    spaceNode.setPointerCapture(event.pointerId);
  });
  spaceNode.addEventListener("pointermove", (event) => {
    const from = held.get(event.pointerId);
    if (!from) { pointAt(event); return; }
    const here = [event.clientX, event.clientY];
    if (held.size === 2) {
      const other = [...held].find(([id]) => id !== event.pointerId)[1];
      zoomBy(Math.hypot(from[0] - other[0], from[1] - other[1]) / Math.max(1, Math.hypot(here[0] - other[0], here[1] - other[1])));
    } else {
      turnBy(-0.007 * (here[0] - from[0]), 0.007 * (here[1] - from[1]));
    }
    held.set(event.pointerId, here);
  });
  for (const end of ["pointerup", "pointercancel"]) spaceNode.addEventListener(end, (event) => held.delete(event.pointerId));
  spaceNode.addEventListener("pointerleave", () => { spaceTip.hidden = true; });
  spaceNode.addEventListener("wheel", onWheel, { passive: false });
  spaceNode.addEventListener("keydown", onSpaceKey);
  new ResizeObserver(redrawSpace).observe(spaceNode);
}

// Only in a panel that was clicked, or with Ctrl: else the wheel moves the page.
function onWheel(event) {
  if (document.activeElement !== spaceNode && !event.ctrlKey) return;
  event.preventDefault();
  zoomBy(Math.exp(0.0012 * event.deltaY));
}

function onSpaceKey(event) {
  const actions = { ArrowLeft: () => turnBy(-0.1, 0), ArrowRight: () => turnBy(0.1, 0), ArrowUp: () => turnBy(0, 0.1),
    ArrowDown: () => turnBy(0, -0.1), "+": () => zoomBy(0.85), "-": () => zoomBy(1 / 0.85) };
  if (!actions[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  event.stopPropagation();
  actions[event.key]();
}
