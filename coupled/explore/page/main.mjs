// The page: fields to state, state to requests, answers to figures.

import { channel, serve } from "./channel.mjs";
import { classify, columns, limitCycle } from "./cycle.mjs";
import { foldCurves, hopfCurves, hopfPoints } from "./curves.mjs";
import { engineOf } from "./engine.mjs";
import { balance, steadyStates, survey } from "./equilibria.mjs";
import { cold } from "./equations.mjs";
import { integrate } from "./integrate.mjs";
import { methodOf } from "./rosenbrock.mjs";
import { DENSITY, FJ, NS, UW, absorbedPower, derivedRates, driveOf, dropRate, systemOf, turnOf } from "./ring.mjs";
import { FIELDS, addFamilyFields, hashOf, modelOf, objection, ringOf, stateOf, valueOf, watts, bordersOf } from "./state.mjs";
import { theme } from "./plot.mjs";
import { mapImage, phaseFigure, planeFigure, tracesFigure, transmissionFigure } from "./figures.mjs";
import { errorFigure, fieldImage, sectionFigure, spectrumFigure, stepFigure } from "./thermal.mjs";
import { fieldOf, periodError, periodicStates, stepResponse } from "./heat.mjs";
import { commandOf, pythonOf } from "./script.mjs";
import { saveFigure, saveTrace } from "./save.mjs";

const $ = (id) => document.getElementById(id);

/** Everything the figures show; answers fill it as they come. */
const shown = { trace: null, states: [], map: null, curves: { folds: [], hopf: [] }, points: [], plane: null, phase: 0, section: null };
let data = null;
let state = null;
let ask = {};
let drawn = false;
let timer = 0;

function start() {
  data = JSON.parse($("data").textContent);
  data.section = data.section && decoded(data.section);
  if (data.family) addFamilyFields(data.family);
  const code = $("code").textContent;
  ask = {
    trace: channel(code, data.tableaus, gotTrace),
    light: channel(code, data.tableaus, gotLight),
    plane: channel(code, data.tableaus, gotPlane, { preempt: true }),
  };
  $("notice").remove();
  $("page").hidden = false;
  const narrow = matchMedia("(max-width: 56rem)");
  $("more").open = !narrow.matches;
  narrow.addEventListener("change", () => ($("more").open = !narrow.matches));
  if (channel.local) $("local").hidden = false;
  build();
  state = stateOf(location.hash, data.start, data);
  fill();
  changed({ ring: true });
  addEventListener("hashchange", () => {
    const next = stateOf(location.hash, data.start, data);
    if (hashOf(next) === hashOf(state)) return;
    state = next;
    fill();
    changed({ ring: true });
  });
  new ResizeObserver(() => draw()).observe($("page"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => recolour());
}

/** The modes of a cross-section from base64 to arrays of 8-bit numbers. */
function decoded(section) {
  const modes = section.modes.map((text) => Int8Array.from(atob(text), (c) => (c.charCodeAt(0) << 24) >> 24));
  return { ...section, modes };
}

/** Fill the selects and make the fields; names come as text, never as markup. */
function build() {
  const options = (id, names) => {
    for (const [value, name] of names.entries()) $(id).add(new Option(name, String(value)));
  };
  options("ring", data.rings.map((ring) => ring.name));
  options("model", data.models.map((model) => model.name));
  options("preset", ["Choose a preset…", ...data.presets.map((preset) => preset.name)]);
  $("title").textContent = data.title;
  document.title = data.title;
  for (const name of Object.keys(FIELDS)) field(name);
  $("ring").addEventListener("change", () => {
    const own = data.rings[Number($("ring").value)].start || {};
    set({ ring: Number($("ring").value), loadedQ: null, intrinsicQ: null, lifetime: null, ...own }, { ring: true });
    fill();
  });
  $("model").addEventListener("change", () => set({ model: Number($("model").value) }, { ring: true }));
  $("preset").addEventListener("change", () => {
    const preset = data.presets[Number($("preset").value) - 1];
    if (!preset) return;
    state = { ...data.start, ...preset.state };
    fill();
    changed({ ring: true });
    $("about").textContent = preset.text || "";
  });
  for (const input of document.querySelectorAll("input[name=view]")) input.addEventListener("change", () => set({ view: input.value }, {}));
  $("reset").addEventListener("click", () => {
    set({ loadedQ: null, intrinsicQ: null, lifetime: null }, { ring: true });
    fill();
  });
  $("phase").addEventListener("input", () => {
    shown.phase = Number($("phase").value);
    drawSection();
  });
  $("play").addEventListener("click", play);
  $("theme").addEventListener("click", () => {
    document.documentElement.dataset.theme = theme().name === "dark" ? "light" : "dark";
    recolour();
  });
  watchPlane();
  $("python").addEventListener("click", () => copy(pythonOf(state, data), "Python script"));
  $("command").addEventListener("click", () => copy(commandOf(state, data), "Command line"));
  $("link").addEventListener("click", () => copy(`${address()}#${hashOf(state)}`, "Link"));
  for (const button of document.querySelectorAll("button[data-save]")) {
    button.addEventListener("click", () => {
      const [id, kind] = button.dataset.save.split(" ");
      if (kind === "csv") saveTrace(traceTable());
      else saveFigure($(id).querySelector("svg"), `${id}.${kind}`, kind);
    });
  }
  $("section-figure").hidden = !data.section;
  $("error-figure").hidden = data.judge === null || data.models.length < 2;
}

/** One field: number and slider, which move together; a value out of range is marked and not taken. */
function field(name) {
  const { log, step, unit } = FIELDS[name];
  const [number, slider] = [$(name), $(`${name}-slider`)];
  slider.min = 0;
  slider.max = 1000;
  slider.step = 1;
  number.addEventListener("input", () => take(name, number.value.trim() === "" ? NaN : Number(number.value), false));
  number.addEventListener("change", () => number.getAttribute("aria-invalid") !== "true" && fill());
  slider.addEventListener("input", () => {
    const [low, high] = span(name);
    const share = Number(slider.value) / 1000;
    let value = log ? low * (high / low) ** share : low + share * (high - low);
    value = step ? Math.round(value / step) * step : value;
    take(name, Number(value.toPrecision(log ? 4 : 6)), true);
  });
  slider.setAttribute("aria-label", `${FIELDS[name].label}, slider${unit ? `, ${unit}` : ""}`);
}

/** What a slider spans: less than what its field takes. */
function span(name) {
  const window = data.rings[state.ring].window;
  if (name === "power") return [window.power[0] - 7, window.power[1] + 5];
  if (name === "detuning") return [2.5 * window.detuning[0], 2.5 * window.detuning[1]];
  if (name === "duration") return [1, 100];
  if (/^p\d$/.test(name)) return [FIELDS[name].low, FIELDS[name].high];
  const own = valueOf(name, { ...state, [name]: null }, data);
  if (name === "lifetime") return [own / 30, own * 10];
  return [own / 5, own * 5];
}

function take(name, value, fromSlider) {
  const problem = objection(name, value, state, data);
  const number = $(name);
  number.setAttribute("aria-invalid", problem ? "true" : "false");
  $(`${name}-problem`).textContent = problem;
  if (problem) return;
  state = { ...state, [name]: value };
  fill(fromSlider ? null : name);
  if (/^p\d$/.test(name)) state.model = data.models.findIndex((model) => model.family);
  $("model").value = String(state.model);
  changed({ ring: !["power", "detuning", "duration"].includes(name) });
}

/** Write the state into the fields, but not into the one that is being typed in. */
function fill(typing = null) {
  for (const name of Object.keys(FIELDS)) {
    const value = valueOf(name, state, data);
    const [low, high] = span(name);
    const share = FIELDS[name].log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    $(`${name}-slider`).value = String(Math.round(1000 * Math.min(Math.max(share, 0), 1)));
    $(`${name}-slider`).setAttribute("aria-valuetext", `${Number(value.toPrecision(5))} ${FIELDS[name].unit}`);
    if (typing === name) continue;
    $(name).value = String(Number(value.toPrecision(10)));
    $(name).setAttribute("aria-invalid", "false");
    $(`${name}-problem`).textContent = "";
  }
  $("ring").value = String(state.ring);
  $("model").value = String(state.model);
  for (const input of document.querySelectorAll("input[name=view]")) input.checked = input.value === state.view;
}

function set(change, what) {
  state = { ...state, ...change };
  changed(what);
}

/** Ask for everything that depends on what has changed: rough at once, exact when the slider rests. */
function changed({ ring = false }) {
  const light = { ring: ringOf(state, data), model: modelOf(state, data), power: watts(state.power), detuning: state.detuning * 1e9 };
  const window = data.rings[state.ring].window;
  const trace = { ...light, kind: "trace", duration: state.duration * 1e-6, settled: state.view === "cycle" };
  if (ring) {
    shown.map = null;
    shown.curves = { folds: [], hopf: [] };
    const sizes = [[24, 24], [60, 60], [140, 140]]; // prettier-ignore
    ask.plane({ ...light, kind: "plane", powers: window.power.map(watts), detunings: window.detuning.map((x) => x * 1e9), sizes });
  }
  ask.trace({ ...trace, rtol: 1e-5, quick: true });
  ask.light({ ...light, kind: "light", detunings: window.detuning.map((x) => 2.5e9 * x) });
  clearTimeout(timer);
  timer = setTimeout(() => {
    ask.trace({ ...trace, rtol: 1e-6, quick: false });
    try {
      history.replaceState(null, "", `#${hashOf(state)}`);
    } catch {
      // a page inside a notebook has no address of its own; its link is still copied
    }
  }, 180);
  draw();
}

function gotTrace(answer, request) {
  if (answer.error) return say(`This setting cannot be integrated: ${answer.error}.`);
  shown.trace = { ...answer, request };
  shown.section = null;
  say(summary());
  draw();
  return undefined;
}

function gotLight(answer) {
  if (answer.error) return;
  shown.states = answer.states;
  shown.points = answer.points;
  say(summary());
  draw();
}

function gotPlane(part) {
  if (!part || part.error) return;
  if (part.kind === "map") shown.map = { ...part, image: null };
  else shown.curves = part;
  draw();
}

let spoken = "";
let speaking = 0;

/** The sentence above the figures; read aloud when it has stood for half a second. */
function say(text) {
  $("summary").textContent = text;
  clearTimeout(speaking);
  speaking = setTimeout(() => {
    if (text === spoken) return;
    spoken = text;
    $("spoken").textContent = text;
  }, 500);
}

function summary() {
  const { trace, states } = shown;
  if (!trace) return "Computing…";
  const stable = states.filter((p) => p.regime === "stable").length;
  const found = trace.pulsing;
  const cycle = trace.request.settled && trace.cycle;
  const points = `${states.length} fixed point${states.length === 1 ? "" : "s"}, ${stable} stable`;
  if (found.regime === "self-pulsing") {
    const now = cycle || found;
    const what = cycle ? "Self-pulsing, settled cycle" : `Self-pulsing, last cycle of ${state.duration} µs`;
    const memory = cycle ? ` A deviation shrinks to ${(100 * cycle.slowest).toPrecision(3)} % in one cycle.` : "";
    const none = trace.request.settled && !cycle ? " No stable cycle was found near it: the pulses may not repeat." : "";
    return `${what}: period ${now.period.toPrecision(5)} ns, duty ${now.duty.toFixed(3)}, temperature swing ${now.swing.toPrecision(4)} K. ${points}.${memory}${none}`;
  }
  const rest = states.find((p) => p.regime === "stable");
  if (found.regime === "stable") return `The ring comes to rest${rest ? ` at ΔT = ${shown.trace.rows.at(-1).toPrecision(4)} K` : ""}. ${points}.`;
  return `Still moving after ${state.duration} µs: run longer to see whether it pulses. ${points}.`;
}

/** The stretch of time that the figures of the trace show: two settled cycles, the last cycles, or all from cold. */
function stretch() {
  const { trace } = shown;
  if (!trace) return null;
  const found = trace.pulsing;
  if (state.view === "cycle" && trace.cycle) {
    const one = columns(trace.cycle.rows, 0, trace.cycle.count);
    const two = (x, shift) => {
      const out = new Float64Array(2 * x.length);
      out.set(x);
      out.set(x.map((v) => v + shift), x.length);
      return out;
    };
    return { t: two(one.t, trace.cycle.period), U: two(one.U, 0), N: two(one.N, 0), dT: two(one.dT, 0) };
  }
  const count = trace.rows.length / 5;
  const end = trace.rows[5 * (count - 1)];
  let from = 0;
  if (state.view !== "cold" && found.regime === "self-pulsing") {
    const begin = end - 4 * found.period;
    while (from < count - 8 && trace.rows[5 * from] < begin) from++;
  }
  return columns(trace.rows, from, count);
}

function draw() {
  if (drawn) return;
  drawn = true;
  requestAnimationFrame(() => {
    drawn = false;
    paint();
  });
}

const widthOf = (id) => Math.max(280, Math.min(760, $(id).clientWidth || 400));

function put(id, svg) {
  $(id).innerHTML = svg;
}

function paint() {
  const colours = theme();
  const window = data.rings[state.ring].window;
  if (shown.map && !shown.map.image) shown.map.image = mapImage(shown.map, colours);
  const w = widthOf("plane");
  shown.plane = planeFigure(w, Math.round(Math.min(0.86 * w, 470)), { window, map: shown.map, curves: shown.curves, cycles: bordersOf(state, data), state }, colours);
  put("plane", shown.plane.svg);
  const now = stretch();
  const drop = dropRate(ringOf(state, data)) * NS;
  if (now && now.t.length > 3) {
    put("traces", tracesFigure(widthOf("traces"), Math.round(Math.min(0.86 * w, 470)), { ...now, drop }, colours));
    const around = state.view === "cold" ? now : now;
    put("phase-portrait", phaseFigure(widthOf("phase-portrait"), 330, { ...around, states: shown.states }, colours));
  }
  if (shown.points.length) {
    const range = [2.5 * window.detuning[0], 1.2 * window.detuning[1]];
    put("transmission", transmissionFigure(widthOf("transmission"), 330, { points: shown.points, states: shown.states, state, drop, window: range }, colours));
  }
  paintHeat(colours);
}

function present() {
  const { trace } = shown;
  if (!trace || trace.pulsing.regime !== "self-pulsing") return { period: 0, duty: 1 / 3 };
  const now = trace.cycle || trace.pulsing;
  return { period: now.period * NS, duty: now.duty };
}

function paintHeat(colours) {
  const models = data.models.map((model, k) => (k === state.model ? modelOf(state, data) : model)).filter((model, k) => k === state.model || !(model.hidden || model.family));
  const { period, duty } = present();
  const chosen = models.findIndex((model) => model.name === data.models[state.model].name);
  put("step", stepFigure(widthOf("step"), 380, { models, chosen, reference: data.reference }, colours));
  put("spectrum", spectrumFigure(widthOf("spectrum"), 380, { models, chosen, period }, colours));
  if (!$("error-figure").hidden) {
    const { svg, now } = errorFigure(widthOf("error"), 380, { models, judge: data.judge, chosen, period, duty }, colours);
    put("error", svg);
    const percent = (x) => (Number.isFinite(x) ? `${x >= 0 ? "+" : "−"}${Math.abs(100 * x).toFixed(Math.abs(x) < 0.1 ? 1 : 0)} %` : "no such period");
    $("error-now").textContent = now.length ? `At the present period, ${(period * 1e9).toFixed(0)} ns: ${now.map((m) => `${m.name} ${percent(m.error)}`).join("; ")}.` : "The ring does not pulse at this setting.";
  }
  drawSection();
}

/** The field at one phase of the cycle, from the absorbed power of the trace. */
function drawSection() {
  if (!data.section || !shown.trace) return;
  const colours = theme();
  if (!shown.section) shown.section = thermalCycle();
  const { states, top, times } = shown.section;
  const field = fieldOf(data.section, states(shown.phase));
  put("section", sectionFigure(widthOf("section"), { section: data.section, image: fieldImage(data.section, field, top, colours), top }, colours));
  $("phase-text").textContent = times ? `${(shown.phase * times).toFixed(0)} ns of ${times.toFixed(0)} ns` : "at rest";
}

/** States of the modes over the present cycle, or at the end of a trace that rests. */
function thermalCycle() {
  const { trace } = shown;
  const { section } = data;
  const system = systemOf(trace.request.ring, trace.request.model);
  const found = trace.pulsing;
  const heat = (c) => Float64Array.from(c.t, (_, i) => absorbedPower(c.U[i], c.N[i], system) * UW);
  if (found.regime !== "self-pulsing") {
    const last = columns(trace.rows, trace.rows.length / 5 - 4, trace.rows.length / 5);
    const power = heat(last)[3];
    const x = Float64Array.from(section.R, (R) => R * power);
    return { states: () => x, top: peak(section, x), times: 0 };
  }
  let c;
  if (trace.cycle) c = columns(trace.cycle.rows, 0, trace.cycle.count);
  else {
    const n = trace.rows.length / 5;
    let [a, b] = [0, n - 1];
    while (a < n && trace.rows[5 * a] < found.begin) a++;
    while (b > a && trace.rows[5 * b] > found.end) b--;
    c = columns(trace.rows, a, b + 1);
  }
  const times = c.t.map((t) => (t - c.t[0]) * NS);
  const whole = times[times.length - 1];
  const cycle = periodicStates(section, times, heat(c));
  let top = 0;
  for (let k = 0; k < 24; k++) top = Math.max(top, peak(section, cycle.at((k / 24) * whole)));
  return { states: (phase) => cycle.at(phase * whole), top, times: whole / NS };
}

function peak(section, x) {
  return Math.max(fieldOf(section, x).reduce((a, b) => Math.max(a, b), 0), 1e-9);
}

let playing = 0;

function play() {
  if (playing) {
    cancelAnimationFrame(playing);
    playing = 0;
    $("play").textContent = "Play";
    return;
  }
  $("play").textContent = "Pause";
  const begun = performance.now() - 4000 * shown.phase;
  const frame = (now) => {
    shown.phase = ((now - begun) / 4000) % 1;
    $("phase").value = String(shown.phase);
    drawSection();
    playing = requestAnimationFrame(frame);
  };
  playing = requestAnimationFrame(frame);
}

/** The laser is dragged on the plane with the pointer, and moved with the arrow keys. */
function watchPlane() {
  const target = $("plane");
  const move = (event) => {
    const rect = target.querySelector("svg").getBoundingClientRect();
    const { x, y, box } = shown.plane;
    const clamp = (v, low, size) => Math.min(Math.max(v, low), low + size);
    const nu = x.invert(clamp(event.clientX - rect.left, box.left, box.width));
    const level = y.invert(clamp(event.clientY - rect.top, box.top, box.height));
    take("detuning", Number(nu.toFixed(2)), true);
    take("power", Number(level.toFixed(3)), true);
  };
  target.addEventListener("pointerdown", (event) => {
    target.setPointerCapture(event.pointerId);
    move(event);
    target.focus({ preventScroll: true });
    event.preventDefault();
  });
  target.addEventListener("pointermove", (event) => event.buttons && target.hasPointerCapture(event.pointerId) && move(event));
  target.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!steps) return;
    event.preventDefault();
    const window = data.rings[state.ring].window;
    const fine = event.shiftKey ? 500 : 100;
    take("detuning", Number((state.detuning + (steps[0] * (window.detuning[1] - window.detuning[0])) / fine).toPrecision(8)), true);
    take("power", Number((state.power + (steps[1] * (window.power[1] - window.power[0])) / fine).toPrecision(8)), true);
  });
}

/** Where the page lies; inside a report or a notebook it has no address of its own. */
function address() {
  return ["file:", "http:", "https:"].includes(location.protocol) ? location.href.split("#")[0] : "ring.html";
}

function recolour() {
  if (shown.map) shown.map.image = null;
  draw();
}

async function copy(text, what) {
  $("copied-text").value = text;
  $("copied").hidden = false;
  try {
    await navigator.clipboard.writeText(text);
    $("copied-note").textContent = `${what} copied. It stands below as well.`;
  } catch {
    $("copied-note").textContent = `${what}: select and copy it below.`;
    $("copied-text").focus();
    $("copied-text").select();
  }
}

/** The trace that is shown, SI, with the fields of coupled.simulate. */
function traceTable() {
  const { t, U, N, dT } = stretch();
  const ring = ringOf(state, data);
  const system = systemOf(ring, modelOf(state, data));
  const rows = ["time_s,energy_J,carriers_per_m3,delta_T_K,drop_W,absorbed_W"];
  for (let i = 0; i < t.length; i++) {
    const drop = 2 * dropRate(ring) * NS * U[i] * UW;
    rows.push([t[i] * NS, U[i] * FJ, N[i] * DENSITY, dT[i], drop, absorbedPower(U[i], N[i], system) * UW].join(","));
  }
  return `${rows.join("\n")}\n`;
}

// for tests, and for whoever wants to compute in the console
globalThis.ringPage = { classify, columns, derivedRates, engineOf, foldCurves, hopfCurves, hopfPoints, integrate, limitCycle, methodOf, periodError, shiftAt: (U, system) => balance(U, system).shift, steadyStates, stepResponse, survey, systemOf, cold, commandOf, driveOf, pythonOf, turnOf, state: () => ({ ...state }), shown }; // prettier-ignore

if (typeof document === "undefined") serve(globalThis);
else if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
else start();

