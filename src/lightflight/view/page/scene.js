// What stands in the space: path, tubes, mirrors, field of view; and the boxes it is looked at in.

let tubeFactor = 1;

const tracePoint = (i) => [0, 1, 2].map((k) => trace.points_mm[3 * i + k]);

function pathText(i) {
  const [x, y, z] = [0, 1, 2].map((k) => withError(trace.points_mm[3 * i + k], trace.std[4 * i + k]));
  return [`x ${x} mm`, `y ${y} mm`, `z ${z} mm`, `event time ${withError(trace.event_ps[i], trace.std[4 * i + 3])} ps`,
    `arrival time ${show(trace.arrival_ps[i], 1)} ps`, `leg ${trace.leg[i] + 1}`].join("\n");
}

function extentOf(points) {
  return [0, 1, 2].map((i) => {
    const values = points.filter(isPlace).map((p) => p[i]);
    return values.length ? [Math.min(...values), Math.max(...values)] : [-1, 1];
  });
}

// The points' box with a little room, no side thinner than a share of the longest.
function paddedBox(points, share) {
  const extent = extentOf(points);
  const size = Math.max(...extent.map(([a, b]) => b - a), 1);
  return extent.map(([a, b]) => {
    const pad = Math.max(0.03 * size, (share * size - (b - a)) / 2);
    return [a - pad, b + pad];
  });
}

const pathPoints = vertices.concat(payload.truth ? payload.truth.vertices_mm : []);
const cameraPoints = [payload.camera, payload.second && payload.second.camera]
  .flatMap((c) => (c ? [c.center_mm, ...c.field_mm] : []));
const boxes = { path: paddedBox(pathPoints, 0.13), scene: paddedBox(pathPoints.concat(cameraPoints), 0.12) };
const sizeOf = (box) => Math.max(...box.map(([a, b]) => b - a));
const cornersOf = (box) => [0, 1, 2, 3, 4, 5, 6, 7].map((k) => box.map((side, i) => side[(k >> i) & 1]));

function niceFactor(ratio) {
  if (!(ratio > 1)) return 1;
  const power = 10 ** Math.floor(Math.log10(ratio));
  return Math.max(...[1, 2, 5].map((s) => s * power).filter((s) => s <= ratio * 1.0001));
}

// Enlarged until the typical error is seen; 0 where the path carries no errors.
function findTubeFactor() {
  if (!trace.half_axes_mm) return 0;
  const radius = [];
  for (let i = 0; i < trace.leg.length; i += 1) radius.push(Math.hypot(...trace.half_axes_mm.slice(6 * i, 6 * i + 3)));
  const sorted = radius.filter(Number.isFinite).sort((a, b) => a - b);
  const typical = sorted[Math.floor(sorted.length / 2)];
  return typical > 0 ? niceFactor(0.02 * sizeOf(boxes.path) / typical) : 0;
}

// First and last point of pieces of legs: short enough to be drawn in the order of their depth.
function piecesOfLegs(most) {
  const out = [];
  let first = 0;
  for (let i = 1; i <= trace.leg.length; i += 1) {
    if (i < trace.leg.length && trace.leg[i] === trace.leg[first]) continue;
    const step = Math.max(1, Math.ceil((i - 1 - first) / most));
    for (let k = first; k < i - 1; k += step) out.push([k, Math.min(k + step, i - 1)]);
    first = i;
  }
  return out;
}

// The square a flat mirror at corner k would fill; where light forks, by the leg that turns most.
function mirrorCorners(k, size) {
  const along = (i) => unit(minus(vertices[i + 1], vertices[path.leg_starts[i]]));
  const turns = path.leg_starts.flatMap((start, i) => (start === k ? [minus(along(i), along(k - 1))] : []));
  const normal = unit(turns.reduce((a, b) => (Math.hypot(...b) > Math.hypot(...a) ? b : a)));
  const side = unit(cross(Math.abs(normal[1]) > 0.95 ? [0, 0, 1] : [0, 1, 0], normal));
  const up = cross(normal, side);
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => plus(vertices[k], times(plus(times(side, a), times(up, b)), size / 2)));
}

const exits = new Set(path.ways.map((legs) => legs[legs.length - 1] + 1));
const mirrors = vertices.flatMap((_, k) => (k > 0 && !exits.has(k) ? [mirrorCorners(k, 0.06 * sizeOf(boxes.path))] : []))
  .filter((corners) => corners.every(isPlace));

// Mirrors that end a way nobody saw: where they stand is open.
const open = new Set((path.legs || []).flatMap((leg, k) => (leg.seen === false ? [k, k + 1] : [])));
const splits = (k) => path.leg_starts.filter((start) => start === k).length > 1;
const vertexNames = vertices.map((_, k) => (k === 0 ? (path.source_known ? "source" : "entry")
  : exits.has(k) ? "exit" : nLegs <= 12 ? `${splits(k) ? "S" : "M"}${k}${open.has(k) ? "?" : ""}` : ""));

// Everything that stays while time runs, as shapes: { points, closed, fill, stroke, width, alpha, dash }.
function stillShapes(ink) {
  const out = fieldShapes(ink);
  for (const corners of mirrors) out.push({ points: corners, closed: true, fill: ink.mirror, stroke: ink.quiet, width: 0.8, alpha: 0.92 });
  if (payload.truth) {
    const { vertices_mm: v, leg_starts: starts } = payload.truth;
    for (let k = 0; k + 1 < v.length; k += 1) out.push({ points: [v[starts[k]], v[k + 1]], stroke: ink.truth, width: 2, dash: [7, 5], over: true });
  }
  tubeFactor = findTubeFactor();
  for (const [a, b] of piecesOfLegs(8)) {
    const indices = Array.from({ length: b - a + 1 }, (_, k) => a + k);
    const points = indices.map(tracePoint);
    if (tubeFactor) out.push({ points, tube: indices, fill: ink.event, alpha: 0.22 });
    out.push({ points, stroke: ink.event, width: 2 });
    const seen = indices.filter((i) => trace.in_view[i] === 1).map(tracePoint);
    if (camera && seen.length > 1) out.push({ points: seen, stroke: ink.event, width: 5, alpha: 0.55 });
  }
  return out;
}

// The field of view: a pane where the path is, held by four rays from the camera.
function fieldShapes(ink) {
  if (!camera) return [];
  const corners = [0, 8, 16, 24].map((i) => camera.field_mm[i]);
  if (!corners.every((p) => p && isPlace(p))) return [];
  const out = [{ points: camera.field_mm, closed: true, fill: ink.arrival, stroke: ink.arrival, width: 1.5, alpha: 1, fillAlpha: 0.07, under: true }];
  corners.forEach((corner, k) => {
    out.push({ points: [camera.center_mm, corner, corners[(k + 1) % 4]], closed: true, fill: ink.arrival, fillAlpha: 0.035, alpha: 1, under: true });
    out.push({ points: [camera.center_mm, corner], stroke: ink.arrival, width: 1, alpha: 0.5 });
  });
  return out;
}
