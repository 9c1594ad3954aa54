// Heat alone: step response, periodic state and period error of Foster networks, the field of its modes; their figures.

import { bisect } from "./eigen.mjs";
import { boxOf, curve, dot, figure, legendPlaces, stroke } from "./plot.mjs";

/** Rise in K/W after a unit step, at times in s. */
export function stepResponse(model, times) {
  return Float64Array.from(times, (t) => model.R.reduce((sum, R, i) => sum - R * Math.expm1(-t / model.tau[i]), 0));
}

/** Swing in K of the periodic state under a square wave of `power` W: largest minus smallest rise. */
export function swing(model, period, power, duty) {
  let sum = 0;
  for (let i = 0; i < model.R.length; i++) {
    const on = (-duty * period) / model.tau[i];
    const off = (-(1 - duty) * period) / model.tau[i];
    sum -= (model.R[i] * Math.expm1(on) * Math.expm1(off)) / Math.expm1(on + off);
  }
  return power * sum;
}

/** The period at which the model has a swing; 0 or Infinity where none within a factor of 1e4 has. */
export function periodOf(model, target, near, power, duty) {
  const less = (x) => swing(model, Math.exp(x), power, duty) < target;
  const first = Math.log(near);
  const longer = less(first);
  let [from, step] = [first, longer ? Math.log(1.5) : -Math.log(1.5)];
  while (less(from + step) === longer) {
    [from, step] = [from + step, 1.5 * step];
    if (Math.abs(from - first) > Math.log(1e4)) return longer ? Infinity : 0;
  }
  return Math.exp(bisect((x) => less(x) === longer, from, from + step));
}

/** (T - T_model)/T at periods T in s: T_model is where the model has the swing of the reference. */
export function periodError(model, reference, periods, power, duty) {
  return Float64Array.from(periods, (T) => (T - periodOf(model, swing(reference, T, power, duty), T, power, duty)) / T);
}

/**
 * Periodic state of poles under a power that is given at times of one period and linear between them.
 * Returns the states x_i (K) at the first time, and a function that gives them at any time of the period.
 */
export function periodicStates(model, times, powers) {
  const n = model.R.length;
  const advance = (x, h, before, after, out) => {
    for (let i = 0; i < n; i++) {
      const z = h / model.tau[i];
      const decay = Math.exp(-z);
      const rise = z > 1e-8 ? -Math.expm1(-z) / z : 1; // mean of exp over the interval
      // x' = (R P - x)/tau with P linear: exact
      out[i] = decay * x[i] + model.R[i] * (after * (1 - rise) + before * (rise - decay));
    }
    return out;
  };
  const last = times.length - 1;
  const period = times[last] - times[0];
  let x = new Float64Array(n);
  for (let k = 0; k < last; k++) advance(x, times[k + 1] - times[k], powers[k], powers[k + 1], x);
  const start = x.map((v, i) => v / -Math.expm1(-period / model.tau[i]));
  const at = (time) => {
    x = Float64Array.from(start);
    for (let k = 0; k < last && times[k] < time; k++) {
      const stop = Math.min(times[k + 1], time);
      const share = (stop - times[k]) / (times[k + 1] - times[k]);
      advance(x, stop - times[k], powers[k], powers[k] + share * (powers[k + 1] - powers[k]), x);
    }
    return x;
  };
  return { start, at };
}

/** A field in K over the grid: sum_i x_i mode_i + sum_h P_h rest_h; powers in W by name. */
export function fieldOf(section, states, powers = {}) {
  const out = new Float32Array(section.width * section.height);
  const add = (x, { scale, values }) => {
    const factor = x * scale;
    for (let k = 0; k < out.length; k++) out[k] += factor * values[k];
  };
  states.forEach((x, i) => add(x, section.modes[i]));
  for (const [name, power] of Object.entries(powers)) if (section.heaters[name]) add(power, section.heaters[name]);
  return out;
}

function geometric(low, high, n) {
  return Float64Array.from({ length: n }, (_, k) => low * (high / low) ** (k / (n - 1)));
}

export const sumOf = (values) => values.reduce((sum, x) => sum + x, 0);

const BOLTZMANN = 1.380649e-23; // J/K
/** Root mean square of the thermal fluctuations in K at a temperature in K, of the poles: <dT^2> = k_B T^2 sum R/tau. */
export const fluctuation = ({ R, tau }, temperature) => temperature * Math.sqrt(BOLTZMANN * sumOf(R.map((r, k) => r / tau[k])));

/** From a tenth of the fastest to eight times the slowest time constant that matters, s. */
function timeSpan(models) {
  const seen = models.flatMap(({ R, tau }) => tau.filter((_, i) => R[i] >= 1e-3 * sumOf(R)));
  return [Math.min(...seen) / 10, Math.max(...seen) * 8];
}

const colourOf = (k, colours) => colours.series[k % colours.series.length];

/** A figure with one panel, and the names of all models below it. */
function withNames(width, height, { across, up, models, extra = [], zoom, label }, colours, draw) {
  const entries = [...models.map(({ name, place }) => ({ name, colour: colourOf(place, colours) })), ...extra];
  const box = boxOf(width, height, { bottom: 40 + 17 * legendPlaces(entries, boxOf(width, height).width).rows });
  const fig = figure(width, height, colours, zoom);
  fig.panel(box, { log: true, time: true, ...across }, up, (x, y) => draw(x, y, box));
  fig.legend(entries, box);
  return fig.done(label);
}

/** What each heater does to the temperature that the chosen model reads, as models; their colours follow those of all. */
function transfersOf({ heaters = {}, read, tau }, models) {
  const next = Math.max(...models.map(({ place }) => place)) + 1;
  return Object.entries(heaters).map(([name, R], k) => ({ name: `${name} to ${read}`, R, tau, place: next + k }));
}

/** models: { name, R, tau, place } with the place that gives the colour; chosen: the place of the present one. */
export function stepFigure(width, height, { models, chosen, reference, kept, zoom }, colours) {
  const times = geometric(...timeSpan(models), 160);
  const extra = reference ? [{ name: reference.name, colour: colours.ink, mark: "dot" }] : [];
  const across = { domain: [times[0], times.at(-1)], label: "Time after the step" };
  const present = models.find((m) => m.place === chosen);
  const transfers = transfersOf(present, models);
  const drawn = [...models, ...transfers];
  const top = Math.max(...[...drawn, ...(kept ? [kept.model] : [])].map((m) => sumOf(m.R))) / 1e3;
  const up = { domain: [0, 1.06 * top], label: "Rise (K/mW)", read: (t) => stepResponse(present, [t])[0] / 1e3 };
  const label = "Step response of every compact model";
  return withNames(width, height, { across, up, models: drawn, extra, zoom, label }, colours, (x, y) => {
    const line = (model, ...look) => stroke(curve(x, y, times, stepResponse(model, times).map((v) => v / 1e3)), ...look); // prettier-ignore
    let content = kept ? line(kept.model, colours.soft, 1.4, "5 3") : "";
    for (const model of models) content += line(model, colourOf(model.place, colours), model.place === chosen ? 2.8 : 1.6);
    for (const transfer of transfers) content += line(transfer, colourOf(transfer.place, colours), 1.6, "2 3");
    return content + (reference ? reference.times.map((t, k) => dot(x(t), y(reference.rise[k] / 1e3), 3, "none", colours.ink)).join("") : "");
  });
}

const nowLine = (period, x, box, colours) => (period > 0 ? `<path d="M${x(period)} ${box.top}v${box.height}" stroke="${colours.ink}" stroke-dasharray="4 4" stroke-opacity=".6"/>` : "");

export function spectrumFigure(width, height, { models, chosen, period, zoom }, colours) {
  const across = { domain: timeSpan(models), label: "Time constant τᵢ" };
  const up = { domain: [0, (1.08 * Math.max(...models.flatMap((m) => m.R))) / 1e3], label: "Rᵢ (K/mW)" };
  const label = "Time constants and thermal resistances of every compact model";
  return withNames(width, height, { across, up, models, zoom, label }, colours, (x, y, box) => {
    const onTop = [...models].sort((a, b) => (a.place === chosen) - (b.place === chosen));
    const poles = onTop.flatMap(({ R, tau, place }) => {
      const [colour, heavy] = [colourOf(place, colours), place === chosen];
      return tau.map((t, i) => stroke(`M${x(t)} ${y(0)}V${y(R[i] / 1e3)}`, colour, heavy ? 2.4 : 1.2) + dot(x(t), y(R[i] / 1e3), heavy ? 4 : 2.6, colour, "none"));
    });
    return poles.join("") + nowLine(period, x, box, colours);
  });
}

/** Period errors in percent of every model but the judge; the figure, and the errors at the present period. */
export function errorFigure(width, height, { models, judge, chosen, period, duty, zoom }, colours) {
  const others = models.filter((m) => m !== judge);
  const errors = (model, periods) => periodError(model, judge, periods, 2e-3, duty);
  const across = { domain: [1e-7, 1e-5], label: "Period" };
  const periods = geometric(...across.domain, 41);
  const up = { domain: [-60, 60], label: "Period error (%)" };
  const label = `Error of the period that each model gives, against ${judge.name}`;
  const made = withNames(width, height, { across, up, models: others, zoom, label }, colours, (x, y, box) => {
    const band = `<rect x="${box.left}" y="${y(10)}" width="${box.width}" height="${y(-10) - y(10)}" fill="${colours.stable}"/><path d="M${box.left} ${y(0)}h${box.width}" stroke="${colours.soft}"/>`;
    const lines = others.map((model) => {
      const percent = errors(model, periods).map((e) => Math.max(-500, Math.min(500, 100 * e)));
      return stroke(curve(x, y, periods, percent), colourOf(model.place, colours), model.place === chosen ? 2.8 : 1.6);
    });
    return band + lines.join("") + nowLine(period, x, box, colours);
  });
  return { ...made, now: period > 0 ? others.map((m) => ({ name: m.name, error: errors(m, [period])[0] })) : [] };
}
