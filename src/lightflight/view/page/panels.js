// Graphs beside the pictures. Each is drawn when it first comes into view.

const graphs = {};
const pixelIndex = new Map();
let blob = null;
let blobWait = null;
let residualsAs = "along";

function graphLayout(x, y, more = {}) {
  const axis = (text) => ({ title: { text, font: { size: 12 }, standoff: 6 }, color: color("quiet"),
    gridcolor: color("hair"), zerolinecolor: color("hair"), linecolor: color("hair"), automargin: true,
    tickfont: { size: 11 } });
  const { xaxis, yaxis, ...rest } = more;
  return { margin: { l: 52, r: 10, t: 8, b: 42 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: color("ink"), family: "system-ui, sans-serif" }, hoverlabel: { bgcolor: color("card"),
      font: { color: color("ink") } }, legend: { x: 0.02, y: 0.98, bgcolor: "rgba(0,0,0,0)", font: { size: 11.5 } },
    dragmode: "zoom", xaxis: { ...axis(x), ...xaxis }, yaxis: { ...axis(y), ...yaxis }, ...rest };
}

const graphOptions = { displaylogo: false, responsive: true, displayModeBar: false };

function say(node, text) {
  Plotly.purge(node);
  node.textContent = text;
  node.classList.add("quiet");
}

function drawClocks(node) {
  if (!hasArrival) { say(node, "No camera: there is only one clock."); return; }
  const ta = Array.from(trace.arrival_ps);
  const data = [
    { x: ta, y: ta, name: "arrival time", mode: "lines", line: { color: color("arrival"), width: 2 } },
    { x: ta, y: Array.from(trace.event_ps), name: "event time", mode: "lines", line: { color: color("event"), width: 3 } }];
  if (payload.truth) {
    const t0 = payload.truth.vertex_times_ps[0];
    const points = truthClocks();
    data.push({ x: points.map((p) => p[1]), y: points.map((p) => p[0] + t0 - startTime), name: "truth", mode: "lines",
      line: { color: color("truth"), width: 1.5, dash: "dash" } });
  }
  Plotly.react(node, data, graphLayout("arrival time since vertex 0 (ps)", "time since vertex 0 (ps)"), graphOptions);
  addCursor(node, () => current().ta);
}

// Event time since the truth's first vertex, and arrival time since the path's.
function truthClocks() {
  const { vertices_mm: v, vertex_times_ps: times } = payload.truth;
  const out = [];
  for (let k = 0; k + 1 < v.length; k += 1) {
    for (let i = 0; i <= 24; i += 1) {
      const p = [0, 1, 2].map((q) => lerp(v[k][q], v[k + 1][q], i / 24));
      const t = lerp(times[k], times[k + 1], i / 24);
      out.push([t - times[0], t + wayBack(p) - path.first_arrival_ps]);
    }
  }
  return out;
}

function drawSpeed(node) {
  if (!hasArrival) { say(node, "No camera: no apparent speed."); return; }
  const x = Array.from(trace.length_mm);
  const real = 1 / path.path_index;
  Plotly.react(node, [
    { x, y: Array.from(trace.apparent_speed), name: "as the camera sees it", mode: "lines", line: { color: color("arrival"), width: 2.5 } },
    { x: [x[0], x[x.length - 1]], y: [real, real], name: "of the light", mode: "lines", line: { color: color("event"), width: 2 } },
  ], graphLayout("length of path (mm)", "speed (c)", { yaxis: { rangemode: "tozero" } }), graphOptions);
  addCursor(node, () => lengthAt(current().t));
}

function drawResiduals(node) {
  const at = pulses ? [...pulses.leg.keys()].filter((i) => pulses.leg[i] >= 0 && Number.isFinite(pulses.residual_ps[i])) : [];
  if (!at.length) { say(node, "The path carries no residuals."); return; }
  if (residualsAs === "map" && payload.camera) { drawResidualMap(node, at); return; }
  if (at.length > 4000) { drawManyResiduals(node, at); return; }
  const errors = at.map((i) => pulses.std_ps[i]).sort((a, b) => a - b);
  const typical = errors[Math.floor(errors.length / 2)];
  const used = at.filter((i) => pulses.used[i]);
  const values = used.filter((i) => pulses.std_ps[i] <= 3 * typical).map((i) => Math.abs(pulses.residual_ps[i]) + pulses.std_ps[i]).sort((a, b) => a - b);
  const limit = values.length ? 1.15 * values[Math.floor(0.99 * (values.length - 1))] : undefined;
  const one = (list, options) => ({ type: "scatter", mode: "markers",
    x: list.map((i) => pulses.length_mm[i]), y: list.map((i) => pulses.residual_ps[i]),
    text: list.map((i) => `row ${pulses.row[i]}, column ${pulses.col[i]}, leg ${pulses.leg[i] + 1}<br>`
      + `${withError(pulses.residual_ps[i], pulses.std_ps[i])} ps`), hoverinfo: "text",
    error_y: { type: "data", array: list.map((i) => pulses.std_ps[i]), thickness: 1, width: 0, color: color("hair") }, ...options });
  const out = at.filter((i) => !pulses.used[i]);
  const vague = used.filter((i) => !(pulses.std_ps[i] <= 3 * typical));
  const precise = used.filter((i) => pulses.std_ps[i] <= 3 * typical);
  const data = [one(vague, { marker: { size: 3.5, color: color("quiet"), opacity: 0.45 }, name: "imprecise" }),
    one(precise, { marker: { size: 4.5, color: color("arrival") }, name: "used" })];
  if (out.length) data.push(one(out, { marker: { size: 6, symbol: "x-thin", line: { width: 1.5, color: color("event") } }, name: `left out (${out.length})` }));
  Plotly.react(node, data, graphLayout("length of path (mm)", "measured − model (ps)",
    { yaxis: limit ? { range: [-limit, limit] } : {}, showlegend: out.length > 0 }), graphOptions);
  if (node.removeAllListeners) node.removeAllListeners("plotly_hover");
  node.on("plotly_hover", (event) => {
    const i = [vague, precise, out][event.points[0].curveNumber][event.points[0].pointNumber];
    if (eye === 0) selectPixel(pulses.row[i], pulses.col[i]);
  });
  addCursor(node, () => lengthAt(current().t));
}

// More pulses than marks make sense for: how many lie where.
function drawManyResiduals(node, at) {
  const used = at.filter((i) => pulses.used[i]);
  const sizes = used.map((i) => Math.abs(pulses.residual_ps[i])).sort((a, b) => a - b);
  const limit = 1.3 * (sizes[Math.floor(0.98 * (sizes.length - 1))] || 1);
  const length = legStarts[nLegs];
  Plotly.react(node, [{ type: "histogram2d", x: used.map((i) => pulses.length_mm[i]), y: used.map((i) => pulses.residual_ps[i]),
    xbins: { start: 0, end: length, size: length / 150 }, ybins: { start: -limit, end: limit, size: limit / 30 },
    colorscale: [[0, color("card")], [1, color("arrival")]], colorbar: { title: { text: "pulses" }, thickness: 10, outlinewidth: 0, tickfont: { color: color("quiet") } },
    hovertemplate: "%{z} pulses<extra></extra>" }],
  graphLayout("length of path (mm)", "measured − model (ps)", { yaxis: { range: [-limit, limit] } }), graphOptions);
  addCursor(node, () => lengthAt(current().t));
}

function drawResidualMap(node, at) {
  const [height, width] = payload.camera.shape;
  const z = Array.from({ length: height }, () => new Array(width).fill(null));
  for (const i of at) if (pulses.used[i]) z[pulses.row[i]][pulses.col[i]] = pulses.residual_ps[i];
  const sizes = z.flat().filter((v) => v !== null).map(Math.abs).sort((a, b) => a - b);
  const limit = sizes[Math.floor(0.95 * (sizes.length - 1))] || 1;
  removeCursor(node);
  Plotly.react(node, [{ type: "heatmap", z, zmin: -limit, zmax: limit, colorscale: "PuOr", reversescale: true, hoverongaps: false,
    hovertemplate: "row %{y}, column %{x}<br>%{z:.2f} ps<extra></extra>", colorbar: { title: { text: "ps" }, thickness: 10, outlinewidth: 0, tickfont: { color: color("quiet") } } }],
  graphLayout("column", "row", { yaxis: { autorange: "reversed", scaleanchor: "x", constrain: "domain" }, xaxis: { constrain: "domain" } }), graphOptions);
}

function addCursor(node, where) {
  removeCursor(node);
  const bar = element("div", undefined, node);
  bar.className = "cursor";
  graphs[node.id].moveCursor = () => {
    const layout = node._fullLayout;
    if (!layout || !layout.xaxis) return;
    const x = layout.xaxis.l2p(where());
    const inside = Number.isFinite(x) && x >= 0 && x <= layout.xaxis._length;
    bar.style.display = inside ? "" : "none";
    bar.style.left = `${layout.xaxis._offset + x - 1}px`;
    bar.style.top = `${layout.yaxis._offset}px`;
    bar.style.height = `${layout.yaxis._length}px`;
    bar.style.bottom = "auto";
  };
  graphs[node.id].moveCursor();
}

function removeCursor(node) {
  for (const old of node.querySelectorAll(":scope > .cursor")) old.remove();
  graphs[node.id].moveCursor = null;
}

function drawClockCard(node) {
  const clock = payload.clock;
  const facts = document.getElementById("clock-facts");
  facts.replaceChildren();
  if (!clock) { say(node, "No timing calibration was given: see what rests on what."); return; }
  const fact = (name, text) => { element("dt", name, facts); element("dd", text, facts); };
  fact("mean code", `${show(clock.bin_width_ps, 3, "ps")} (shared scale error ${show(100 * clock.scale_std, 2)}\u202f%)`);
  fact("gain of the pixels", `differs by ${show(100 * clock.gain_std, 2)}\u202f% rms`);
  fact("their delays", `differ by ${show(clock.delay_std_ps, 1, "ps")} rms`);
  if (clock.response_std_ps) fact("response", `${show(2.3548 * clock.response_std_ps, 1, "ps")} FWHM`);
  fact("usable", `${clock.usable} of ${clock.pixels} pixels`);
  const reasons = Object.entries(clock.reasons).map(([name, n]) => `${name.replaceAll("_", " ")} ${n}`);
  if (reasons.length) fact("flagged", reasons.join(", "));
  if (!clock.phases) { node.style.display = "none"; return; }
  Plotly.react(node, [{ type: "bar", x: clock.phases.map((_, k) => k), y: clock.phases.map((w) => w - 1),
    base: 1, marker: { color: color("arrival") }, hovertemplate: "phase %{x}: %{customdata:.3f}<extra></extra>", customdata: clock.phases }],
  graphLayout(`code modulo ${clock.phases.length}`, "relative width", { xaxis: { dtick: clock.phases.length > 16 ? undefined : 1 } }), graphOptions);
}

// --- one pixel -----------------------------------------------------------------------------

function indexHistograms() {
  if (!payload.histograms || pixelIndex.size) return;
  const index = unpackTable(Object.fromEntries(["row", "col", "n", "start", "fit", "total"].map((k) => [k, payload.histograms[k]])));
  let at = 0;
  for (let i = 0; i < index.row.length; i += 1) {
    pixelIndex.set(index.row[i] * payload.camera.shape[1] + index.col[i], { at, n: index.n[i], start: index.start[i],
      fit: Array.from(index.fit.slice(4 * i, 4 * i + 4)), total: index.total[i] });
    at += index.n[i];
  }
  blobWait = unzip(payload.histograms.gzip).then((buffer) => {
    blob = { widths: new Uint16Array(buffer, 0, at),
      counts: new KINDS[payload.histograms.counts_kind](buffer.slice(2 * at)) };
  });
}

function normalCdf(z) {
  // Abramowitz and Stegun 7.1.26 on erf: off by at most 1e-7, far below a pixel on the screen.
  const t = 1 / (1 + 0.3275911 * Math.abs(z) / Math.SQRT2);
  const poly = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
  const tail = 0.5 * poly * Math.exp(-z * z / 2);
  return z > 0 ? 1 - tail : tail;
}

let pixelWanted = null;

async function showPixel(row, col) {
  pixelWanted = [row, col];
  indexHistograms();
  if (blobWait) await blobWait;
  if (!pixelWanted || pixelWanted[0] !== row || pixelWanted[1] !== col) return;
  document.getElementById("pixel-title").textContent = `Pixel: row ${row}, column ${col}`;
  if (eye !== 0) {
    computedPixel(row, col);
    return;
  }
  pixelFacts(row, col);
  drawHistogram(row, col);
}

// A pixel of the second viewpoint: nobody recorded it, so it has times but no counts.
function computedPixel(row, col) {
  const facts = document.getElementById("pixel-facts");
  facts.replaceChildren();
  const fact = (name, text) => { element("dt", name, facts); element("dd", text, facts); };
  let found = 0;
  for (let i = 0; i < lights.row.length; i += 1) {
    if (lights.row[i] !== row || lights.col[i] !== col) continue;
    fact(`pulse on leg ${lights.leg[i] + 1}`, `event time ${show(lights.event_ps[i], 1, "ps")}`);
    fact("arrival since vertex 0", show(lights.arrival_ps[i], 1, "ps"));
    found += 1;
  }
  if (!found) fact("pulses", "none");
  say(document.getElementById("pixel-plot"), "A computed view, for light scattered equally in all directions: no histograms.");
}

function pixelFacts(row, col) {
  const facts = document.getElementById("pixel-facts");
  facts.replaceChildren();
  const fact = (name, text) => { element("dt", name, facts); element("dd", text, facts); };
  const entry = pixelIndex.get(row * cols + col);
  if (entry) fact("counts", String(entry.total));
  const mine = pulses ? [...pulses.row.keys()].filter((i) => pulses.row[i] === row && pulses.col[i] === col) : [];
  if (!mine.length) fact("pulses", "none");
  for (const i of mine.slice(0, 3)) {
    fact(pulses.leg[i] >= 0 ? `pulse on leg ${pulses.leg[i] + 1}` : "pulse on no leg", `${show(pulses.photons[i], 0)} photons`);
    fact("arrival since vertex 0", withError(pulses.arrival_ps[i], pulses.std_ps[i], "ps"));
    if (Number.isFinite(pulses.residual_ps[i])) {
      fact("residual", `${withError(pulses.residual_ps[i], pulses.std_ps[i], "ps")}${pulses.used[i] ? "" : ", left out"}`);
    }
    const names = flagNames(pulses.flags[i]);
    if (names.length) fact("flags", names.join(", "));
  }
}

function drawHistogram(row, col) {
  const node = document.getElementById("pixel-plot");
  const entry = pixelIndex.get(row * cols + col);
  if (!payload.histograms) { say(node, "No recording was given with this page: no histograms."); return; }
  if (!entry || !entry.n) { say(node, "This pixel's histogram found no room in the page."); return; }
  node.classList.remove("quiet");
  if (!node._fullLayout) node.textContent = "";
  const edges = [entry.start];
  const counts = [];
  for (let i = 0; i < entry.n; i += 1) {
    edges.push(edges[i] + blob.widths[entry.at + i] * payload.histograms.width_unit);
    counts.push(blob.counts[entry.at + i]);
  }
  const widths = counts.map((_, i) => edges[i + 1] - edges[i]);
  const data = [{ type: "bar", x: widths.map((w, i) => edges[i] + w / 2), y: counts, width: widths, marker: { color: color("arrival"), opacity: 0.35 },
    name: "counts", hovertemplate: "%{y} counts<extra></extra>" }];
  const [delay, std, photons, background] = entry.fit;
  if (Number.isFinite(delay)) {
    const expected = counts.map((_, i) => photons * (normalCdf((edges[i + 1] - delay) / std) - normalCdf((edges[i] - delay) / std))
      + (Number.isFinite(background) ? background : 0) * widths[i]);
    data.push({ type: "scatter", mode: "lines", x: edges, y: [...expected, expected[expected.length - 1]], line: { shape: "hv", color: color("arrival"), width: 2 }, name: "fit", hoverinfo: "skip" });
    const top = Math.max(...counts);
    data.push({ type: "scatter", mode: "lines", x: [delay, delay], y: [0, 1.08 * top], line: { color: color("event"), width: 1.5 }, hoverinfo: "skip", name: "centre" });
  }
  Plotly.react(node, data, graphLayout(`delay after the laser sync (${payload.histograms.unit})`, "counts per bin", { showlegend: false, bargap: 0 }), graphOptions);
}
