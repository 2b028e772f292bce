// One pixel: its histogram with the fit, and what was found in it.

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

const pixelIndex = new Map();
let blob = null;
let blobWait = null;
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
  const edges = [entry.start];
  const counts = [];
  for (let i = 0; i < entry.n; i += 1) {
    edges.push(edges[i] + blob.widths[entry.at + i] * payload.histograms.width_unit);
    counts.push(blob.counts[entry.at + i]);
  }
  const series = [{ kind: "bars", left: edges.slice(0, -1), right: edges.slice(1), y: counts, color: color("arrival"), alpha: 0.35,
    name: "counts", say: (i) => `${counts[i]} counts` }];
  const [delay, std, photons, background] = entry.fit;
  if (Number.isFinite(delay)) {
    const expected = counts.map((_, i) => photons * (normalCdf((edges[i + 1] - delay) / std) - normalCdf((edges[i] - delay) / std))
      + (Number.isFinite(background) ? background : 0) * (edges[i + 1] - edges[i]));
    series.push({ kind: "line", x: counts.flatMap((_, i) => [edges[i], edges[i + 1]]), y: expected.flatMap((v) => [v, v]), color: color("arrival"), width: 2, name: "fit" });
    series.push({ kind: "line", x: [delay, delay], y: [0, 1.05 * Math.max(...counts, ...expected)], color: color("event"), width: 1.5, name: "centre" });
  }
  plotIn(node, { x: `delay after the laser sync (${payload.histograms.unit})`, y: "counts per bin", zero: true, series });
}
