// Graphs beside the pictures. Each is drawn when it first comes into view.

const graphs = {};
let residualsAs = "along";

function drawClocks(node) {
  if (!hasArrival) { say(node, "No camera: there is only one clock."); return; }
  const ta = onWay(trace.arrival_ps);
  const t = onWay(trace.event_ps);
  const series = [
    { kind: "line", x: ta, y: ta, name: "arrival time", color: color("arrival"), width: 2, say: (i) => `arrival time ${show(ta[i], 1, "ps")}` },
    { kind: "line", x: ta, y: t, name: "event time", color: color("event"), width: 3,
      say: (i) => `event time ${withError(t[i], trace.std[4 * way.points[i] + 3], "ps")}` }];
  if (payload.truth) {
    const t0 = payload.truth.vertex_times_ps[0];
    const points = truthClocks();
    series.push({ kind: "line", x: points.map((p) => p[1]), y: points.map((p) => p[0] + t0 - startTime), name: "truth",
      color: color("truth"), width: 1.5, dash: [6, 4] });
  }
  plotIn(node, { x: "arrival time since vertex 0 (ps)", y: "time since vertex 0 (ps)", series, keepZoom: true });
  addCursor(node, () => current().ta);
}

// Event time since the truth's first vertex, and arrival time since the path's.
function truthClocks() {
  const { vertices_mm: v, vertex_times_ps: times, leg_starts: starts } = payload.truth;
  const out = [];
  for (let k = 0; k + 1 < v.length; k += 1) {
    // What is no number parts the line: a leg that forks off begins anew.
    if (starts[k] !== k) out.push([NaN, NaN]);
    for (let i = 0; i <= 24; i += 1) {
      const p = [0, 1, 2].map((q) => lerp(v[starts[k]][q], v[k + 1][q], i / 24));
      const t = lerp(times[starts[k]], times[k + 1], i / 24);
      out.push([t - times[0], t + wayBack(p, t - startTime) - path.first_arrival_ps]);
    }
  }
  return out;
}

function drawSpeed(node) {
  if (!hasArrival) { say(node, "No camera: no apparent speed."); return; }
  const x = onWay(trace.length_mm);
  const speed = onWay(trace.apparent_speed);
  const real = 1 / path.path_index;
  plotIn(node, { x: "length of path (mm)", y: "speed (c)", zero: true, keepZoom: true, series: [
    { kind: "line", x, y: speed, name: "as the camera sees it", color: color("arrival"), width: 2.5,
      say: (i) => `seen at ${show(speed[i], 3, "c")}, ${show(x[i], 0, "mm")} along` },
    { kind: "line", x: [x[0], x[x.length - 1]], y: [real, real], name: "of the light", color: color("event"), width: 2 }] });
  addCursor(node, () => lengthAt(current().t));
}

function drawResiduals(node) {
  const at = pulses ? [...pulses.leg.keys()].filter((i) => pulses.leg[i] >= 0 && Number.isFinite(pulses.residual_ps[i])) : [];
  if (!at.length) { say(node, "The path carries no residuals."); return; }
  if (residualsAs === "map" && payload.camera) drawResidualMap(node, at);
  else if (at.length > 4000) drawManyResiduals(node, at);
  else drawResidualDots(node, at);
}

function drawResidualDots(node, at) {
  const errors = at.map((i) => pulses.std_ps[i]).sort((a, b) => a - b);
  const typical = errors[Math.floor(errors.length / 2)];
  const used = at.filter((i) => pulses.used[i]);
  const precise = used.filter((i) => pulses.std_ps[i] <= 3 * typical);
  const vague = used.filter((i) => !(pulses.std_ps[i] <= 3 * typical));
  const out = at.filter((i) => !pulses.used[i]);
  const values = precise.map((i) => Math.abs(pulses.residual_ps[i]) + pulses.std_ps[i]).sort((a, b) => a - b);
  const limit = values.length ? 1.15 * values[Math.floor(0.99 * (values.length - 1))] : 1;
  const dots = (list, more) => ({ kind: "dots", x: list.map((i) => pulses.length_mm[i]), y: list.map((i) => pulses.residual_ps[i]),
    error: list.map((i) => pulses.std_ps[i]), say: (k) => sayResidual(list[k]), ...more });
  const series = [dots(vague, { color: color("quiet"), alpha: 0.45, radius: 1.8, name: vague.length ? "imprecise" : "" }),
    dots(precise, { color: color("arrival"), radius: 2.3, name: "used" })];
  if (out.length) series.push(dots(out, { color: color("event"), radius: 3, crossed: true, name: `left out (${out.length})` }));
  plotIn(node, { x: "length of path (mm)", y: "measured \u2212 model (ps)", yRange: [-limit, limit], series, keepZoom: true });
  addCursor(node, () => lengthAt(current().t));
}

// What is said of a residual under the pointer; its pixel is shown as well.
function sayResidual(i) {
  if (eye === 0 && !(cursorPixel && cursorPixel[0] === pulses.row[i] && cursorPixel[1] === pulses.col[i])) selectPixel(pulses.row[i], pulses.col[i]);
  return `row ${pulses.row[i]}, column ${pulses.col[i]}, leg ${pulses.leg[i] + 1}\n${withError(pulses.residual_ps[i], pulses.std_ps[i])} ps`;
}

// Between two colours of the page: 0 the one, 1 the other.
function mixed(from, to) {
  const [a, b] = [rgb(from), rgb(to)];
  return (f) => `rgb(${[0, 1, 2].map((k) => Math.round(lerp(a[k], b[k], Math.min(1, Math.max(0, f))))).join(" ")})`;
}

// More pulses than marks make sense for: how many lie where.
function drawManyResiduals(node, at) {
  const used = at.filter((i) => pulses.used[i]);
  const sizes = used.map((i) => Math.abs(pulses.residual_ps[i])).sort((a, b) => a - b);
  const limit = 1.3 * (sizes[Math.floor(0.98 * (sizes.length - 1))] || 1);
  const [nx, ny] = [150, 60];
  const x = [0, Math.max(...ways.map((one) => one.lengths[one.legs.length])) / nx, nx];
  const y = [-limit, 2 * limit / ny, ny];
  const z = new Float64Array(nx * ny);
  for (const i of used) {
    const [a, b] = [Math.floor(pulses.length_mm[i] / x[1]), Math.floor((pulses.residual_ps[i] + limit) / y[1])];
    if (a >= 0 && a < nx && b >= 0 && b < ny) z[b * nx + a] += 1;
  }
  const most = spanOf([z])[1] || 1;
  const colorAt = mixed("card", "arrival");
  plotIn(node, { x: "length of path (mm)", y: "measured \u2212 model (ps)", scale: { title: "pulses", low: 0, high: most, colorAt },
    series: [{ kind: "cells", x, y, z, colorOf: (v) => colorAt(v / most), say: (i) => `${z[i]} pulses` }] });
  addCursor(node, () => lengthAt(current().t));
}

function drawResidualMap(node, at) {
  const [height, width] = payload.camera.shape;
  const z = new Float64Array(width * height).fill(NaN);
  for (const i of at) if (pulses.used[i]) z[pulses.row[i] * width + pulses.col[i]] = pulses.residual_ps[i];
  const sizes = Array.from(z).filter(Number.isFinite).map(Math.abs).sort((a, b) => a - b);
  const limit = sizes[Math.floor(0.95 * (sizes.length - 1))] || 1;
  const [early, late] = [mixed("hair", "arrival"), mixed("hair", "event")];
  const colorOf = (v) => (v < 0 ? early(-v / limit) : late(v / limit));
  plotIn(node, { x: "column", y: "row", square: true, flipped: true,
    scale: { title: "ps", low: -limit, high: limit, colorAt: (f) => colorOf(limit * (2 * f - 1)) },
    series: [{ kind: "cells", x: [-0.5, 1, width], y: [-0.5, 1, height], z, colorOf,
      say: (i) => (Number.isFinite(z[i]) ? `row ${Math.floor(i / width)}, column ${i % width}\n${show(z[i], 2, "ps")}` : "") }] });
}

function drawClockCard(node) {
  const clock = payload.clock;
  const facts = document.getElementById("clock-facts");
  facts.replaceChildren();
  if (!clock) { document.getElementById("clock-card").hidden = true; return; }
  const fact = (name, text) => { element("dt", name, facts); element("dd", text, facts); };
  fact("mean code", `${show(clock.bin_width_ps, 3, "ps")} (shared scale error ${show(100 * clock.scale_std, 2)}\u202f%)`);
  fact("gain of the pixels", `differs by ${show(100 * clock.gain_std, 2)}\u202f% rms`);
  fact("their delays", `differ by ${show(clock.delay_std_ps, 1, "ps")} rms`);
  if (clock.response_std_ps) fact("response", `${show(2.3548 * clock.response_std_ps, 1, "ps")} FWHM`);
  fact("usable", `${clock.usable} of ${clock.pixels} pixels`);
  const reasons = Object.entries(clock.reasons).map(([name, n]) => `${name.replaceAll("_", " ")} ${n}`);
  if (reasons.length) fact("flagged", reasons.join(", "));
  if (!clock.phases) { node.hidden = true; return; }
  plotIn(node, { x: `code modulo ${clock.phases.length}`, y: "relative width", series: [{ kind: "bars", base: 1, gap: 2,
    left: clock.phases.map((_, k) => k - 0.5), right: clock.phases.map((_, k) => k + 0.5), y: clock.phases,
    color: color("arrival"), say: (k) => `phase ${k}: ${show(clock.phases[k], 3)}` }] });
}
