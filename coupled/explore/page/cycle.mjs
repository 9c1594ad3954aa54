// The settled cycle as the root of the return map.
//
//   phi_T(y) - y = 0 on the section N = level; Newton with the derivative of the flow along the steps taken.

import { eigenvalues, solve } from "./eigen.mjs";
import { EVENT, flowAlong, integrate, slopes } from "./kernel.mjs";
import { columns, dutyOf, tipsOf } from "./pulsing.mjs";

/** From a state on the section N = level, through `pattern` returns to it: { y, t, steps }, or null. */
function around(system, drive, detuning, start, level, pattern, longest, options) {
  let y = start;
  let t = 0;
  const steps = [];
  for (let k = 0; k < pattern; k++) {
    const event = { level, leaving: true };
    const run = integrate(system, drive, detuning, y, longest, { ...options, event, steps: true, first: 0.1 / system.loss });
    if (run.ended !== EVENT) return null;
    steps.push(...run.steps);
    y = run.y;
    t += run.t;
  }
  return { y, t, steps };
}

/** The step of Newton's method on the section: (I - DP)^-1 residual, DP = M - f (row N of M)/f_N without N. */
function correction(system, drive, detuning, M, end, residual) {
  const m = end.length;
  const f = slopes(system, drive, detuning, end).rate;
  const keep = Array.from(end, (_, i) => i).filter((i) => i !== 2);
  const row = (i) => keep.map((j) => (i === j ? 1 : 0) - (M[i * m + j] - (f[i] * M[2 * m + j]) / f[2]));
  const step = solve(keep.map((i) => [...row(i), residual[i]]));
  return Float64Array.of(step[0], step[1], 0, ...step.slice(2));
}

/**
 * The settled cycle from a state near it, for N through `level`: { period (ns), y, rows, count, multipliers, duty,
 * swing, residual }, or null where Newton's method does not find one.
 *
 * options: rough and fine { method, rtol }, guess of the period (ns), pattern, close: relative residuals at which it is
 * found, and found if they no longer fall, renew: the share of the last residual above which the derivative is computed anew.
 */
export function limitCycle(system, drive, detuning, near, level, options) {
  const { rough, fine, period, pattern = 1, close = [1e-10, 1e-7], renew = 0.1 } = options;
  const longest = 3 * period;
  const approach = integrate(system, drive, detuning, near, longest, { ...rough, event: { level } });
  if (approach.ended !== EVENT) return null;
  const largest = (values) => values.slice(3).reduce((most, x) => Math.max(most, Math.abs(x)), 0); // of the poles
  let { y } = approach;
  let [M, at, size] = [null, null, Infinity];
  for (let iteration = 0; iteration < 14; iteration++) {
    const accurate = size < 1e-3 ? fine : rough;
    at = around(system, drive, detuning, y, level, pattern, longest, accurate);
    if (!at || at.y[2] <= 0) return null;
    const residual = at.y.map((v, i) => v - y[i]);
    const heat = y.slice(3).reduce((sum, x) => sum + Math.abs(x), 1e-12);
    const before = size;
    size = Math.max(Math.hypot(residual[0], residual[1]) / Math.hypot(y[0], y[1]), largest(residual) / heat);
    if (!(size < 10)) return null;
    if (accurate === fine && (size < close[0] || (size < close[1] && size > 0.3 * before))) break;
    if (!M || size > renew * before) {
      const along = accurate === rough ? at : around(system, drive, detuning, y, level, pattern, longest, rough);
      if (!along) return null;
      M = flowAlong(system, drive, detuning, y, along.steps, rough.method);
    }
    const step = correction(system, drive, detuning, M, at.y, residual);
    const damped = Math.min(1, (0.5 * heat) / Math.max(largest(step), 1e-300));
    y = y.map((v, i) => v + damped * step[i]);
  }
  if (!(size < 10 * close[1])) return null;
  if (!M || fine !== rough) M = flowAlong(system, drive, detuning, y, at.steps, fine.method);
  const { rows, count } = integrate(system, drive, detuning, y, at.t, { ...fine, first: 0.1 / system.loss });
  const c = columns(rows, 0, count);
  const [coldest, hottest] = tipsOf(c.t, c.dT);
  const duty = dutyOf(c.t, c.U, 0, at.t, tipsOf(c.t, c.U));
  return { period: at.t, y, level, rows, count, multipliers: eigenvalues(M, y.length), duty, swing: hottest - coldest, residual: size };
}

/** The largest modulus of the multipliers but the one nearest to 1, which belongs to a shift in time. */
export function settling({ re, im }) {
  const sizes = Array.from(re, (x, k) => ({ off: Math.hypot(x - 1, im[k]), size: Math.hypot(x, im[k]) }));
  sizes.sort((a, b) => a.off - b.off);
  return Math.max(0, ...sizes.slice(1).map(({ size }) => size));
}
