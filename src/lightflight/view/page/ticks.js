// Numbers along an axis: where they stand and how they are written, and words that keep apart.

// 1, 2 or 5 times a power of ten: the smallest step that gives at most `most` of them.
function stepOf(span, most) {
  const raw = span / Math.max(1, most);
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((s) => s * power >= raw * 0.9999);
}

function ticksBetween(low, high, most) {
  if (!(high > low)) return [];
  const step = stepOf(high - low, most);
  const out = [];
  for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; k += 1) out.push(k * step);
  return out;
}

// As many digits as the step between two of them needs; large ones with a thin space.
function tickText(value, step) {
  const size = Math.abs(value);
  if (size >= 1e6 || (size > 0 && size < 1e-4)) return value.toExponential(0).replace("e+", "e").replace("-", "\u2212");
  const digits = Math.min(6, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  const [whole, rest] = size.toFixed(digits).split(".");
  const grouped = whole.length > 4 ? whole.replace(/\B(?=(\d{3})+$)/g, "\u202f") : whole;
  const sign = value < 0 && Number(size.toFixed(digits)) > 0 ? "\u2212" : "";
  return sign + grouped + (rest ? `.${rest}` : "");
}

// Words already written on a canvas: a new one is put down only where none of them is.
function wordRoom(g, width, height) {
  const taken = [];
  const free = (box) => box[0] >= 1 && box[1] >= 1 && box[2] <= width - 1 && box[3] <= height - 1
    && taken.every((b) => box[2] < b[0] || box[0] > b[2] || box[3] < b[1] || box[1] > b[3]);
  return {
    taken,
    // At the first of the places where it fits; false where it fits nowhere.
    put(text, places, ink, halo, gap = 4) {
      const half = g.measureText(text).width / 2 + gap;
      for (const [x, y] of places) {
        const box = [x - half, y - 8, x + half, y + 8];
        if (!free(box)) continue;
        taken.push(box);
        g.textAlign = "center";
        g.textBaseline = "middle";
        g.lineJoin = "round";
        g.lineWidth = 3;
        g.strokeStyle = halo;
        g.strokeText(text, x, y);
        g.fillStyle = ink;
        g.fillText(text, x, y);
        return true;
      }
      return false;
    },
  };
}
