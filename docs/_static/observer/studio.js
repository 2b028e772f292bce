/* The observer studio: one pulse on a straight line, one camera that can be moved. Everything that is physics
   comes from formulas.js; this file draws. World x to the right, z up the plan, towards the camera. */
"use strict";

(() => {
  const law = observerFormulas;
  const HALF_MM = 350;        // half of the line
  const NEAREST_MM = 20;      // the camera's least distance from the line
  const DEGREE = Math.PI / 180;
  const SVG = "http://www.w3.org/2000/svg";
  const byId = (name) => document.getElementById(`studio-${name}`);
  const state = { alpha: 10 * DEGREE, out: 1, back: 1, camera: [0, 260], share: 0, playing: false };

  // --- numbers -----------------------------------------------------------------------------

  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
  const point = (along) => law.direction(state.alpha).map((part) => part * along);

  /** The camera, moved off the line where it stands on it. */
  function settle() {
    const [x, z] = law.direction(state.alpha);
    const side = state.camera[1] * x - state.camera[0] * z;
    const missing = NEAREST_MM - Math.abs(side);
    if (missing > 0) {
      const sign = side < 0 ? -1 : 1;
      state.camera = [state.camera[0] - sign * missing * z, state.camera[1] + sign * missing * x];
    }
    state.back = Math.min(state.back, state.out);
  }

  /** Everything that is drawn follows from this. */
  function scene() {
    const foot = law.foot(state.camera, state.alpha);
    const footTime = law.eventTime(foot.at, state.out);
    const arrivalAt = (psi) => law.arrivalFromViewingAngle(psi, footTime, foot.distance, state.out, state.back);
    const ends = [-HALF_MM, HALF_MM].map((along) => law.viewingAngle(along, foot));
    const from = law.eventTime(-HALF_MM, state.out), to = arrivalAt(ends[1]);
    const now = from + state.share * (to - from);
    const psi = law.viewingAngleFromArrival(now, footTime, foot.distance, state.out, state.back);
    return { foot, arrivalAt, ends, from, to, now, psi,
      crossing: law.crossingAngle(state.out, state.back),
      there: law.alongAtEvent(now, state.out), seen: law.along(psi, foot) };
  }

  const speedInC = (psi) => law.apparentSpeedAtAngle(psi, state.out, state.back) / LIGHT_MM_PER_PS;

  /** Colour of an apparent speed: orange above c, blue below, grey at it. */
  function colour(inC) {
    const strength = Math.round(100 * clamp(Math.abs(Math.log2(inC)) / 1.2, 0, 1));
    return `color-mix(in srgb, var(--${inC > 1 ? "fast" : "slow"}) ${strength}%, var(--even))`;
  }

  // --- drawing -----------------------------------------------------------------------------

  function add(parent, kind, attributes, text) {
    const made = document.createElementNS(SVG, kind);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== undefined) made.textContent = text;
    parent.append(made);
    return made;
  }

  const line = (parent, a, b, more) => add(parent, "line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1], ...more });

  /** Pieces of the line between viewing angles: [psi, psi, speed in c]. */
  function pieces(ends) {
    const count = 90, step = (ends[1] - ends[0]) / count;
    return Array.from({ length: count }, (_, k) => {
      const psi = ends[0] + k * step;
      // Each reaches under the next, so that no seam shows.
      return [psi, Math.min(psi + 2 * step, ends[1]), speedInC(psi + step / 2)];
    });
  }

  function drawPlan(now) {
    const plan = byId("plan");
    plan.querySelectorAll(":scope > :not(.camera)").forEach((one) => one.remove());
    const layer = add(plan, "g", {});
    plan.prepend(layer);
    const place = (along) => point(along).map((value, k) => (k ? -value : value));
    const camera = [state.camera[0], -state.camera[1]];
    line(layer, [-450, 0], [450, 0], { class: "thin dashed" });
    add(layer, "text", { x: 440, y: 36, "text-anchor": "end" }, "z = 0");
    for (const [a, b, inC] of pieces(now.ends)) {
      line(layer, place(law.along(a, now.foot)), place(law.along(b, now.foot)),
        { stroke: colour(inC), "stroke-width": 13 });
    }
    const tip = place(HALF_MM), [x, z] = law.direction(state.alpha);
    add(layer, "path", { d: "M0,-13 L26,0 L0,13 Z", fill: "var(--ink)",
      transform: `translate(${tip}) rotate(${-Math.atan2(z, x) / DEGREE})` });
    line(layer, camera, place(now.foot.at), { class: "thin dashed" });
    // The foot's name stands on the side where the camera is not.
    const [footX, footY] = place(now.foot.at), below = camera[1] < footY;
    add(layer, "text", { x: Math.max(footX - 10, -365), y: footY + (below ? 44 : -22), "text-anchor": "end" }, "foot");
    drawAlpha(layer);
    drawPsi(layer, camera, place(now.foot.at), place(now.seen), now);
    if (now.crossing !== null && now.crossing > now.ends[0] && now.crossing < now.ends[1]) {
      line(layer, camera, place(law.along(now.crossing, now.foot)), { class: "ink" });
    }
    if (Math.abs(now.there) <= HALF_MM) {
      const [cx, cy] = place(now.there);
      add(layer, "circle", { cx, cy, r: 13, class: "there" });
      add(layer, "text", { x: cx - 10, y: cy + 52, "text-anchor": "middle" }, "is here");
    }
    if (Math.abs(now.seen) <= HALF_MM) {
      const [cx, cy] = place(now.seen);
      line(layer, [cx, cy], camera, { class: "ray" });
      add(layer, "circle", { cx, cy, r: 17, class: "seen" });
      add(layer, "text", { x: cx, y: cy - 30, "text-anchor": "middle" }, "is seen here");
    }
    byId("camera").setAttribute("transform", `translate(${camera})`);
    byId("camera").lastChild.setAttribute("x", clamp(0, -380 - camera[0], 380 - camera[0]));
  }

  /** The angle alpha between the line and the plane z = 0, at the origin. */
  function drawAlpha(layer) {
    if (Math.abs(state.alpha) < 2 * DEGREE) return;
    const r = 230, [x, z] = law.direction(state.alpha);
    add(layer, "path", { class: "thin", d: `M${-r},0 A${r},${r} 0 0 ${z > 0 ? 0 : 1} ${-r * x},${r * z}` });
    add(layer, "text", { x: -r - 34, y: r * Math.sin(state.alpha / 2) + 10 }, "α");
  }

  /** The viewing angle psi at the camera, between foot and seen pulse. */
  function drawPsi(layer, camera, foot, seen, now) {
    const r = Math.min(130, 0.7 * now.foot.distance);
    if (Math.abs(now.seen) > HALF_MM || Math.abs(now.psi) < 2 * DEGREE) return;
    const [a, b] = [foot, seen].map((end) => Math.atan2(end[1] - camera[1], end[0] - camera[0]));
    const on = (angle, radius) => [camera[0] + radius * Math.cos(angle), camera[1] + radius * Math.sin(angle)];
    const turn = Math.atan2(Math.sin(b - a), Math.cos(b - a));
    add(layer, "path", { class: "thin", d: `M${on(a, r)} A${r},${r} 0 0 ${turn > 0 ? 1 : 0} ${on(b, r)}` });
    const [x, y] = on(a + turn / 2, r + 28);
    add(layer, "text", { x, y: y + 10, "text-anchor": "middle" }, "ψ");
  }

  const LEFT = 20, RIGHT = 580;
  const across = (psi) => LEFT + (psi / Math.PI + 0.5) * (RIGHT - LEFT);

  function drawPicture(now) {
    const picture = byId("picture");
    picture.replaceChildren();
    for (const [a, b, inC] of pieces(now.ends)) {
      add(picture, "rect", { x: across(a), y: 34, width: across(b) - across(a), height: 34, fill: colour(inC) });
    }
    const edge = now.crossing === null ? now.ends[0] : clamp(now.crossing, ...now.ends);
    const room = 150;
    if (edge > now.ends[0]) {
      const x = Math.max(across(edge) - 10, LEFT + room);
      add(picture, "text", { x, y: 24, "text-anchor": "end", class: "fast" }, "outruns light");
    }
    if (edge < now.ends[1]) {
      const x = Math.max(across(edge) + 10, edge > now.ends[0] ? LEFT + room + 20 : 0);
      add(picture, "text", { x: Math.min(x, RIGHT - 40), y: 24, class: "slow" }, "lags");
    }
    if (edge > now.ends[0] && edge < now.ends[1]) {
      line(picture, [across(edge), 6], [across(edge), 76], { class: "ink" });
    }
    if (Math.abs(now.seen) <= HALF_MM) {
      add(picture, "circle", { cx: across(now.psi), cy: 51, r: 13, class: "seen" });
    }
    for (const degrees of [-90, -60, -30, 0, 30, 60, 90]) {
      add(picture, "text", { x: clamp(across(degrees * DEGREE), 34, 572), y: 102, "text-anchor": "middle" },
        `${String(degrees).replace("-", "−")}°`);
    }
  }

  function drawLaw(now) {
    const graph = byId("law");
    graph.replaceChildren();
    const [early, late] = [now.arrivalAt(now.ends[0]), now.to];
    const up = (time) => 285 - 225 * (time - early) / (late - early || 1);
    line(graph, [LEFT, 290], [RIGHT, 290], { class: "thin" });
    line(graph, [across(0), 290], [across(0), 50], { class: "thin dashed" });
    const curve = pieces(now.ends).map(([a]) => a).concat(now.ends[1])
      .map((psi) => `${across(psi).toFixed(1)},${up(now.arrivalAt(psi)).toFixed(1)}`);
    add(graph, "polyline", { class: "ink", points: curve.join(" ") });
    add(graph, "text", { x: LEFT, y: 34 }, "arrival time tₐ");
    add(graph, "text", { x: RIGHT, y: 317, "text-anchor": "end" }, "viewing angle ψ");
    if (Math.abs(now.seen) <= HALF_MM) {
      add(graph, "circle", { cx: across(now.psi), cy: up(now.now), r: 11, class: "seen" });
    }
    const one = state.out === state.back;
    byId("one-index").hidden = !one;
    byId("two-indices").hidden = one;
    byId("known").textContent = `p = ${Math.round(now.foot.distance)} mm from camera to foot, n = ${state.out}`
      + (one ? "" : `, back n′ = ${state.back}`);
  }

  function say(now) {
    const out = Math.abs(now.seen) > HALF_MM;
    const inC = speedInC(now.psi), fast = inC > 1;
    const degrees = (angle) => `${(angle / DEGREE).toFixed(1).replace("-", "−")}°`;
    const said = byId("said");
    // Said aloud when it stands still, not sixty times a second.
    said.setAttribute("aria-live", state.playing ? "off" : "polite");
    said.replaceChildren();
    if (out) {
      said.append("The pulse has set out; its light has not reached the camera yet.");
    } else {
      const strong = document.createElement("strong");
      strong.className = fast ? "fast" : "slow";
      strong.textContent = `${inC.toFixed(2)} c: ${fast ? "outruns light" : inC > 0.995 ? "as fast as light" : "lags"}`;
      said.append("Seen at viewing angle ψ = ", degrees(now.psi), ", on a path of elevation α = ",
        degrees(state.alpha), ", the pulse seems to fly at ", strong, `. It flies at ${(1 / state.out).toFixed(2)} c.`);
    }
    byId("now").textContent = `${Math.round(now.now - now.from)} ps`;
  }

  function draw() {
    settle();
    const now = scene();
    drawPlan(now);
    drawPicture(now);
    drawLaw(now);
    say(now);
    byId("clock").setAttribute("aria-valuetext", `${Math.round(now.now - now.from)} ps`);
  }

  // --- controls ----------------------------------------------------------------------------

  const FIELDS = {
    alpha: [() => state.alpha / DEGREE, (value) => { state.alpha = value * DEGREE; }],
    out: [() => state.out, (value) => { state.out = value; }],
    back: [() => state.back, (value) => { state.back = value; }],
    x: [() => state.camera[0], (value) => { state.camera = [value, state.camera[1]]; }],
    z: [() => state.camera[1], (value) => { state.camera = [state.camera[0], value]; }],
  };

  /** Numbers in the fields follow the state; the one that is being typed in is left alone. */
  function fill() {
    for (const [name, [get]] of Object.entries(FIELDS)) {
      const field = byId(name);
      if (field !== document.activeElement) field.value = String(Number(get().toFixed(2)));
    }
  }

  function change(name, value) {
    const field = byId(name);
    if (!Number.isFinite(value)) return;
    FIELDS[name][1](clamp(value, Number(field.min), Number(field.max)));
    draw();
    fill();
  }

  /** A set-up to begin with, some way into what is seen of it. */
  function start(setUp) {
    Object.assign(state, setUp);
    settle();
    const { from, to, arrivalAt, ends } = scene();
    state.share = (0.85 * arrivalAt(ends[0]) + 0.15 * to - from) / (to - from);
    byId("clock").value = String(Math.round(1000 * state.share));
    draw();
    fill();
  }

  function play(on) {
    state.playing = on;
    byId("play").textContent = on ? "Pause" : "Play";
    draw();
    if (!on) return;
    let last = performance.now();
    // Who asked for less motion sees it in steps.
    const pause = matchMedia("(prefers-reduced-motion: reduce)").matches ? 700 : 0;
    const step = (time) => {
      if (!state.playing) return;
      requestAnimationFrame(step);
      if (time - last < pause) return;
      state.share += Math.min(time - last, pause + 100) / 9000;
      last = time;
      if (state.share > 1) state.share = 0;
      byId("clock").value = String(Math.round(1000 * state.share));
      draw();
    };
    requestAnimationFrame(step);
  }

  function makeCamera() {
    const plan = byId("plan");
    const camera = add(plan, "g", { id: "studio-camera", class: "camera", tabindex: 0, role: "button",
      "aria-label": "Camera: drag it, or move it with the arrow keys" });
    add(camera, "circle", { r: 34, class: "halo" });
    add(camera, "rect", { x: -22, y: -16, width: 44, height: 32, rx: 6 });
    add(camera, "circle", { r: 9, fill: "var(--ground)" });
    add(camera, "text", { y: -26, "text-anchor": "middle" }, "camera");
    const move = (x, z) => { change("x", x); change("z", z); };
    camera.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 50 : 10;
      const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] }[event.key];
      if (!by) return;
      event.preventDefault();
      move(state.camera[0] + by[0], state.camera[1] + by[1]);
    });
    const drag = (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(plan.getScreenCTM().inverse());
      move(Math.round(at.x), Math.round(-at.y));
    };
    camera.addEventListener("pointerdown", (event) => {
      camera.setPointerCapture(event.pointerId);
      camera.addEventListener("pointermove", drag);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      camera.addEventListener(end, () => camera.removeEventListener("pointermove", drag));
    }
  }

  makeCamera();
  for (const name of Object.keys(FIELDS)) {
    byId(name).addEventListener("input", () => change(name, byId(name).valueAsNumber));
    byId(name).addEventListener("change", () => { byId(name).blur(); fill(); });
  }
  byId("clock").addEventListener("input", () => { state.share = byId("clock").valueAsNumber / 1000; draw(); });
  byId("play").addEventListener("click", () => play(!state.playing));
  document.querySelectorAll("#studio [data-try]").forEach((button) => button.addEventListener("click", () => {
    const [alpha, out, back, x, z] = button.dataset.try.split(" ").map(Number);
    start({ alpha: alpha * DEGREE, out, back, camera: [x, z] });
  }));
  start({});
  window.observerStudio = { state, scene, draw };
  document.documentElement.dataset.ready = "yes";
})();
