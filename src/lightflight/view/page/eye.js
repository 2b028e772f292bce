// The eye that looks at the space: where it stands, and where a point falls on the panel.
// An eye is { turn, tilt, target, distance, zoom }: angles in radians, lengths in mm.

const TAN_HALF = Math.tan(Math.PI / 8); // 45 degrees upright
const NEAR = 0.02; // of the distance to the target: nothing nearer is drawn

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const times = (a, f) => [a[0] * f, a[1] * f, a[2] * f];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => times(a, 1 / Math.hypot(...a));
const isPlace = (p) => p.every(isFiniteNumber);

// Right, up and back (towards the eye) of a direction of looking; y stays upright.
function axesOf({ turn, tilt }) {
  const back = [Math.cos(tilt) * Math.sin(turn), Math.sin(tilt), Math.cos(tilt) * Math.cos(turn)];
  const right = [Math.cos(turn), 0, -Math.sin(turn)];
  return { right, up: cross(back, right), back };
}

const anglesOf = (back) => ({ turn: Math.atan2(back[0], back[2]), tilt: Math.asin(back[1] / Math.hypot(...back)) });

// From a point in space to [x, y, depth]: pixels of the panel, and mm in front of the eye.
function projector(eye, width, height) {
  const { right, up, back } = axesOf(eye);
  const scale = eye.zoom * height / 2 / TAN_HALF;
  return (p) => {
    const d = minus(p, eye.target);
    const depth = eye.distance - dot(d, back);
    const f = scale / depth;
    return [width / 2 + f * dot(d, right), height / 2 - f * dot(d, up), depth];
  };
}

const eyePlace = (eye) => plus(eye.target, times(axesOf(eye).back, eye.distance));

// The nearest eye of a direction that still has every point inside the panel, `pad` pixels from its rim.
function fittedEye(angles, points, width, height, pad) {
  const { right, up, back } = axesOf(angles);
  const middle = times(points.reduce(plus, [0, 0, 0]), 1 / points.length);
  const seen = points.map((p) => minus(p, middle)).map((d) => [dot(d, right), dot(d, up), dot(d, back)]);
  const across = TAN_HALF * Math.max(0.2, 1 - 2 * pad / width) * width / height;
  const upright = TAN_HALF * Math.max(0.2, 1 - 2 * pad / height);
  const reach = (k, slope) => [1, -1].map((sign) => Math.max(...seen.map((p) => sign * p[k] + p[2] * slope)));
  const [east, west] = reach(0, across);
  const [north, south] = reach(1, upright);
  const distance = Math.max((east + west) / (2 * across), (north + south) / (2 * upright), 1);
  const target = plus(middle, plus(times(right, (east - west) / 2), times(up, (north - south) / 2)));
  return { ...angles, target, distance, zoom: 1 };
}

// The eye at a place, zoomed in until the points just fit.
function eyeAt(place, points, width, height, pad) {
  const target = times(points.reduce(plus, [0, 0, 0]), 1 / points.length);
  const back = minus(place, target);
  const eye = { ...anglesOf(back), target, distance: Math.hypot(...back), zoom: 1 };
  const project = projector(eye, width, height);
  const fits = points.map(project).flatMap(([x, y, depth]) => (depth > 0
    ? [(width / 2 - pad) / Math.abs(x - width / 2), (height / 2 - pad) / Math.abs(y - height / 2)] : []));
  return { ...eye, zoom: Math.min(20, Math.max(0.2, ...[Math.min(...fits)].filter(Number.isFinite))) };
}

// What of a polygon (or of a line of two points) lies in front of the eye.
function inFront(points, eye, closed) {
  const { back } = axesOf(eye);
  const near = NEAR * eye.distance;
  const room = points.map((p) => eye.distance - dot(minus(p, eye.target), back) - near);
  const out = [];
  points.forEach((p, i) => {
    if (room[i] >= 0) out.push(p);
    const j = (i + 1) % points.length;
    if ((closed || j > i) && (room[i] < 0) !== (room[j] < 0)) {
      out.push(p.map((x, k) => lerp(x, points[j][k], room[i] / (room[i] - room[j]))));
    }
  });
  return out;
}
