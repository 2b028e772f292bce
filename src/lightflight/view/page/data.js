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
const legTimes = path.vertex_times_ps.map((t) => t - startTime);
let camera = payload.camera;
const trace = unpackTable(payload.trace);
const pulses = unpackTable(payload.pulses);
let hasArrival = Boolean(camera) && nLegs > 0 && path.first_arrival_ps !== null;

const isFiniteNumber = (x) => typeof x === "number" && Number.isFinite(x);
const lerp = (a, b, f) => a + (b - a) * f;

function legAt(t) {
  let k = 0;
  while (k < nLegs - 1 && t >= legTimes[k + 1]) k += 1;
  return k;
}

function positionAt(t) {
  if (!nLegs) return [NaN, NaN, NaN];
  const k = legAt(t);
  if (path.legs[k] && path.legs[k].bent) return placeOnTrace(t);
  const span = legTimes[k + 1] - legTimes[k];
  const f = span > 0 ? (t - legTimes[k]) / span : 0;
  return [0, 1, 2].map((i) => lerp(vertices[k][i], vertices[k + 1][i], f));
}

// Through a window light bends: its time back is told along the path, and read off there.
function wayBack(point, t) {
  if (trace && trace.back_ps && t !== undefined) return alongTrace(trace.back_ps, t);
  const d = Math.hypot(...point.map((x, i) => camera.center_mm[i] - x));
  return path.return_index * d / C;
}

// Arrival time of the light of event time t, both since vertex 0.
function arrivalFromEvent(t) {
  return hasArrival ? t + startTime + wayBack(positionAt(t), t) - path.first_arrival_ps : NaN;
}

const eventEnd = nLegs ? legTimes[nLegs] : 0;
let arrivalEnd = hasArrival ? arrivalFromEvent(eventEnd) : 0;

// Inverse of arrivalFromEvent: t_a grows with t along any path, so bisection cannot fail.
function eventFromArrival(ta) {
  let low = 0;
  let high = eventEnd;
  if (!(ta > 0)) return 0;
  if (ta >= arrivalEnd) return eventEnd;
  for (let i = 0; i < 64 && high - low > 1e-10; i += 1) {
    const middle = (low + high) / 2;
    if (arrivalFromEvent(middle) < ta) low = middle; else high = middle;
  }
  return (low + high) / 2;
}

// A column of the trace at event time t, linear between its points.
function alongTrace(column, t) {
  const times = trace.event_ps;
  let low = 0;
  let high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle; else high = middle;
  }
  const span = times[high] - times[low];
  return lerp(column[low], column[high], span > 0 ? (t - times[low]) / span : 0);
}

// On a bent leg: between the points of the trace, whose rows are x, y, z.
function placeOnTrace(t) {
  return [0, 1, 2].map((i) => alongTrace(trace.points_mm.filter((_, n) => n % 3 === i), t));
}

function legLength(k) {
  if (path.legs[k] && path.legs[k].bent) return path.legs[k].length_mm;
  return Math.hypot(...[0, 1, 2].map((i) => vertices[k + 1][i] - vertices[k][i]));
}

const legStarts = [0];
for (let k = 0; k < nLegs; k += 1) legStarts.push(legStarts[k] + legLength(k));

function lengthAt(t) {
  const k = legAt(t);
  const span = legTimes[k + 1] - legTimes[k];
  return legStarts[k] + (span > 0 ? (t - legTimes[k]) / span : 0) * (legStarts[k + 1] - legStarts[k]);
}

// Speed in units of c: of the pulse, or of what the camera sees of it.
function speedAt(t, clock) {
  if (!nLegs) return NaN;
  if (clock === "event" || !hasArrival) return 1 / path.path_index;
  if (trace.back_ps) return alongTrace(trace.apparent_speed, t);
  const k = legAt(t);
  const d = [0, 1, 2].map((i) => (vertices[k + 1][i] - vertices[k][i]) / legLength(k));
  const x = positionAt(t);
  const u = x.map((v, i) => camera.center_mm[i] - v);
  const approach = (d[0] * u[0] + d[1] * u[1] + d[2] * u[2]) / Math.hypot(...u);
  return 1 / (path.path_index - path.return_index * approach);
}

// Standard deviations of x, y, z (mm) and event time (ps) at event time t; NaN where there are none.
function stdAt(t) {
  const n = trace.event_ps.length;
  if (!n) return [NaN, NaN, NaN, NaN];
  let i = 0;
  while (i < n - 2 && trace.event_ps[i + 1] <= t) i += 1;
  const span = trace.event_ps[i + 1] - trace.event_ps[i];
  const f = span > 0 ? Math.min(1, Math.max(0, (t - trace.event_ps[i]) / span)) : 0;
  return [0, 1, 2, 3].map((k) => lerp(trace.std[4 * i + k], trace.std[4 * (i + 1) + k], f));
}

// Points from event time t0 to t1, corners included.
function piece(t0, t1) {
  const from = Math.max(0, t0);
  const to = Math.min(eventEnd, t1);
  const times = [];
  for (let i = 0; i <= 8; i += 1) times.push(lerp(from, to, i / 8));
  for (const t of legTimes) if (t > from && t < to) times.push(t);
  return times.sort((a, b) => a - b).map(positionAt);
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
