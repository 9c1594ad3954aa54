// Heat alone: step response, periodic state and period error of Foster networks, and the field of its modes.

import { bisect } from "./eigen.mjs";

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

/** A field in K: sum_i x_i mode_i + sum_h P_h rest_h, as a Float32Array over the grid, or some `places` of it; powers in W by name. */
export function fieldOf(section, states, powers = {}, places = null) {
  const out = new Float32Array(places ? places.length : section.width * section.height);
  const add = (x, { scale, values }) => {
    const factor = x * scale;
    for (let k = 0; k < out.length; k++) out[k] += factor * values[places ? places[k] : k];
  };
  states.forEach((x, i) => add(x, section.modes[i]));
  for (const [name, power] of Object.entries(powers)) if (section.heaters[name]) add(power, section.heaters[name]);
  return out;
}
