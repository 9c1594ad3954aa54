// From what is known to the figures, once a frame.

import { mapImage, phaseFigure, planeFigure, tracesFigure, transmissionFigure } from "./figures.mjs";
import { columns } from "./measure.mjs";
import { theme } from "./plot.mjs";
import { NS, derivedRates, dropRate, toPicometres } from "./ring.mjs";
import { drawSection } from "./section.mjs";
import { bordersOf, modelOf, ringOf, windowOf } from "./state.mjs";
import { errorFigure, spectrumFigure, stepFigure } from "./thermal.mjs";
import { $, inSight, page, put, shown, widthOf } from "./view.mjs";

const HEAT_EVERY = 150; // ms between two drawings of the figures of heat while a slider moves, so that traces keep 30 frames a second
let drawn = false;
let heatDrawn = 0;
let later = 0;

/** The stretch of time that the figures of the trace show: two settled cycles, the last cycles, or all from cold. */
export function stretch() {
  const { trace } = shown;
  if (!trace) return null;
  const found = trace.pulsing;
  if (page.state.view === "cycle" && trace.cycle) {
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
  if (page.state.view !== "cold" && found.regime === "self-pulsing") {
    const begin = end - 4 * found.period;
    while (from < count - 8 && trace.rows[5 * from] < begin) from++;
  }
  return columns(trace.rows, from, count);
}

export function draw() {
  if (drawn) return;
  drawn = true;
  requestAnimationFrame(() => {
    drawn = false;
    paint();
  });
}

/** While a slider moves, figures out of sight wait until it rests. */
const due = (id) => !shown.moving || inSight(id);

function paint() {
  const colours = theme();
  paintPlane(colours);
  const now = stretch();
  const drop = dropRate(ringOf(page.state, page.data)) * NS;
  if (now && now.t.length > 3) {
    if (due("traces")) put("traces", tracesFigure(widthOf("traces"), heightOfPlane(), { ...now, drop }, colours));
    if (due("phase-portrait")) put("phase-portrait", phaseFigure(widthOf("phase-portrait"), 330, { ...now, states: shown.states }, colours));
  }
  if (shown.points.length && due("transmission")) {
    const range = [windowOf(page.state, page.data, 2.5).detuning[0], windowOf(page.state, page.data, 1.2).detuning[1]];
    put("transmission", transmissionFigure(widthOf("transmission"), 330, { points: shown.points, states: shown.states, state: page.state, drop, window: range }, colours));
  }
  clearTimeout(later);
  if (shown.moving && performance.now() - heatDrawn < HEAT_EVERY) later = setTimeout(draw, HEAT_EVERY);
  else {
    paintHeat(colours);
    heatDrawn = performance.now();
  }
}

const heightOfPlane = () => Math.round(Math.min(0.86 * widthOf("plane"), 470));

function paintPlane(colours) {
  if (!due("plane")) return;
  if (shown.map && !shown.map.image) shown.map.image = mapImage(shown.map, colours);
  const window = shown.map ? shown.map.window : windowOf(page.state, page.data);
  const cycles = bordersOf(page.state, page.data);
  shown.plane = planeFigure(widthOf("plane"), heightOfPlane(), { window, map: shown.map, curves: shown.curves, cycles }, colours);
  put("plane", shown.plane.svg);
  const inside = shown.curves.hopf.flat().filter((p) => p.leading && p.detuning >= 1e9 * window.detuning[0] && p.detuning <= 1e9 * window.detuning[1]);
  const lowest = inside.length ? inside.reduce((a, b) => (a.power < b.power ? a : b)) : null;
  $("threshold").textContent = lowest ? `The lowest power of a full Hopf line is ${(1e3 * lowest.power).toPrecision(3)} mW, at ${(lowest.detuning / 1e9).toFixed(1)} GHz.` : "";
  const { x, y } = shown.plane;
  $("plane").querySelector(".laser").setAttribute("transform", `translate(${x(page.state.detuning)} ${y(page.state.power)})`);
}

function present() {
  const { trace } = shown;
  if (!trace || trace.pulsing.regime !== "self-pulsing") return { period: 0, duty: 1 / 3 };
  const now = trace.cycle || trace.pulsing;
  return { period: now.period * NS, duty: now.duty };
}

function paintHeat(colours) {
  const { data, state } = page;
  const ring = ringOf(state, data);
  const resistance = modelOf(state, data).R.reduce((sum, R) => sum + R, 0) * 1e-3;
  const perKelvin = toPicometres(derivedRates(ring).thermal_shift / (2e9 * Math.PI), ring);
  $("resistance").textContent = `R_th = ${resistance.toPrecision(4)} K/mW; the resonance moves ${perKelvin.toPrecision(3)} pm/K.`;
  const drawn = data.models.map((_, k) => k).filter((k) => k === state.model || k === data.judge || !(data.models[k].hidden || data.models[k].family));
  const models = drawn.map((k) => (data.models[k].family || k === state.model ? modelOf(state, data, k) : data.models[k]));
  const [chosen, judge] = [state.model, data.judge].map((k) => drawn.indexOf(k));
  const { period, duty } = present();
  if (due("step")) put("step", stepFigure(widthOf("step"), 380, { models, chosen, reference: page.data.reference }, colours));
  if (due("spectrum")) put("spectrum", spectrumFigure(widthOf("spectrum"), 380, { models, chosen, period }, colours));
  if (due("error") && !$("error-figure").hidden) {
    const { svg, now } = errorFigure(widthOf("error"), 380, { models, judge, chosen, period, duty }, colours);
    put("error", svg);
    const percent = (x) => (Number.isFinite(x) ? `${x >= 0 ? "+" : "−"}${Math.abs(100 * x).toFixed(Math.abs(x) < 0.1 ? 1 : 0)} %` : "no such period");
    $("error-now").textContent = now.length ? `At the present period, ${(period * 1e9).toFixed(0)} ns: ${now.map((m) => `${m.name} ${percent(m.error)}`).join("; ")}.` : "The ring does not pulse at this setting.";
  }
  if (due("section")) drawSection();
}

/** Draw in the colours of another theme. */
export function recolour() {
  if (shown.map) shown.map.image = null;
  draw();
}
