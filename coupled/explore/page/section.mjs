// The cross-section with the temperature field at one phase of the cycle, and its player.

import { columns } from "./measure.mjs";
import { fieldOf, periodicStates } from "./heat.mjs";
import { theme } from "./plot.mjs";
import { NS, UW, absorbedPower, systemOf } from "./ring.mjs";
import { fieldImage, sectionFigure } from "./thermal.mjs";
import { $, page, put, shown, widthOf } from "./view.mjs";

/** The images of a cross-section from base64 to arrays of 8-bit numbers. */
export function decoded(section) {
  const image = ({ scale, values }) => ({ scale, values: Int8Array.from(atob(values), (c) => (c.charCodeAt(0) << 24) >> 24) });
  const heaters = Object.fromEntries(Object.entries(section.heaters).map(([name, one]) => [name, image(one)]));
  const whole = { ...section, modes: section.modes.map(image), heaters };
  return { ...whole, hot: hotPlaces(whole) };
}

/** Where the field at rest is above half its largest value, under the light or under one of the heaters. */
function hotPlaces(section) {
  const alone = Object.keys(section.heaters).map((name) => fieldOf(section, [], { [name]: 1 }));
  const fields = [fieldOf(section, section.R), ...alone];
  const tops = fields.map((field) => field.reduce((a, b) => Math.max(a, b), 0));
  return Array.from(fields[0].keys()).filter((k) => fields.some((field, i) => field[k] > tops[i] / 2));
}

/** The field at one phase of the cycle, from the absorbed power of the trace. */
export function drawSection() {
  if (!page.data.section || !shown.trace) return;
  const colours = theme();
  if (!shown.section) shown.section = thermalCycle();
  const { states, top, times } = shown.section;
  const field = fieldOf(page.data.section, states(shown.phase), shown.trace.request.model.on);
  put("section", sectionFigure(widthOf("section"), { section: page.data.section, image: fieldImage(page.data.section, field, top, colours), top }, colours));
  $("phase-text").textContent = times ? `${(shown.phase * times).toFixed(0)} ns of ${times.toFixed(0)} ns` : "at rest";
}

/** States of the modes over the present cycle, or at the end of a trace that rests. */
function thermalCycle() {
  const { trace } = shown;
  const { section } = page.data;
  const system = systemOf(trace.request.ring, trace.request.model);
  const found = trace.pulsing;
  const heat = (c) => Float64Array.from(c.t, (_, i) => absorbedPower(c.U[i], c.N[i], system) * UW);
  if (found.regime !== "self-pulsing") {
    const last = columns(trace.rows, trace.rows.length / 5 - 4, trace.rows.length / 5);
    const power = heat(last)[3];
    const x = Float64Array.from(section.R, (R) => R * power);
    return { states: () => x, top: peak(section, x, trace.request.model.on), times: 0 };
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
  for (let k = 0; k < 24; k++) top = Math.max(top, peak(section, cycle.at((k / 24) * whole), trace.request.model.on));
  return { states: (phase) => cycle.at(phase * whole), top, times: whole / NS };
}

function peak(section, x, powers) {
  return Math.max(fieldOf(section, x, powers, section.hot).reduce((a, b) => Math.max(a, b), 0), 1e-9);
}

let playing = 0;

/** Start or stop going through the cycle. */
export function play() {
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
