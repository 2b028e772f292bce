// The page's data: packed arrays, and the path as functions of both clocks.
// Times named t and ta count from vertex 0, each on its own clock, ps; lengths are mm.

const C = 0.299792458;
const payload = JSON.parse(document.getElementById("payload").textContent);
const KINDS = { f4: Float32Array, f8: Float64Array, u1: Uint8Array, u2: Uint16Array,
  u4: Uint32Array, i4: Int32Array };

function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i += 1) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

function unpack(part) {
  return part ? new KINDS[part.kind](bytesOf(part.base64).buffer) : null;
}

async function unzip(text) {
  const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function unpackTable(part) {
  if (!part) return null;
  return Object.fromEntries(Object.entries(part).map(([name, one]) => [name, unpack(one)]));
}

const path = payload.path;
const vertices = path.vertices_mm;
const nLegs = Math.max(vertices.length - 1, 0);
const startTime = nLegs ? path.vertex_times_ps[0] : 0;
let camera = payload.camera;
const trace = unpackTable(payload.trace);
const pulses = unpackTable(payload.pulses);
let hasArrival = Boolean(camera) && nLegs > 0 && path.first_arrival_ps !== null;

const isFiniteNumber = (x) => typeof x === "number" && Number.isFinite(x);
const lerp = (a, b, f) => a + (b - a) * f;

// The ways of the light to an end, one where nothing forks. Leg k ends at vertex k + 1; `corners`
// and their times go along the way, `points` are its rows of the trace.
const ways = path.ways.map((legs) => {
  const corners = [0, ...legs.map((k) => k + 1)];
  const own = new Set(legs);
  return { legs, corners, times: corners.map((k) => path.vertex_times_ps[k] - startTime),
    points: [...trace.leg.keys()].filter((i) => own.has(trace.leg[i])), lengths: [0] };
});
const isBent = (k) => Boolean(path.legs[k] && path.legs[k].bent);
function legLength(k) {
  if (isBent(k)) return path.legs[k].length_mm;
  const a = vertices[path.leg_starts[k]];
  return Math.hypot(...vertices[k + 1].map((x, i) => x - a[i]));
}
for (const one of ways) {
  for (let i = 0; i < one.legs.length; i += 1) {
    one.lengths.push(one.lengths[i] + legLength(one.legs[i]));
  }
}
const noWay = { legs: [], corners: [0], times: [0], points: [], lengths: [0] };
let way = ways[0] || noWay;
const timeOfLeg = (k) => path.vertex_times_ps[path.leg_starts[k]] - startTime;
const endOfWay = (on) => on.times[on.times.length - 1];
const onWay = (column, on = way) => on.points.map((i) => column[i]);

// Which piece of a way the pulse is on: its first, second ...
function pieceAt(t, on = way) {
  let k = 0;
  while (k < on.legs.length - 1 && t >= on.times[k + 1]) k += 1;
  return k;
}

const legAt = (t, on = way) => on.legs[pieceAt(t, on)];

// Share of that piece behind the pulse.
function shareAt(t, k, on) {
  const span = on.times[k + 1] - on.times[k];
  return span > 0 ? (t - on.times[k]) / span : 0;
}

function positionAt(t, on = way) {
  if (!on.legs.length) return [NaN, NaN, NaN];
  const k = pieceAt(t, on);
  if (isBent(on.legs[k])) return placeOnTrace(t, on);
  const f = shareAt(t, k, on);
  const [a, b] = [vertices[on.corners[k]], vertices[on.corners[k + 1]]];
  return [0, 1, 2].map((i) => lerp(a[i], b[i], f));
}

// Through a window light bends: its time back is told along the path, and read off there.
function wayBack(point, t, on = way) {
  if (trace && trace.back_ps && t !== undefined) return alongTrace(trace.back_ps, t, on);
  const d = Math.hypot(...point.map((x, i) => camera.center_mm[i] - x));
  return path.return_index * d / C;
}

// Arrival time of the light of event time t, both since vertex 0.
function arrivalFromEvent(t, on = way) {
  return hasArrival ? t + startTime + wayBack(positionAt(t, on), t, on) - path.first_arrival_ps : NaN;
}

let eventEnd = endOfWay(way);
let arrivalEnd = hasArrival ? arrivalFromEvent(eventEnd) : 0;

// Inverse of arrivalFromEvent: t_a grows with t along any path, so bisection cannot fail.
function eventFromArrival(ta, on = way) {
  let low = 0;
  let high = endOfWay(on);
  if (!(ta > 0)) return 0;
  if (ta >= arrivalFromEvent(high, on)) return high;
  for (let i = 0; i < 64 && high - low > 1e-10; i += 1) {
    const middle = (low + high) / 2;
    if (arrivalFromEvent(middle, on) < ta) low = middle; else high = middle;
  }
  return (low + high) / 2;
}

// The trace's two points about event time t on a way, and the share of the way between them.
function betweenPoints(t, on = way) {
  const times = trace.event_ps;
  let low = 0;
  let high = on.points.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[on.points[middle]] <= t) low = middle; else high = middle;
  }
  const [a, b] = [on.points[low], on.points[high]];
  const span = times[b] - times[a];
  return [a, b, span > 0 ? (t - times[a]) / span : 0];
}

// A column of the trace at event time t, linear between its points.
function alongTrace(column, t, on = way) {
  const [a, b, f] = betweenPoints(t, on);
  return lerp(column[a], column[b], f);
}

// On a bent leg: between the points of the trace, whose rows are x, y, z.
function placeOnTrace(t, on = way) {
  const [a, b, f] = betweenPoints(t, on);
  return [0, 1, 2].map((i) => lerp(trace.points_mm[3 * a + i], trace.points_mm[3 * b + i], f));
}

function lengthAt(t, on = way) {
  const k = pieceAt(t, on);
  return lerp(on.lengths[k], on.lengths[k + 1], shareAt(t, k, on));
}

// Speed in units of c: of the pulse, or of what the camera sees of it.
function speedAt(t, clock) {
  if (!nLegs) return NaN;
  if (clock === "event" || !hasArrival) return 1 / path.path_index;
  if (trace.back_ps) return alongTrace(trace.apparent_speed, t);
  const k = legAt(t);
  const step = vertices[k + 1].map((x, i) => x - vertices[path.leg_starts[k]][i]);
  const d = step.map((x) => x / Math.hypot(...step));
  const x = positionAt(t);
  const u = x.map((v, i) => camera.center_mm[i] - v);
  const approach = (d[0] * u[0] + d[1] * u[1] + d[2] * u[2]) / Math.hypot(...u);
  return 1 / (path.path_index - path.return_index * approach);
}

// Standard deviations of x, y, z (mm) and event time (ps) at event time t; NaN where there are none.
function stdAt(t) {
  if (!way.points.length) return [NaN, NaN, NaN, NaN];
  const [a, b, share] = betweenPoints(t);
  const f = Math.min(1, Math.max(0, share));
  return [0, 1, 2, 3].map((k) => lerp(trace.std[4 * a + k], trace.std[4 * b + k], f));
}

// Points from event time t0 to t1, corners included; none where the way ended before.
function piece(t0, t1, on = way) {
  const from = Math.max(0, t0);
  const to = Math.min(endOfWay(on), t1);
  if (to < from) return [];
  const times = [];
  for (let i = 0; i <= 8; i += 1) times.push(lerp(from, to, i / 8));
  for (const t of on.times) if (t > from && t < to) times.push(t);
  return times.sort((a, b) => a - b).map((t) => positionAt(t, on));
}

function flagNames(word) {
  return payload.flags.filter(([bit]) => (word & bit) !== 0).map(([, name]) => name.replaceAll("_", " "));
}

function show(value, digits, unit = "") {
  if (!isFiniteNumber(value)) return "–";
  return `${value.toFixed(digits).replace("-", "\u2212")}${unit ? `\u202f${unit}` : ""}`;
}

// With the error's two significant digits; a value without error shows three decimals.
function withError(value, error, unit = "") {
  if (!isFiniteNumber(value)) return "–";
  if (!isFiniteNumber(error) || error <= 0) return show(value, 3, unit);
  const digits = Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(error))));
  return `${show(value, digits)} ± ${show(error, digits, unit)}`;
}

function color(name) {
  return getComputedStyle(document.body).getPropertyValue(`--${name}`).trim();
}

function element(tag, text, parent) {
  const node = document.createElement(tag);
  if (text !== undefined) node.textContent = text;
  if (parent) parent.append(node);
  return node;
}
