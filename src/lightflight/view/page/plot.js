// Small plots on a canvas: axes, lines, dots with errors, bars and cells; pointed at, zoomed.
// A plot is { x, y, series, ... }: titles of its axes and what to draw. Ranges may be given as
// xRange and yRange. A series is { kind, x, y, color, name, say } with what its kind needs beside.

const plots = {}; // by the id of the node: what is drawn there, for the cursor and for tests

function emptyPlot(node) {
  delete plots[node.id];
  node.replaceChildren();
}

function say(node, text) {
  emptyPlot(node);
  node.textContent = text;
  node.classList.add("quiet");
}

// Smallest and largest of lists of numbers, whatever their length.
function spanOf(lists) {
  let [low, high] = [Infinity, -Infinity];
  for (const list of lists) {
    for (const v of list) {
      if (v < low) low = v;
      if (v > high) high = v;
    }
  }
  return high >= low ? [low, high] : [0, 1];
}

function roomy([low, high], share) {
  const pad = share * (high - low) || Math.abs(low) * share || share;
  return [low - pad, high + pad];
}

function plotIn(node, spec) {
  const before = plots[node.id];
  node.classList.remove("quiet");
  node.replaceChildren();
  if (spec.series.some((one) => one.name)) plotLegend(node, spec.series);
  const frame = element("div", undefined, node);
  frame.className = "plot-frame";
  const canvas = element("canvas", undefined, frame);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `Plot: ${spec.y} over ${spec.x}`);
  const tip = element("div", undefined, frame);
  tip.className = "tip";
  tip.hidden = true;
  const bar = element("div", undefined, frame);
  bar.className = "cursor";
  bar.hidden = true;
  const kept = before && before.spec.x === spec.x && before.spec.y === spec.y && spec.keepZoom ? before.zoom : null;
  const plot = { node, frame, canvas, tip, bar, spec, zoom: kept, data: spec.series };
  plots[node.id] = plot;
  drawPlot(plot);
  plotEvents(plot);
  new ResizeObserver(() => { if (plots[node.id] === plot) drawPlot(plot); }).observe(frame);
  return plot;
}

function plotLegend(node, series) {
  const list = element("ul", undefined, node);
  list.className = "legend";
  for (const one of series) {
    if (!one.name) continue;
    const item = element("li", undefined, list);
    const mark = element("i", undefined, item);
    mark.className = `mark ${one.kind}${one.dash ? " dashed" : ""}`;
    mark.style.color = one.color;
    item.append(one.name);
  }
}

function rangesOf({ series, xRange, yRange, zero }) {
  const along = (k) => spanOf(series.flatMap((one) => {
    if (one.kind === "bars") return k === "x" ? [one.left, one.right] : [one.y, [one.base || 0]];
    if (one.kind === "cells") return [[one[k][0], one[k][0] + one[k][1] * one[k][2]]];
    return [one[k]];
  }));
  const flush = series.some((one) => one.kind === "cells" || one.kind === "bars");
  const x = xRange || (flush ? along("x") : roomy(along("x"), 0.02));
  let y = yRange || (series.some((one) => one.kind === "cells") ? along("y") : roomy(along("y"), 0.06));
  if (zero) y = [0, 1.08 * along("y")[1] || 1];
  return { x, y };
}

// Where everything stands: ranges, rectangle of the axes, and the way from a number to a pixel.
function layPlot(plot, g, width, height) {
  const { spec } = plot;
  const { x, y } = plot.zoom || rangesOf(spec);
  const yMost = Math.max(2, Math.floor((height - 50) / 34));
  const yTicks = ticksBetween(...y, yMost);
  const yStep = yTicks.length > 1 ? yTicks[1] - yTicks[0] : 1;
  const widest = Math.max(12, ...yTicks.map((t) => g.measureText(tickText(t, yStep)).width));
  let box = { left: widest + 28, top: 8, right: width - (spec.scale ? 66 : 12), bottom: height - 38 };
  if (spec.square) box = squared(box, x, y);
  const xTicks = ticksBetween(...x, Math.max(2, Math.floor((box.right - box.left) / 62)));
  const toX = (v) => box.left + (v - x[0]) / (x[1] - x[0]) * (box.right - box.left);
  const upright = (v) => (v - y[0]) / (y[1] - y[0]) * (box.bottom - box.top);
  const toY = (v) => (spec.flipped ? box.top + upright(v) : box.bottom - upright(v));
  return { x, y, box, toX, toY, xTicks, yTicks, yStep, xStep: xTicks.length > 1 ? xTicks[1] - xTicks[0] : 1 };
}

// One unit as long along x as along y.
function squared(box, x, y) {
  const f = Math.min((box.right - box.left) / Math.abs(x[1] - x[0]), (box.bottom - box.top) / Math.abs(y[1] - y[0]));
  return { ...box, right: box.left + f * Math.abs(x[1] - x[0]), bottom: box.top + f * Math.abs(y[1] - y[0]) };
}

function drawPlot(plot) {
  const width = Math.max(60, plot.frame.clientWidth);
  const height = Math.max(60, plot.frame.clientHeight);
  const g = clearedCanvas(plot.canvas, width, height);
  g.font = "11px system-ui, sans-serif";
  const ink = inkNow();
  const at = layPlot(plot, g, width, height);
  plot.at = at;
  drawPlotAxes(g, at, plot.spec, ink);
  g.save();
  g.beginPath();
  g.rect(at.box.left, at.box.top, at.box.right - at.box.left, at.box.bottom - at.box.top);
  g.clip();
  for (const one of plot.spec.series) PLOT_KINDS[one.kind](g, one, at, ink);
  g.restore();
  if (plot.spec.scale) drawScale(g, plot.spec.scale, at, ink, width);
  if (plot.moveCursor) plot.moveCursor();
}

function drawPlotAxes(g, at, spec, ink) {
  const { box, toX, toY } = at;
  g.strokeStyle = ink.hair;
  g.lineWidth = 1;
  g.fillStyle = ink.quiet;
  g.beginPath();
  g.textAlign = "center";
  g.textBaseline = "top";
  for (const t of at.xTicks) {
    g.moveTo(toX(t), box.top);
    g.lineTo(toX(t), box.bottom);
    const text = tickText(t, at.xStep);
    // At the rim a number moves inwards rather than off the canvas.
    g.fillText(text, Math.min(toX(t), box.right + 10 - g.measureText(text).width / 2), box.bottom + 5);
  }
  g.textAlign = "right";
  g.textBaseline = "middle";
  for (const t of at.yTicks) {
    g.moveTo(box.left, toY(t));
    g.lineTo(box.right, toY(t));
    g.fillText(tickText(t, at.yStep), box.left - 5, toY(t));
  }
  g.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  g.stroke();
  g.textAlign = "center";
  g.textBaseline = "bottom";
  g.fillText(spec.x, (box.left + box.right) / 2, box.bottom + 37);
  g.save();
  g.translate(11, (box.top + box.bottom) / 2);
  g.rotate(-Math.PI / 2);
  g.textBaseline = "middle";
  g.fillText(spec.y, 0, 0);
  g.restore();
}

// A bar of colours with numbers: { title, low, high, colorAt(0 … 1) }.
function drawScale(g, scale, { box }, ink, width) {
  const left = Math.min(box.right + 10, width - 56);
  const tall = box.bottom - box.top - 16;
  for (let i = 0; i < tall; i += 1) {
    g.fillStyle = scale.colorAt(1 - i / tall);
    g.fillRect(left, box.top + 16 + i, 10, 1.5);
  }
  g.fillStyle = ink.quiet;
  g.textAlign = "left";
  g.textBaseline = "top";
  g.fillText(scale.title, left, box.top - 1);
  // Large numbers would run off the canvas: they are counted in thousands.
  const per = scale.high >= 1e5 ? 1000 : 1;
  g.textBaseline = "middle";
  const ticks = ticksBetween(scale.low, scale.high, Math.max(2, tall / 40));
  const step = ticks.length > 1 ? ticks[1] - ticks[0] : 1;
  for (const t of ticks) g.fillText(tickText(t / per, step / per) + (per > 1 && t ? "k" : ""), left + 14, box.bottom - (t - scale.low) / (scale.high - scale.low) * tall);
}

const PLOT_KINDS = {
  line(g, one, { toX, toY }) {
    g.beginPath();
    let pen = false;
    for (let i = 0; i < one.x.length; i += 1) {
      const good = Number.isFinite(one.x[i]) && Number.isFinite(one.y[i]);
      if (good && pen) g.lineTo(toX(one.x[i]), toY(one.y[i]));
      else if (good) g.moveTo(toX(one.x[i]), toY(one.y[i]));
      pen = good;
    }
    g.setLineDash(one.dash || []);
    g.strokeStyle = one.color;
    g.lineWidth = one.width || 2;
    g.lineJoin = "round";
    g.stroke();
    g.setLineDash([]);
  },
  dots(g, one, { toX, toY }, ink) {
    g.strokeStyle = ink.hair;
    g.lineWidth = 1;
    g.beginPath();
    for (let i = 0; one.error && i < one.x.length; i += 1) {
      g.moveTo(toX(one.x[i]), toY(one.y[i] - one.error[i]));
      g.lineTo(toX(one.x[i]), toY(one.y[i] + one.error[i]));
    }
    g.stroke();
    g.globalAlpha = one.alpha || 1;
    g.fillStyle = one.color;
    g.strokeStyle = one.color;
    g.lineWidth = 1.6;
    g.beginPath();
    for (let i = 0; i < one.x.length; i += 1) {
      const [x, y] = [toX(one.x[i]), toY(one.y[i])];
      const r = one.radius;
      if (one.crossed) {
        g.moveTo(x - r, y - r); g.lineTo(x + r, y + r); g.moveTo(x - r, y + r); g.lineTo(x + r, y - r);
      } else {
        g.moveTo(x + r, y); g.arc(x, y, r, 0, 2 * Math.PI);
      }
    }
    if (one.crossed) g.stroke(); else g.fill();
    g.globalAlpha = 1;
  },
  bars(g, one, { toX, toY }) {
    g.fillStyle = one.color;
    g.globalAlpha = one.alpha || 1;
    const base = toY(one.base || 0);
    for (let i = 0; i < one.y.length; i += 1) {
      const x = toX(one.left[i]);
      g.fillRect(x, Math.min(base, toY(one.y[i])), Math.max(1, toX(one.right[i]) - x - (one.gap || 0)), Math.abs(base - toY(one.y[i])));
    }
    g.globalAlpha = 1;
  },
  // x and y are [start, size, number]; a value that is not finite stays empty.
  cells(g, one, { toX, toY }) {
    const [x0, dx, nx] = one.x;
    const [y0, dy, ny] = one.y;
    for (let j = 0; j < ny; j += 1) {
      for (let i = 0; i < nx; i += 1) {
        const v = one.z[j * nx + i];
        if (!Number.isFinite(v)) continue;
        g.fillStyle = one.colorOf(v);
        const [x, y] = [toX(x0 + i * dx), toY(y0 + j * dy)];
        const [right, end] = [toX(x0 + (i + 1) * dx), toY(y0 + (j + 1) * dy)];
        g.fillRect(x, Math.min(y, end), right - x + 0.3, Math.abs(end - y) + 0.3);
      }
    }
  },
};

// --- pointing and zooming ------------------------------------------------------------------

const FROM_SERIES = {
  line: (one, { toX }, x) => nearestOf(one.x, (v) => Math.abs(toX(v) - x), 20),
  dots: (one, { toX, toY }, x, y) => nearestOf(one.x, (v, i) => Math.hypot(toX(v) - x, toY(one.y[i]) - y), 14),
  bars: (one, { toX }, x) => one.left.findIndex((v, i) => toX(v) <= x && x < toX(one.right[i])),
  cells(one, { toX, toY }, x, y) {
    const along = ([start, size, n], to, at) => Math.min(n - 1, Math.max(0, Math.floor((at - to(start)) / (to(start + size) - to(start)))));
    return along(one.y, toY, y) * one.x[2] + along(one.x, toX, x);
  },
};

function nearestOf(list, apart, most) {
  let best = -1;
  let near = most;
  for (let i = 0; i < list.length; i += 1) {
    const d = apart(list[i], i);
    if (d < near) { near = d; best = i; }
  }
  return best;
}

function pointInPlot(plot, x, y) {
  const { box } = plot.at;
  const inside = x >= box.left && x <= box.right && y >= box.top && y <= box.bottom;
  const lines = inside ? plot.spec.series.map((one) => {
    const i = one.say ? FROM_SERIES[one.kind](one, plot.at, x, y) : -1;
    return i < 0 ? "" : one.say(i);
  }) : [];
  showTip(plot.tip, lines.filter(Boolean).join("\n"), x, y, plot.frame);
}

function plotEvents(plot) {
  const { frame } = plot;
  let from = null;
  const rim = element("div", undefined, frame);
  rim.className = "zoom-rim";
  rim.hidden = true;
  const place = (event) => { const r = frame.getBoundingClientRect(); return [event.clientX - r.left, event.clientY - r.top]; };
  frame.addEventListener("pointerdown", (event) => { if (event.pointerType === "mouse" && event.button === 0) from = place(event); });
  frame.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    if (!from) { pointInPlot(plot, x, y); return; }
    const [[a, b], [c, d]] = [[from[0], x], [from[1], y]].map((pair) => pair.sort((p, q) => p - q));
    rim.hidden = b - a < 4 && d - c < 4;
    Object.assign(rim.style, { left: `${a}px`, width: `${b - a}px`, top: `${c}px`, height: `${d - c}px` });
  });
  frame.addEventListener("pointerup", (event) => {
    if (from && !rim.hidden) zoomPlot(plot, from, place(event));
    from = null;
    rim.hidden = true;
  });
  frame.addEventListener("pointerleave", () => { from = null; rim.hidden = true; plot.tip.hidden = true; });
  frame.addEventListener("dblclick", () => { plot.zoom = null; drawPlot(plot); });
}

function zoomPlot(plot, from, to) {
  const { box, x, y } = plot.at;
  const within = (low, high, a, b, range, flip) => {
    const parts = [a, b].map((v) => Math.min(1, Math.max(0, (v - low) / (high - low)))).map((f) => (flip ? 1 - f : f)).sort((p, q) => p - q);
    return parts[1] - parts[0] < 0.02 ? range : parts.map((f) => lerp(range[0], range[1], f));
  };
  plot.zoom = { x: within(box.left, box.right, from[0], to[0], x, false),
    y: within(box.top, box.bottom, from[1], to[1], y, !plot.spec.flipped) };
  drawPlot(plot);
}

// A line at this moment, moved without drawing the plot again.
function addCursor(node, where) {
  const plot = plots[node.id];
  plot.moveCursor = () => {
    const { box, toX } = plot.at;
    const x = toX(where());
    plot.bar.hidden = !(x >= box.left && x <= box.right);
    Object.assign(plot.bar.style, { left: `${x - 1}px`, top: `${box.top}px`, height: `${box.bottom - box.top}px` });
  };
  plot.moveCursor();
}
