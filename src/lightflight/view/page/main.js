// The page's state, its controls, and what happens when time moves.

const state = { clock: "event", elapsed: 0, playing: false };
const byId = (id) => document.getElementById(id);
const slider = byId("time");
const endOf = (clock) => (clock === "event" ? eventEnd : arrivalEnd);

// Everything that is shown at this moment, computed once.
function current() {
  const { clock, elapsed } = state;
  const t = clock === "event" ? elapsed : eventFromArrival(elapsed);
  const ta = clock === "event" ? arrivalFromEvent(elapsed) : elapsed;
  const half = path.pulse_fwhm_ps / 2;
  const body = clock === "event" ? piece(t - half, t + half)
    : piece(eventFromArrival(ta - half), eventFromArrival(ta + half));
  const other = clock === "event" ? eventFromArrival(Math.min(elapsed, arrivalEnd)) : Math.min(elapsed, eventEnd);
  // On the other branches of a path that forks a pulse flies too, until it leaves.
  const others = ways.filter((one) => one !== way).flatMap((one) => {
    const own = clock === "event" ? t : eventFromArrival(ta, one);
    if (own >= endOfWay(one)) return [];
    const [from, to] = clock === "event" ? [t - half, t + half]
      : [eventFromArrival(ta - half, one), eventFromArrival(ta + half, one)];
    return [{ body: piece(from, to, one), place: positionAt(own, one) }];
  });
  return { clock, elapsed, t, ta, body, place: positionAt(t), leg: nLegs ? legAt(t) : -1, std: stdAt(t),
    others, ghost: hasArrival ? positionAt(other) : [null, null, null], pixel: pixelOnPath(t), speed: speedAt(t, clock) };
}

const errorText = (std, unit = "") => (std > 0 ? `±\u202f${withError(std, std).split(" ± ")[1]}${unit ? `\u202f${unit}` : ""}` : "");

// "x 179.99 ± 0.12": the value as sharp as its error, the error smaller beside it; kept on one line.
function placeParts(name, value, std) {
  const group = element("span");
  group.className = "coordinate";
  element("span", name, group).className = "axis";
  group.append(` ${withError(value, std).split(" ± ")[0]} `);
  element("small", errorText(std), group);
  return [group, " "];
}

const STORIES = {
  event: () => `What happened: the pulse flies at ${show(1 / path.path_index, 4)}\u202fc all the way, ${show(path.pulse_fwhm_ps * C / path.path_index, 1, "mm")} long.`,
  arrival: (now) => {
    const ratio = now.speed * path.path_index;
    const how = ratio > 1.02 ? "Coming nearer, its light has less and less way to go: it seems to run ahead of itself"
      : ratio < 0.98 ? "Going away, its light has more and more way to go: it seems to lag" : "Flying across the view, it seems to run at its own speed";
    const long = path.pulse_fwhm_ps * C * now.speed;
    return `What the camera saw. ${how}, at ${show(now.speed, 3)}\u202fc and ${show(long, 1, "mm")} long.`;
  },
};

function render() {
  const now = current();
  byId("story").textContent = nLegs ? STORIES[now.clock](now) : "The path has no legs.";
  byId("elapsed-name").textContent = now.clock === "event" ? "event time" : "arrival time";
  byId("elapsed").textContent = show(now.elapsed, 1, "ps");
  byId("elapsed-error").textContent = now.clock === "event" ? errorText(now.std[3], "ps") : "";
  byId("place").replaceChildren(...now.place.flatMap((x, k) => placeParts("xyz"[k], x, now.std[k])));
  byId("leg").textContent = now.leg >= 0 ? String(now.leg + 1) : "–";
  byId("speed-name").textContent = now.clock === "event" ? "speed" : "apparent speed";
  byId("speed").textContent = show(now.speed, now.clock === "event" ? 4 : 3, "c");
  byId("picture-time").textContent = now.clock === "event" ? "if light reached it at once" : eye === 0 ? "as recorded" : "computed from the path";
  slider.value = String(now.elapsed);
  slider.setAttribute("aria-valuetext", `${now.elapsed.toFixed(0)} picoseconds of ${now.clock} time`);
  movePulse(now);
  drawPicture(now);
  for (const plot of Object.values(plots)) if (plot.moveCursor) plot.moveCursor();
}

let spokenTimer = 0;
function speak() {
  clearTimeout(spokenTimer);
  spokenTimer = setTimeout(() => {
    const now = current();
    byId("spoken").textContent = `${now.clock} time ${now.elapsed.toFixed(0)} picoseconds: pulse at `
      + `${now.place.map((x) => x.toFixed(0)).join(", ")} millimetres on leg ${now.leg + 1}, speed ${now.speed.toFixed(2)} c`;
  }, 500);
}

function setTime(elapsed) {
  state.elapsed = Math.min(endOf(state.clock), Math.max(0, elapsed));
  render();
  speak();
}

// The pulse stays where it is; the reading changes to the other clock's.
function setClock(clock) {
  if (clock === state.clock || (clock === "arrival" && !hasArrival)) return;
  const now = current();
  state.clock = clock;
  document.documentElement.dataset.clock = clock;
  for (const button of document.querySelectorAll("[data-clock][role=radio]")) {
    const on = button.dataset.clock === clock;
    button.setAttribute("aria-checked", String(on));
    button.tabIndex = on ? 0 : -1;
  }
  slider.max = String(endOf(clock));
  drawStrip();
  setTime(clock === "event" ? now.t : now.ta);
}

// Under the slider: legs end to end on this clock, bright where the camera sees the pulse.
function drawStrip() {
  const canvas = byId("strip");
  const scale = window.devicePixelRatio || 1;
  canvas.width = Math.max(1, Math.round(canvas.clientWidth * scale));
  canvas.height = Math.max(1, Math.round(canvas.clientHeight * scale));
  const g = canvas.getContext("2d");
  g.clearRect(0, 0, canvas.width, canvas.height);
  const thumb = 12 * scale;
  const at = (v) => thumb / 2 + v / (endOf(state.clock) || 1) * (canvas.width - thumb);
  const times = onWay(state.clock === "event" ? trace.event_ps : trace.arrival_ps);
  const seen = onWay(trace.in_view);
  g.fillStyle = color("hair");
  g.fillRect(0, 0, canvas.width, canvas.height);
  g.fillStyle = color("accent");
  g.globalAlpha = 0.45;
  for (let i = 0; i < times.length; i += 1) {
    if (!seen[i]) continue;
    const first = i;
    while (i + 1 < times.length && seen[i + 1]) i += 1;
    g.fillRect(at(times[first]), 0, at(times[i]) - at(times[first]), canvas.height);
  }
  g.globalAlpha = 1;
  g.fillStyle = color("ink");
  for (const t of way.times.slice(1, -1)) {
    const v = state.clock === "event" ? t : arrivalFromEvent(t);
    g.fillRect(at(v) - scale / 2, 0, Math.max(1, scale), canvas.height);
  }
}

// Which branch of a path that forks the readings follow.
function setWay(number) {
  if (!ways[number]) return;
  const now = current();
  way = ways[number];
  eventEnd = endOfWay(way);
  arrivalEnd = hasArrival ? arrivalFromEvent(eventEnd) : 0;
  for (const button of document.querySelectorAll("[data-way]")) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.way) === number));
  }
  slider.max = String(endOf(state.clock));
  state.elapsed = Math.min(endOf(state.clock), state.clock === "event" ? now.t : now.ta);
  redrawAll();
}

// One button for each branch; none where nothing forks.
function addWayButtons() {
  const group = byId("ways");
  group.hidden = ways.length < 2;
  if (group.hidden) return;
  ways.forEach((one, number) => {
    const button = element("button", `Branch ${number + 1}`, group);
    button.type = "button";
    button.dataset.way = String(number);
    button.setAttribute("aria-pressed", String(number === 0));
    button.title = `legs ${one.legs.map((k) => k + 1).join(", ")}`;
    button.addEventListener("click", () => setWay(number));
  });
}

// The pulse stays where it is; another camera looks at it.
function setEye(number) {
  if (number === eye || !eyes[number]) return;
  const now = current();
  useEye(number);
  for (const button of document.querySelectorAll("[data-eye]")) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.eye) === eye));
  }
  byId("picture-title").textContent = eye === 0 ? "The camera's picture" : "The second camera's picture";
  pictureHelp();
  slider.max = String(endOf(state.clock));
  state.elapsed = state.clock === "event" ? now.t : arrivalFromEvent(now.t);
  redrawAll();
  selectBrightest();
}

function pictureHelp() {
  byId("picture-note").textContent = !camera || !lights ? ""
    : eye === 0 ? "Grey: photons of all pulses of a pixel, the brightest hundredth alike. Coloured: the light of this moment. Point at a pixel, or use arrow keys."
      : "Computed from the path, as shares of the brightest. Coloured: the light of this moment. Point at a pixel, or use arrow keys.";
}

function selectBrightest() {
  if (!camera || !lights || !lights.row.length) return;
  let best = 0;
  for (let i = 0; i < lights.row.length; i += 1) if (lights.photons[i] > lights.photons[best]) best = i;
  selectPixel(lights.row[best], lights.col[best]);
}

let lastFrame = 0;
function tick(moment) {
  if (!state.playing) return;
  const seconds = lastFrame ? Math.min(0.1, (moment - lastFrame) / 1000) : 0;
  lastFrame = moment;
  const next = state.elapsed + seconds * Number(byId("rate").value);
  if (next >= endOf(state.clock)) {
    setTime(endOf(state.clock));
    setPlaying(false);
    return;
  }
  setTime(next);
  requestAnimationFrame(tick);
}

function setPlaying(on) {
  if (on && state.elapsed >= endOf(state.clock) - 1e-6) state.elapsed = 0;
  state.playing = on;
  lastFrame = 0;
  byId("play").textContent = on ? "❚❚ Pause" : "▶ Play";
  byId("play").setAttribute("aria-pressed", String(on));
  if (on) requestAnimationFrame(tick);
}

const THEMES = ["auto", "light", "dark"];
function setTheme(name) {
  document.documentElement.dataset.theme = name;
  byId("theme-button").textContent = `Theme: ${name === "auto" ? "system" : name}`;
  redrawAll();
}

function redrawAll() {
  drawStrip();
  drawScene();
  drawPictureAxes();
  render();
  for (const graph of Object.values(graphs)) if (graph.drawn) graph.draw(graph.node);
  if (cursorPixel) showPixel(...cursorPixel);
}

// What is out of sight is drawn when the browser has nothing better to do.
function whenIdle(work) {
  if (window.requestIdleCallback) requestIdleCallback(work, { timeout: 4000 }); else setTimeout(work, 80);
}

function registerGraph(id, draw) {
  const node = byId(id);
  const graph = { node, draw, drawn: false };
  graphs[id] = graph;
  const once = () => {
    if (graph.drawn) return;
    graph.drawn = true;
    draw(node);
  };
  new IntersectionObserver((entries, observer) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    observer.disconnect();
    once();
  }, { rootMargin: "200px" }).observe(node);
  whenIdle(once);
}

function addCopyButtons() {
  for (const table of document.querySelectorAll(".numbers table")) {
    const button = element("button", "Copy as text");
    button.type = "button";
    button.className = "copy";
    table.closest(".table-scroll").after(button);
    button.addEventListener("click", async () => {
      const text = [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent.trim()).join("\t")).join("\n");
      try {
        await navigator.clipboard.writeText(text);
        button.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(table);
        button.textContent = "Selected: press Ctrl+C";
      }
    });
  }
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || byId("keys").open) return;
  const tag = event.target.tagName;
  if (tag === "SELECT" || tag === "TEXTAREA") return;
  const onButton = tag === "BUTTON" || tag === "SUMMARY";
  const step = event.shiftKey ? 100 : 10;
  const actions = {
    " ": () => !onButton && setPlaying(!state.playing),
    c: () => setClock(state.clock === "event" ? "arrival" : "event"),
    v: () => setEye((eye + 1) % eyes.length),
    t: () => setTheme(THEMES[(THEMES.indexOf(document.documentElement.dataset.theme) + 1) % THEMES.length]),
    "?": () => byId("keys").showModal(),
    Home: () => setTime(0),
    End: () => setTime(endOf(state.clock)),
    ArrowLeft: () => setTime(state.elapsed - step),
    ArrowRight: () => setTime(state.elapsed + step),
  };
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (event.target.getAttribute("role") === "radio" && key.startsWith("Arrow")) {
    setClock(state.clock === "event" ? "arrival" : "event");
    byId(`clock-${state.clock}`).focus();
    event.preventDefault();
  } else if (/^[1-9]$/.test(key) && Number(key) <= nLegs) {
    const t = timeOfLeg(Number(key) - 1);
    const leads = ways.findIndex((one) => one.legs.includes(Number(key) - 1));
    if (!way.legs.includes(Number(key) - 1)) setWay(leads);
    setTime(state.clock === "event" ? t : arrivalFromEvent(t));
  } else if (actions[key] && actions[key]() !== false) {
    event.preventDefault();
  }
}

function start() {
  document.documentElement.dataset.clock = "event";
  slider.max = String(eventEnd || 1);
  if (!hasArrival) byId("clock-arrival").disabled = true;
  slider.addEventListener("input", () => { setPlaying(false); setTime(Number(slider.value)); });
  byId("play").addEventListener("click", () => setPlaying(!state.playing));
  for (const button of document.querySelectorAll("[data-clock][role=radio]")) button.addEventListener("click", () => setClock(button.dataset.clock));
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => setView(button.dataset.view));
  for (const button of document.querySelectorAll("[data-residuals]")) {
    button.addEventListener("click", () => {
      residualsAs = button.dataset.residuals;
      for (const b of document.querySelectorAll("[data-residuals]")) b.setAttribute("aria-pressed", String(b === button));
      drawResiduals(byId("residual-plot"));
    });
  }
  byId("keys-button").addEventListener("click", () => byId("keys").showModal());
  byId("theme-button").addEventListener("click", () => setTheme(THEMES[(THEMES.indexOf(document.documentElement.dataset.theme) + 1) % 3]));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => document.documentElement.dataset.theme === "auto" && redrawAll());
  document.addEventListener("keydown", onKey);
  new ResizeObserver(() => { drawStrip(); if (camera) { drawPictureLines(current()); drawPictureAxes(); } }).observe(document.body);
  pictureHelp();
  byId("eyes").hidden = eyes.length < 2;
  for (const button of document.querySelectorAll("[data-eye]")) button.addEventListener("click", () => setEye(Number(button.dataset.eye)));
  addWayButtons();
  preparePicture();
  preparePictureEvents();
  prepareSpaceEvents();
  addCopyButtons();
  hideEmptyCards();
  setView("path");
  drawStrip();
  drawScene();
  setTime(0.12 * eventEnd);
  drawPictureAxes();
  performance.mark("lightflight-first-draw");
  document.documentElement.dataset.ready = "yes";
  registerGraph("clocks-plot", drawClocks);
  registerGraph("speed-plot", drawSpeed);
  registerGraph("residual-plot", drawResiduals);
  registerGraph("clock-plot", drawClockCard);
  whenIdle(() => { if (!cursorPixel) selectBrightest(); });
}

// A card with nothing to show leaves its room to the others; what is missing is said in words.
function hideEmptyCards() {
  const residuals = pulses && pulses.residual_ps.some(Number.isFinite);
  for (const [id, there] of [["picture-card", camera], ["pixel-card", camera && ((pulses && pulses.row.length) || payload.second)],
    ["clocks-card", hasArrival], ["speed-card", hasArrival], ["residual-card", residuals], ["clock-card", payload.clock]]) {
    byId(id).hidden = !there;
  }
  document.querySelector("[data-view=camera]").hidden = !camera;
}

// For tests and the curious: what is shown, and how to move it.
window.lightflight = { state, eyes, ways, current, setEye, setWay, setTime, setClock, setPlaying, setTheme, lightAt, pixelIndex, payload, plots,
  marks: () => pulseMarks, words: () => spaceWords, places: () => hoverPlaces, photons: () => photonSum };
start();
