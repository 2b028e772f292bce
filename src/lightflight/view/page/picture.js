// The camera's picture: photons of every pixel, over them the light of one moment and the legs.

const pictureNode = document.getElementById("picture");
const lightCanvas = document.getElementById("picture-light");
const lineCanvas = document.getElementById("picture-lines");
const axesCanvas = document.getElementById("picture-axes");
const AROUND = { left: 38, right: 62, top: 8, bottom: 36 }; // px of the page, as the style has it
let rows = camera ? camera.shape[0] : 0;
let cols = camera ? camera.shape[1] : 0;
let lights = pulses;
let cursorPixel = null;
let photonSum = null; // photons of every pixel, all its pulses together
let mostPhotons = 1;
let brightest = 1;
let typicalWidth = path.pulse_fwhm_ps / 2.3548;

// A colour of the page, which its style writes as #rrggbb.
function rgb(name) {
  const hex = color(name);
  return [1, 3, 5].map((i) => Number.parseInt(hex.slice(i, i + 2), 16));
}

function preparePicture() {
  if (!camera) {
    document.getElementById("picture-card").hidden = true;
    return;
  }
  pictureNode.style.aspectRatio = `${cols} / ${rows}`;
  lightCanvas.width = cols;
  lightCanvas.height = rows;
  brightest = 1;
  typicalWidth = path.pulse_fwhm_ps / 2.3548;
  photonSum = new Float32Array(rows * cols);
  if (!lights) return;
  for (let i = 0; i < lights.row.length; i += 1) {
    // A pulse of unknown size still was light: it counts as one photon.
    photonSum[lights.row[i] * cols + lights.col[i]] += lights.photons[i] > 0 ? lights.photons[i] : 1;
  }
  // One screaming pixel must not darken all others: the brightest hundredth is drawn alike.
  const sums = photonSum.filter((x) => x > 0).sort();
  mostPhotons = sums.length ? sums[Math.floor(0.99 * (sums.length - 1))] : 1;
  const photons = Array.from(lights.photons).filter((x) => x > 0).sort((a, b) => a - b);
  brightest = photons.length ? photons[Math.floor(0.98 * (photons.length - 1))] : 1;
  const widths = Array.from(lights.width_ps).filter((x) => x > 0).sort((a, b) => a - b);
  if (widths.length) typicalWidth = widths[Math.floor(widths.length / 2)];
}

// How dark a number of photons is drawn, 0 … 1: by its root, so that faint pixels show.
const shade = (photons) => Math.sqrt(Math.min(1, Math.max(0, photons) / mostPhotons));

// Light of every pixel at a moment of a clock, 0 … 1 of the brightest pixel's peak.
function lightAt(clock, moment) {
  const light = new Float32Array(rows * cols);
  if (!lights) return light;
  const when = clock === "event" ? lights.event_ps : lights.arrival_ps;
  for (let i = 0; i < when.length; i += 1) {
    const z = (moment - when[i]) / (lights.width_ps[i] > 0 ? lights.width_ps[i] : typicalWidth);
    if (z > 4 || z < -4 || Number.isNaN(z)) continue;
    const strength = lights.photons[i] > 0 ? lights.photons[i] / brightest : 0.5;
    light[lights.row[i] * cols + lights.col[i]] += strength * Math.exp(-0.5 * z * z);
  }
  return light;
}

function drawPicture(now) {
  if (!camera) return;
  const context = lightCanvas.getContext("2d");
  const [none, most, full] = ["wash", "photons", "accent"].map(rgb);
  const image = context.createImageData(cols, rows);
  const light = lightAt(now.clock, now.elapsed);
  for (let p = 0; p < rows * cols; p += 1) {
    const ground = photonSum[p] > 0 ? 0.12 + 0.88 * shade(photonSum[p]) : 0;
    const f = light[p] > 0.002 ? Math.min(1, light[p]) ** 0.6 : 0;
    for (let k = 0; k < 3; k += 1) image.data[4 * p + k] = lerp(lerp(none[k], most[k], ground), full[k], f);
    image.data[4 * p + 3] = 255;
  }
  context.putImageData(image, 0, 0);
  drawPictureLines(now);
}

// Rows, columns, and what shade is how many photons: drawn anew when the size or the theme changes.
function drawPictureAxes() {
  if (!camera) return;
  const [wide, tall] = [pictureNode.clientWidth, pictureNode.clientHeight];
  const width = wide + AROUND.left + AROUND.right;
  const g = clearedCanvas(axesCanvas, width, tall + AROUND.top + AROUND.bottom);
  const ink = inkNow();
  g.font = "11px system-ui, sans-serif";
  const box = { left: AROUND.left, top: AROUND.top, right: AROUND.left + wide, bottom: AROUND.top + tall };
  const toX = (col) => box.left + (col + 0.5) * wide / cols;
  const toY = (row) => box.top + (row + 0.5) * tall / rows;
  const whole = (n, length, room) => { const all = ticksBetween(0, n - 1, Math.max(1, length / room)).filter(Number.isInteger); return all.length ? all : [0]; };
  drawPlotAxes(g, { box, toX, toY, xTicks: whole(cols, wide, 44), yTicks: whole(rows, tall, 34), xStep: 1, yStep: 1 },
    { x: "column", y: "row" }, { ...ink, hair: "transparent" });
  if (!lights || !lights.row.length) return;
  const [none, most] = ["wash", "photons"].map(rgb);
  const colorAt = (f) => `rgb(${[0, 1, 2].map((k) => Math.round(lerp(none[k], most[k], f > 0 ? 0.12 + 0.88 * Math.sqrt(f) : 0))).join(" ")})`;
  drawScale(g, { title: eye === 0 ? "photons" : "light", low: 0, high: mostPhotons, colorAt }, { box }, ink, width);
}

function drawPictureLines(now) {
  const scale = window.devicePixelRatio || 1;
  const width = pictureNode.clientWidth;
  const height = pictureNode.clientHeight;
  if (lineCanvas.width !== Math.round(width * scale) || lineCanvas.height !== Math.round(height * scale)) {
    lineCanvas.width = Math.round(width * scale);
    lineCanvas.height = Math.round(height * scale);
  }
  const g = lineCanvas.getContext("2d");
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.clearRect(0, 0, width, height);
  const at = (row, col) => [(col + 0.5) * width / cols, (row + 0.5) * height / rows];
  g.beginPath();
  for (let i = 0; i < trace.leg.length; i += 1) {
    const [x, y] = at(trace.pixel[2 * i], trace.pixel[2 * i + 1]);
    if (i && trace.leg[i] === trace.leg[i - 1]) g.lineTo(x, y); else g.moveTo(x, y);
  }
  // A light rim, so that it shows on dark pixels too; of many legs it would hide the pixels.
  g.globalAlpha = nLegs > 12 ? 0.4 : 1;
  for (const [name, width] of nLegs > 12 ? [["ink", 0.7]] : [["card", 2.5], ["ink", 1]]) {
    g.strokeStyle = color(name);
    g.lineWidth = width;
    g.stroke();
  }
  g.globalAlpha = 1;
  if (now.pixel) {
    const [x, y] = at(...now.pixel);
    g.strokeStyle = color("accent");
    g.lineWidth = 2;
    g.beginPath();
    g.arc(x, y, 8, 0, 2 * Math.PI);
    g.stroke();
  }
  if (cursorPixel) {
    const [x, y] = at(cursorPixel[0] - 0.5, cursorPixel[1] - 0.5);
    g.strokeStyle = color("ink");
    g.lineWidth = 1.5;
    g.strokeRect(x, y, width / cols, height / rows);
  }
}

// Where the path's point of event time t is in the picture; interpolated in the trace.
function pixelOnPath(t) {
  if (!camera || !way.points.length) return null;
  const [a, b, share] = betweenPoints(t);
  const f = Math.min(1, Math.max(0, share));
  const pixel = [0, 1].map((k) => lerp(trace.pixel[2 * a + k], trace.pixel[2 * b + k], f));
  const seen = pixel[0] >= -0.5 && pixel[0] <= rows - 0.5 && pixel[1] >= -0.5 && pixel[1] <= cols - 0.5;
  return seen ? pixel : null;
}

function selectPixel(row, col) {
  if (!camera) return;
  cursorPixel = [Math.min(rows - 1, Math.max(0, row)), Math.min(cols - 1, Math.max(0, col))];
  drawPictureLines(current());
  showPixel(...cursorPixel);
}

function preparePictureEvents() {
  if (!camera) return;
  pictureNode.addEventListener("pointermove", (event) => {
    const frame = pictureNode.getBoundingClientRect();
    const col = Math.floor((event.clientX - frame.left) / frame.width * cols);
    const row = Math.floor((event.clientY - frame.top) / frame.height * rows);
    if (!cursorPixel || row !== cursorPixel[0] || col !== cursorPixel[1]) selectPixel(row, col);
  });
  pictureNode.addEventListener("pointerdown", (event) => pictureNode.dispatchEvent(new PointerEvent("pointermove", event)));
  pictureNode.addEventListener("keydown", (event) => {
    const step = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const from = cursorPixel || [Math.floor(rows / 2), Math.floor(cols / 2)];
    selectPixel(from[0] + step[0], from[1] + step[1]);
  });
}

// --- a second viewpoint: what another camera would see of the same path --------------------------

const eyes = [{ camera, first: path.first_arrival_ps, lights: pulses,
  trace: Object.fromEntries(["arrival_ps", "pixel", "in_view", "apparent_speed", "back_ps"].map((k) => [k, trace[k]])) }];
if (payload.second) {
  eyes.push({ camera: payload.second.camera, first: payload.second.first_arrival_ps,
    lights: unpackTable(payload.second.lights), trace: unpackTable(payload.second.trace) });
}
let eye = 0;

// The event stays the same; everything that depends on who looks changes. The caller redraws.
function useEye(number) {
  eye = number;
  const chosen = eyes[eye];
  camera = chosen.camera;
  lights = chosen.lights;
  path.first_arrival_ps = chosen.first;
  Object.assign(trace, chosen.trace);
  hasArrival = Boolean(camera) && nLegs > 0 && path.first_arrival_ps !== null;
  arrivalEnd = hasArrival ? arrivalFromEvent(eventEnd) : 0;
  rows = camera ? camera.shape[0] : 0;
  cols = camera ? camera.shape[1] : 0;
  cursorPixel = null;
  preparePicture();
}
