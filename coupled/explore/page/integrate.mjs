// Error-controlled integration by Rosenbrock steps; coupled/kernels/control.py.

import { floorOf } from "./ring.mjs";
import { eigenvalues } from "./eigen.mjs";
import { jacobian } from "./equations.mjs";
import { stagesOf } from "./poles.mjs";
import { machineOf, step } from "./rosenbrock.mjs";

export const DONE = 0;
export const TOO_MANY_STEPS = 1;
export const STEP_TOO_SMALL = 2;
export const EVENT = 3;
const QUIET = 1e-2;

/** One component of the dense output at the fraction x of a step; entry `at` of every stage of `k`. */
function dense(x, before, after, k, at, stride, method) {
  const { d, stages } = method;
  let d1 = 0;
  let d2 = 0;
  let d3 = 0;
  for (let j = 0; j < stages; j++) {
    const value = k[at + j * stride];
    d1 += d[j] * value;
    d2 += d[stages + j] * value;
    d3 += d[2 * stages + j] * value;
  }
  return (1 - x) * before + x * (after + (1 - x) * (d1 + x * (d2 + x * d3)));
}

function fastestGrowth(system, detuning, y) {
  const { re, im } = eigenvalues(jacobian(system, detuning, y), y.length);
  let fastest = 0;
  for (let i = 0; i < re.length; i++) if (re[i] > 0) fastest = Math.max(fastest, Math.hypot(re[i], im[i]));
  return fastest;
}

/** Rows (t, Re a, Im a, N, dT) that grow as they are needed; what they hold does not pass through closures. */
function rowsOf(places) {
  return { values: new Float64Array(5 * places), count: 0 };
}

function record(rows, curvature, time, ar, ai, N, z) {
  const at = 5 * rows.count++;
  if (at + 5 > rows.values.length) {
    const wider = new Float64Array(2 * rows.values.length + 5);
    wider.set(rows.values);
    rows.values = wider;
  }
  const { values } = rows;
  values[at] = time;
  values[at + 1] = ar;
  values[at + 2] = ai;
  values[at + 3] = N;
  values[at + 4] = z + curvature * z * z;
}

/** Record the fraction x of a step. */
function between(rows, curvature, time, x, y, out, { u, ends, method }) {
  const at = (i) => dense(x, y[i], out[i], u, i, 4, method);
  record(rows, curvature, time, at(0), at(1), at(2), dense(x, ends[0], ends[1], u, 3, 4, method));
}

/** Where in a step, as a fraction, N rises through a level. */
function crossingOf(level, y, out, { u, method }) {
  let low = 0;
  let high = 1;
  for (let i = 0; i < 52; i++) {
    const x = 0.5 * (low + high);
    if (dense(x, y[2], out[2], u, 2, 4, method) < level) low = x;
    else high = x;
  }
  return high;
}

/** The whole state at the fraction x of a step. */
function stateWithin(x, y, out, { u, method, poles }) {
  const at = new Float64Array(y.length);
  for (let i = 0; i < 3; i++) at[i] = dense(x, y[i], out[i], u, i, 4, method);
  const stages = new Float64Array(method.stages);
  for (let i = 3; i < y.length; i++) {
    stagesOf(poles, i - 3, y, stages);
    at[i] = dense(x, y[i], out[i], stages, 0, 1, method);
  }
  return at;
}

/** x^(1/order), by square roots where they do it. */
function root(x, order) {
  return order === 4 ? Math.sqrt(Math.sqrt(x)) : x ** (1 / order);
}

/** Error of a step in units of what is allowed. */
function errorOf(y, out, { u, ends }, last, floor, rtol) {
  const before = y[0] * y[0] + y[1] * y[1];
  const after = out[0] * out[0] + out[1] * out[1];
  const energy = Math.max(before, after, floor[0] * floor[0]);
  const e0 = (u[last] * u[last] + u[last + 1] * u[last + 1]) / energy;
  const e1 = u[last + 2] / Math.max(Math.abs(y[2]), Math.abs(out[2]), floor[1]);
  const e2 = ends[2] / Math.max(Math.abs(ends[0]), Math.abs(ends[1]), floor[2]);
  return Math.sqrt((e0 + e1 * e1 + e2 * e2) / 3) / rtol;
}

/** The largest change of field, carriers and heat in a step, relative to what they are after it. */
function changeOf(y, out, ends, floor) {
  const dr = out[0] - y[0];
  const di = out[1] - y[1];
  const d0 = Math.sqrt(dr * dr + di * di) / Math.max(Math.sqrt(out[0] * out[0] + out[1] * out[1]), floor[0]);
  const d1 = Math.abs(out[2] - y[2]) / Math.max(Math.abs(out[2]), floor[1]);
  const d2 = Math.abs(ends[1] - ends[0]) / Math.max(Math.abs(ends[1]), floor[2]);
  return Math.max(d0, d1, d2);
}

/**
 * Integrate from y at t = 0 to `stop` ns under a constant laser.
 *
 * options: method, rtol, first (step to try first), event { level, stop } (N rises through level), times (wanted output
 * times, ns), steps (whether to keep the steps taken), maxSteps.
 * Returns rows (t, Re a, Im a, N, dT for each accepted step or wanted time), count, y, t, h, crossings, counts, ended.
 */
export function integrate(system, drive, detuning, start, stop, options) {
  const { method, rtol, first = 0, event = null, times = null, steps = null, maxSteps = 400000 } = options;
  const machine = machineOf(system, drive, detuning, method);
  const { ends } = machine;
  const floor = Float64Array.from(floorOf(system, drive));
  const { curvature } = system;
  const { order } = method;
  const last = 4 * (method.stages - 1);
  const rows = rowsOf(times ? times.length : event ? 512 : 8192);
  const crossings = [];
  let y = Float64Array.from(start);
  let out = new Float64Array(machine.m);
  let t = 0;
  let accepted = 0;
  let rejected = 0;
  let z = 0;
  for (let i = 3; i < y.length; i++) z += y[i];
  if (!times) record(rows, curvature, 0, y[0], y[1], y[2], z);
  else while (rows.count < times.length && times[rows.count] <= 0) record(rows, curvature, times[rows.count], y[0], y[1], y[2], z);
  let seen = event && !event.leaving ? y[2] - event.level : 1;
  let h = first > 0 ? first : 1e-2 / system.loss;
  let hBefore = 0;
  let sizeBefore = 1;
  let growth = 5;
  const quiet = 0.1 * system.tau0;
  let lookAgain = 0;
  let looked = 0;
  let cap = Infinity;
  let ended = DONE;
  const result = () => ({ rows: rows.values, count: rows.count, crossings });
  while (t < stop) {
    if (accepted + rejected >= maxSteps) {
      ended = TOO_MANY_STEPS;
      break;
    }
    const landing = t + 1.0001 * h >= stop;
    if (landing) h = stop - t;
    step(machine, y, h, out);
    const error = errorOf(y, out, machine, last, floor, rtol);
    const size = root(Math.max(error, 1e-8), order);
    if (!(error <= 1)) {
      rejected++;
      growth = 1;
      h *= error < Infinity ? Math.max(0.2, 0.9 / size) : 0.2;
      if (h < 1e-13 * Math.max(Math.abs(t), 1e-3)) {
        ended = STEP_TOO_SMALL;
        break;
      }
      continue;
    }
    if (event) {
      const rest = out[2] - event.level;
      if (seen < 0 && rest >= 0) {
        const x = crossingOf(event.level, y, out, machine);
        crossings.push(t + x * h);
        if (event.stop) {
          if (!times) between(rows, curvature, t + x * h, x, y, out, machine);
          return { ...result(), y: stateWithin(x, y, out, machine), t: t + x * h, h, accepted: accepted + 1, rejected, ended: EVENT };
        }
      }
      seen = rest;
    }
    if (times) {
      while (rows.count < times.length && (landing || times[rows.count] <= t + h)) {
        between(rows, curvature, times[rows.count], (times[rows.count] - t) / h, y, out, machine);
      }
    } else record(rows, curvature, landing ? stop : t + h, out[0], out[1], out[2], ends[1]);
    accepted++;
    if (steps) steps.push(h);
    t = landing ? stop : t + h;
    const before = y;
    y = out;
    out = before;
    let factor = 0.9 / size;
    if (hBefore > 0) factor = Math.min(factor, ((factor * h) / hBefore) * (sizeBefore / size));
    hBefore = h;
    sizeBefore = Math.max(size, 0.3);
    h *= Math.max(0.2, Math.min(growth, factor));
    growth = 5;
    if (h > quiet) {
      if (changeOf(before, y, ends, floor) > QUIET) {
        looked = 0;
        cap = Infinity;
      } else if (h > 4 * looked || accepted >= lookAgain) {
        looked = h;
        lookAgain = accepted + 20;
        const fastest = fastestGrowth(system, detuning, y);
        cap = fastest > 0 ? 0.25 / fastest : Infinity;
      }
      h = Math.min(h, cap);
    }
  }
  return { ...result(), y, t, h, accepted, rejected, ended };
}

/** The state after the given steps: the same map for every start, so that differences of it are smooth. */
export function replay(system, drive, detuning, start, steps, method) {
  const machine = machineOf(system, drive, detuning, method);
  let y = Float64Array.from(start);
  let out = new Float64Array(machine.m);
  for (const h of steps) {
    step(machine, y, h, out);
    const before = y;
    y = out;
    out = before;
  }
  return y;
}
