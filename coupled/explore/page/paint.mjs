// From what is known to the figures, once a frame, and to the sentence above them.

import { mapImage, phaseFigure, planeFigure, tracesFigure, transmissionFigure } from "./figures.mjs";
import { theme } from "./plot.mjs";
import { columns, firstAt } from "./pulsing.mjs";
import { NS, dropRate, toPicometres } from "./ring.mjs";
import { drawSection } from "./section.mjs";
import { bordersOf, inSight, modelOf, page, planeWindow, put, ringOf, shown, watts, widthOf, windowOf } from "./state.mjs";
import { errorFigure, fluctuation, spectrumFigure, stepFigure, sumOf } from "./thermal.mjs";

const HEAT_EVERY = 150; // ms between two drawings of the figures of heat while a slider moves, so that traces keep 30 frames a second
let drawn = false;
let heatDrawn = 0;
let later = 0;

/** The stretch of time that the figures of the trace show: two settled cycles, the last cycles, or all from cold. */
export function stretch() {
  const { trace } = shown;
  if (!trace) return null;
  if (page.state.view === "cycle" && trace.cycle) {
    const one = columns(trace.cycle.rows, 0, trace.cycle.count);
    const two = (x, shift) => Float64Array.from({ length: 2 * x.length }, (_, i) => (i < x.length ? x[i] : x[i - x.length] + shift));
    return { t: two(one.t, trace.cycle.period), U: two(one.U, 0), re: two(one.re, 0), im: two(one.im, 0), N: two(one.N, 0), dT: two(one.dT, 0) };
  }
  const count = trace.rows.length / 5;
  const all = columns(trace.rows, 0, count);
  if (page.state.view === "cold" || trace.pulsing.regime !== "self-pulsing") return all;
  return columns(trace.rows, Math.max(Math.min(firstAt(all.t, all.t[count - 1] - 4 * trace.pulsing.period), count - 8), 0), count);
}

export function draw() {
  if (drawn) return;
  drawn = true;
  requestAnimationFrame(() => {
    drawn = false;
    paint();
  });
}

/** Rates into both buses of the present ring, 1/ns, and the power of the laser, W. */
export function lightNow() {
  const ring = ringOf(page.state, page.data);
  return { drop: dropRate(ring) * NS, bus: ring.bus_rate * NS, power: watts(page.state.power) };
}

/** Show a figure; while a slider moves, those out of sight wait until it rests. */
function show(id, height, make, content, colours) {
  if (shown.moving && !inSight(id)) return null;
  const figure = make(widthOf(id), height, { ...content, kept: shown.kept, zoom: shown.zoom[id] }, colours);
  put(id, figure);
  return figure;
}

function paint() {
  const [colours, { state, data, }, now, light] = [theme(), page, stretch(), lightNow()]; // prettier-ignore
  const ring = ringOf(state, data);
  paintPlane(ring, colours);
  if (now && now.t.length > 3) {
    show("traces", heightOfPlane(), tracesFigure, { now, light }, colours);
    show("phase-portrait", 330, phaseFigure, { now, states: shown.states }, colours);
  }
  if (shown.points.length) {
    const window = [windowOf(state, data, 2.5).detuning[0], windowOf(state, data, 1.2).detuning[1]];
    show("transmission", 330, transmissionFigure, { points: shown.points, states: shown.states, state, light, window, ring }, colours);
  }
  clearTimeout(later);
  if (shown.moving && performance.now() - heatDrawn < HEAT_EVERY) later = setTimeout(draw, HEAT_EVERY);
  else {
    paintHeat(colours);
    heatDrawn = performance.now();
  }
}

const heightOfPlane = () => Math.round(Math.min(0.86 * widthOf("plane"), 470));

function paintPlane(ring, colours) {
  const { state, data } = page;
  if (shown.map && !shown.map.image) shown.map.image = mapImage(shown.map, colours);
  const window = shown.map ? shown.map.window : planeWindow(state, data);
  const content = { window, map: shown.map, curves: shown.curves, cycles: bordersOf(state, data), units: state.units, ring };
  const plane = show("plane", heightOfPlane(), planeFigure, content, colours);
  if (!plane) return;
  shown.plane = plane;
  $("plane").querySelector(".laser").setAttribute("transform", `translate(${plane.x(state.detuning)} ${plane.y(state.power)})`);
  $("numbers").textContent = numbers(ring, window);
}

/** R_th, pm/K, what heaters do per mW, thermal noise, and the lowest powers of self-pulsing and of bistability in a window of the plane. */
function numbers(ring, { detuning }) {
  const perKelvin = toPicometres(ring.internal.thermal_shift / (2 * Math.PI), ring);
  const lowest = (curves, what) => {
    const inside = curves.flat().filter((p) => p.leading !== false && p.detuning >= 1e9 * detuning[0] && p.detuning <= 1e9 * detuning[1]);
    if (!inside.length) return "";
    const { power, detuning: at } = inside.reduce((a, b) => (a.power < b.power ? a : b));
    return `; ${what} from ${(1e3 * power).toPrecision(3)} mW on, at ${(at / 1e9).toFixed(1)} GHz`.replace("-", "−");
  };
  // below a window of powers, too
  const thresholds = lowest(shown.curves.hopf, "pulses") + lowest(shown.curves.folds, "bistable");
  const model = modelOf(page.state, page.data);
  const jitter = (fluctuation(model, 300) * ring.internal.thermal_shift * 1e3) / (2 * Math.PI); // rad/ns/K: MHz
  const heat = `R_th = ${(1e-3 * sumOf(model.R)).toPrecision(4)} K/mW; ${perKelvin.toPrecision(3)} pm/K`;
  const heaters = Object.entries(model.heaters || {}).map(([name, R]) => {
    const resistance = 1e-3 * sumOf(R);
    return `; ${name} to ${model.read}: ${resistance.toPrecision(4)} K/mW, ${(perKelvin * resistance).toPrecision(3)} pm/mW`;
  });
  return `${heat}${heaters.join("")}; thermal noise ${Math.abs(jitter).toPrecision(2)} MHz rms at 300 K${thresholds}.`;
}

function paintHeat(colours) {
  const { data, state } = page;
  const { trace } = shown;
  const pulses = trace && trace.pulsing.regime === "self-pulsing" && (trace.cycle || trace.pulsing);
  const [period, duty] = pulses ? [pulses.period * NS, pulses.duty] : [0, 1 / 3];
  const visible = (model, k) => k === state.model || k === data.judge || !(model.hidden || model.family);
  const models = data.models.map((model, k) => ({ ...(model.family || k === state.model ? modelOf(state, data, k) : model), place: k })).filter(visible); // prettier-ignore
  const content = { models, chosen: state.model, period, duty };
  show("step", 380, stepFigure, { ...content, reference: data.reference }, colours);
  show("spectrum", 380, spectrumFigure, content, colours);
  const errors = !$("error-figure").hidden && show("error", 380, errorFigure, { ...content, judge: models.find((m) => m.place === data.judge) }, colours);
  if (errors) {
    const percent = (x) => (Number.isFinite(x) ? `${x >= 0 ? "+" : "−"}${Math.abs(100 * x).toFixed(Math.abs(x) < 0.1 ? 1 : 0)} %` : "no such period");
    const each = errors.now.map((m) => `${m.name} ${percent(m.error)}`).join("; ");
    $("error-now").textContent = each ? `At the present period, ${(period * 1e9).toFixed(0)} ns: ${each}.` : "The ring does not pulse at this setting.";
  }
  if (!shown.moving || inSight("section")) drawSection();
}

/** Draw in the colours of another theme. */
export function recolour() {
  if (shown.map) shown.map.image = null;
  draw();
}

let spoken = "";
let speaking = 0;

/** The sentence above the figures; read aloud when it has stood for half a second. */
export function say(text) {
  $("summary").textContent = text;
  clearTimeout(speaking);
  speaking = setTimeout(() => {
    if (text === spoken) return;
    spoken = text;
    $("spoken").textContent = text;
  }, 500);
}

/** What the ring does, in words. */
export function summary() {
  const { trace, states } = shown;
  if (!trace) return "Computing…";
  const stable = states.filter((p) => p.regime === "stable").length;
  const found = trace.pulsing;
  const cycle = trace.request.settled && trace.cycle;
  const points = `${states.length} fixed point${states.length === 1 ? "" : "s"}, ${stable} stable`;
  if (found.regime === "self-pulsing") {
    const now = cycle || found;
    const what = cycle ? "Self-pulsing, settled cycle" : `Self-pulsing, last cycle of ${page.state.duration} µs`;
    const memory = cycle ? ` A deviation shrinks to ${(100 * cycle.slowest).toPrecision(3)} % in one cycle.` : "";
    const none = trace.request.settled && !cycle ? " No stable cycle was found near it: the pulses may not repeat." : "";
    return `${what}: period ${now.period.toPrecision(5)} ns, duty ${now.duty.toPrecision(3)}, temperature swing ${now.swing.toPrecision(4)} K. ${points}.${memory}${none}`;
  }
  const rest = states.find((p) => p.regime === "stable");
  const at = (rise) => ` at ΔT = ${rise.toPrecision(4)} K`;
  if (found.regime === "stable") return `The ring comes to rest${at(found.rest)}. ${points}.`;
  if (found.heat) return `${warmingUp(found)} ${points}.`;
  if (found.leaves !== undefined) return `After ${page.state.duration} µs the nearest fixed point,${at(found.leaves)}, is not stable: run longer to see where the ring goes. ${points}.`;
  const where = stable === 1 ? at(rest.delta_T) : "";
  return `Still moving after ${page.state.duration} µs: run longer to see whether it ${rest ? "comes to rest" : "pulses"}. ${points}${where}.`;
}

/** How far slow heat still has to go, and how long that takes. */
function warmingUp({ heat, wanted }) {
  const [now, end, missing] = [heat.now, heat.end, Math.abs(heat.end - heat.now)].map((rise) => `${rise.toPrecision(3)} K`);
  const microseconds = Number((wanted * 1e-3).toPrecision(2));
  return `After ${page.state.duration} µs slow heat still moves the ring: ΔT = ${now}, ${missing} from the fixed point at ΔT = ${end}. It rests there after some ${microseconds} µs.`;
}
