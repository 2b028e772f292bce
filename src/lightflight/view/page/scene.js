// The path in space (Plotly's 3D axes) with the pulse on it.

const sceneNode = document.getElementById("space");
let sceneReady = false;
let pulseTraces = [];
let tubeFactor = 1;
let sceneView = "path";

function webglWorks() {
  try {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  } catch {
    return false;
  }
}

const columns = (points) => [0, 1, 2].map((i) => points.map((p) => p[i]));

function lineTrace(points, options) {
  const [x, y, z] = columns(points);
  return { type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip", showlegend: false, ...options };
}

function tracePoints(keep) {
  const out = [];
  const n = trace.leg.length;
  for (let i = 0; i < n; i += 1) {
    const p = [0, 1, 2].map((k) => trace.points_mm[3 * i + k]);
    out.push(keep(i) ? p : [null, null, null]);
  }
  return out;
}

function pathTexts() {
  const texts = [];
  for (let i = 0; i < trace.leg.length; i += 1) {
    const [x, y, z] = [0, 1, 2].map((k) => withError(trace.points_mm[3 * i + k], trace.std[4 * i + k]));
    texts.push(`x ${x} mm<br>y ${y} mm<br>z ${z} mm<br>`
      + `event time ${withError(trace.event_ps[i], trace.std[4 * i + 3])} ps<br>`
      + `arrival time ${show(trace.arrival_ps[i], 1)} ps<br>leg ${trace.leg[i] + 1}`);
  }
  return texts;
}

function niceFactor(ratio) {
  if (!(ratio > 1)) return 1;
  const power = 10 ** Math.floor(Math.log10(ratio));
  return Math.max(...[1, 2, 5].map((s) => s * power).filter((s) => s <= ratio * 1.0001));
}

function tubeMesh() {
  if (!trace.half_axes_mm) return null;
  const n = trace.leg.length;
  const sides = 10;
  const radius = [];
  for (let i = 0; i < n; i += 1) radius.push(Math.hypot(...trace.half_axes_mm.slice(6 * i, 6 * i + 3)));
  const sorted = radius.filter(Number.isFinite).sort((a, b) => a - b);
  const typical = sorted[Math.floor(sorted.length / 2)];
  if (!(typical > 0)) return null;
  const sizes = [0, 1, 2].map((k) => {
    const values = vertices.map((v) => v[k]);
    return Math.max(...values) - Math.min(...values);
  });
  tubeFactor = niceFactor(0.02 * Math.max(...sizes) / typical);
  const mesh = { x: [], y: [], z: [], i: [], j: [], k: [] };
  for (let p = 0; p < n; p += 1) {
    for (let s = 0; s < sides; s += 1) {
      const a = 2 * Math.PI * s / sides;
      const point = [0, 1, 2].map((q) => trace.points_mm[3 * p + q] + tubeFactor
        * (Math.cos(a) * trace.half_axes_mm[6 * p + q] + Math.sin(a) * trace.half_axes_mm[6 * p + 3 + q]));
      mesh.x.push(point[0]); mesh.y.push(point[1]); mesh.z.push(point[2]);
      if (p + 1 < n && trace.leg[p + 1] === trace.leg[p]) {
        const here = p * sides + s;
        const beside = p * sides + (s + 1) % sides;
        mesh.i.push(here, beside); mesh.j.push(beside, beside + sides); mesh.k.push(here + sides, here + sides);
      }
    }
  }
  return { type: "mesh3d", ...mesh, opacity: 0.22, hoverinfo: "skip", showscale: false,
    lighting: { ambient: 0.9, diffuse: 0.2 }, name: "error tube" };
}

// The square a flat mirror at corner k would fill.
function mirrorCorners(k, size) {
  const unit = (v) => { const n = Math.hypot(...v); return v.map((x) => x / n); };
  const minus = (a, b) => a.map((x, i) => x - b[i]);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const normal = unit(minus(unit(minus(vertices[k + 1], vertices[k])), unit(minus(vertices[k], vertices[k - 1]))));
  const up0 = Math.abs(normal[1]) > 0.95 ? [0, 0, 1] : [0, 1, 0];
  const side = unit(cross(up0, normal));
  const up = cross(normal, side);
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => vertices[k].map(
    (x, i) => x + size / 2 * (a * side[i] + b * up[i])));
}

function mirrorMesh(size) {
  const mesh = { x: [], y: [], z: [], i: [], j: [], k: [] };
  for (let k = 1; k < nLegs; k += 1) {
    const corners = mirrorCorners(k, size);
    if (!corners.flat().every(Number.isFinite)) continue;
    const at = mesh.x.length;
    for (const p of corners) { mesh.x.push(p[0]); mesh.y.push(p[1]); mesh.z.push(p[2]); }
    mesh.i.push(at, at); mesh.j.push(at + 1, at + 2); mesh.k.push(at + 2, at + 3);
  }
  return mesh.x.length ? { type: "mesh3d", ...mesh, opacity: 0.9, hoverinfo: "skip" } : null;
}

function extentOf(points) {
  return [0, 1, 2].map((i) => {
    const values = points.filter((p) => p.every(isFiniteNumber)).map((p) => p[i]);
    return values.length ? [Math.min(...values), Math.max(...values)] : [-1, 1];
  });
}

function paddedBox(points, share) {
  const extent = extentOf(points);
  const size = Math.max(...extent.map(([a, b]) => b - a), 1);
  return extent.map(([a, b]) => {
    const pad = Math.max(0.04 * size, (share * size - (b - a)) / 2);
    return [a - pad, b + pad];
  });
}

const pathPoints = vertices.concat(payload.truth ? payload.truth.vertices_mm : []);
const boxes = {
  path: paddedBox(pathPoints, 0.24),
  scene: paddedBox(pathPoints.concat([payload.camera, payload.second && payload.second.camera].flatMap((c) => (c ? [c.center_mm, ...c.field_mm] : []))), 0.12),
};
const sizeOf = (box) => Math.max(...box.map(([a, b]) => b - a));

// Axes and eye of a point of view, in Plotly's units: the longest side of the box is 1.
function viewOf(name) {
  const box = name === "path" ? boxes.path : boxes.scene;
  const size = sizeOf(box);
  const aspect = box.map(([a, b]) => (b - a) / size);
  const inUnits = (p) => p.map((x, i) => (x - (box[i][0] + box[i][1]) / 2) / size);
  const ratio = sceneNode.clientWidth / Math.max(sceneNode.clientHeight, 1);
  // Far enough for the box to fit: Plotly's eye sees 45 degrees upright, whatever the width.
  const fitted = (toEye) => {
    const unit = toEye.map((x) => x / Math.hypot(...toEye));
    const level = Math.hypot(unit[0], unit[2]);
    const across = (aspect[0] * Math.abs(unit[2]) + aspect[2] * Math.abs(unit[0])) / level;
    const deep = (aspect[0] * Math.abs(unit[0]) + aspect[2] * Math.abs(unit[2])) / level;
    const upright = aspect[1] * level + deep * Math.abs(unit[1]);
    const distance = 0.5 * deep + 1.14 * Math.max(upright, across / ratio);
    return unit.map((x) => x * distance);
  };
  let center = [-0.02, -0.03, 0];
  let eye = fitted(name === "path" ? [-0.46, 0.34, 0.82] : [-0.75, 0.42, 0.62]);
  if (name === "camera" && camera) {
    center = inUnits(extentOf(pathPoints).map(([a, b]) => (a + b) / 2));
    eye = inUnits(camera.center_mm).map((x, i) => center[i] + (x - center[i]) * 0.98);
  }
  const xyz = (v) => ({ x: v[0], y: v[1], z: v[2] });
  return { box, aspect: xyz(aspect), camera: { eye: xyz(eye), center: xyz(center), up: { x: 0, y: 1, z: 0 } } };
}

function axisStyle(name, range) {
  return { title: { text: `${name} (mm)`, font: { size: 12, color: color("quiet") } },
    color: color("quiet"), gridcolor: color("hair"), zeroline: false, showbackground: true,
    backgroundcolor: color("wash"), tickfont: { size: 10.5, color: color("quiet") }, nticks: 6,
    range, showspikes: false };
}

function buildTraces() {
  const out = [];
  const tube = tubeMesh();
  if (tube) out.push({ ...tube, color: color("event") });
  const mirrors = mirrorMesh(0.06 * sizeOf(boxes.path));
  if (mirrors) out.push({ ...mirrors, color: color("mirror") });
  if (camera) {
    const gap = [null, null, null];
    const rays = [0, 8, 16, 24].flatMap((i) => [camera.center_mm, camera.field_mm[i], gap]);
    out.push(lineTrace(rays, { line: { color: color("arrival"), width: 1.5 }, opacity: 0.4 }));
    out.push(lineTrace(camera.field_mm, { line: { color: color("arrival"), width: 2.5 }, opacity: 0.6 }));
    out.push({ type: "scatter3d", mode: "markers+text", x: [camera.center_mm[0]], y: [camera.center_mm[1]],
      z: [camera.center_mm[2]], text: [eye === 0 ? "camera" : "second camera"], textposition: "top center", hoverinfo: "skip",
      textfont: { color: color("ink"), size: 12 }, showlegend: false,
      marker: { symbol: "square", size: 6, color: color("ink") } });
  }
  if (payload.truth) {
    out.push(lineTrace(payload.truth.vertices_mm, { name: "truth",
      line: { color: color("truth"), width: 3, dash: "dash" } }));
  }
  if (nLegs) {
    const [x, y, z] = columns(tracePoints(() => true));
    out.push({ type: "scatter3d", mode: "lines+markers", x, y, z, text: pathTexts(), hoverinfo: "text",
      line: { color: color("event"), width: 2 }, marker: { size: 2, color: color("event"), opacity: 0.01 },
      showlegend: false, name: "path" });
    out.push(lineTrace(tracePoints((i) => trace.in_view[i] === 1), { line: { color: color("event"), width: 6 },
      opacity: 0.55, name: "in view" }));
    const names = vertices.map((_, k) => (k === 0 ? (path.source_known ? "source" : "entry")
      : k === nLegs ? "exit" : nLegs <= 12 ? `M${k}` : ""));
    const [vx, vy, vz] = columns(vertices);
    out.push({ type: "scatter3d", mode: "markers+text", x: vx, y: vy, z: vz, text: names, hoverinfo: "skip",
      textposition: "top center", textfont: { color: color("ink"), size: 12 }, showlegend: false,
      marker: { size: vertices.map((_, k) => (k === 0 ? 5 : 2)), color: color("ink") } });
  }
  const first = out.length;
  out.push(lineTrace([[null, null, null]], { name: "to the camera", line: { color: color("arrival"), width: 2, dash: "dot" } }));
  out.push(lineTrace([[null, null, null]], { name: "pulse", line: { color: color("accent"), width: 15 } }));
  out.push({ type: "scatter3d", mode: "markers", x: [null], y: [null], z: [null], hoverinfo: "skip",
    name: "pulse centre", showlegend: false, marker: { size: 6, color: color("accent"), line: { color: color("card"), width: 1.5 } } });
  out.push({ type: "scatter3d", mode: "markers", x: [null], y: [null], z: [null], hoverinfo: "skip",
    name: "other clock", showlegend: false, marker: { symbol: "circle-open", size: 7, color: color("quiet"), line: { width: 2 } } });
  pulseTraces = [first, first + 1, first + 2, first + 3];
  return out;
}

async function drawScene() {
  if (!webglWorks()) {
    sceneNode.textContent = "This browser draws no WebGL: the space view is off. Everything else works.";
    return;
  }
  const data = buildTraces();
  const view = viewOf(sceneView);
  await Plotly.react(sceneNode, data, { margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)",
    uirevision: "keep", showlegend: false, hoverlabel: { bgcolor: color("card"), font: { color: color("ink"), size: 12.5 } },
    scene: { xaxis: axisStyle("x", view.box[0]), yaxis: axisStyle("y", view.box[1]), zaxis: axisStyle("z", view.box[2]),
      aspectmode: "manual", aspectratio: view.aspect, camera: view.camera, dragmode: "orbit" } },
  { displaylogo: false, responsive: true, displayModeBar: false });
  sceneReady = true;
  const parts = [];
  if (trace.half_axes_mm && tubeFactor >= 1) {
    parts.push(`Tubes: one standard deviation${tubeFactor > 1 ? `, enlarged ${tubeFactor}×` : ""}.`);
  }
  parts.push(`Pulse ${show(path.pulse_fwhm_ps, 0, "ps")} long${path.pulse_fwhm_known ? "" : " (assumed)"}: `
    + `${show(path.pulse_fwhm_ps * C / path.path_index, 1, "mm")} in flight.`);
  parts.push("Ring: the other clock's pulse at the same reading. Drag to turn, scroll to zoom.");
  document.getElementById("scene-note").textContent = parts.join(" ");
}

let sceneBusy = false;
let sceneWaiting = null;

async function moveScenePulse(now) {
  if (!sceneReady || !nLegs) return;
  if (sceneBusy) { sceneWaiting = now; return; }
  sceneBusy = true;
  const sight = camera && now.clock === "arrival" ? [now.place, camera.center_mm] : [[null, null, null]];
  const sets = [sight, now.body, [now.place], [now.ghost]].map(columns);
  await Plotly.restyle(sceneNode, { x: sets.map((s) => s[0]), y: sets.map((s) => s[1]), z: sets.map((s) => s[2]),
    "line.color": [color("arrival"), color("accent"), null, null],
    "marker.color": [null, null, color("accent"), color("quiet")] }, pulseTraces);
  sceneBusy = false;
  if (sceneWaiting) {
    const next = sceneWaiting;
    sceneWaiting = null;
    moveScenePulse(next);
  }
}

function setView(name) {
  sceneView = name;
  for (const button of document.querySelectorAll("[data-view]")) {
    button.setAttribute("aria-pressed", String(button.dataset.view === name));
  }
  if (!sceneReady) return;
  const view = viewOf(name);
  Plotly.relayout(sceneNode, { "scene.camera": view.camera, "scene.aspectratio": view.aspect,
    "scene.xaxis.range": view.box[0], "scene.yaxis.range": view.box[1], "scene.zaxis.range": view.box[2] });
}
