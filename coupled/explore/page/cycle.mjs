// Does a trace pulse, and how (coupled/pulsing.py); and the settled cycle as the root of the return map.
//
//   phi_T(y) - y = 0 on the section N = level; Newton with the derivative of the flow along the steps taken.

import { eigenvalues, solve } from "./eigen.mjs";
import { flow } from "./equations.mjs";
import { EVENT, integrate, replay } from "./integrate.mjs";

const DUTY_LEVEL = 0.45;
const SETTLED = 0.02;
const GONE = 0.2;
const LEFT = 0.8;

/** Columns of rows (t, Re a, Im a, N, dT): { t, U, N, dT } from row `first` to `stop`. */
export function columns(rows, first, stop) {
  const n = stop - first;
  const [t, U, N, dT] = [0, 1, 2, 3].map(() => new Float64Array(n));
  for (let i = 0; i < n; i++) {
    const at = 5 * (first + i);
    t[i] = rows[at];
    U[i] = rows[at + 1] ** 2 + rows[at + 2] ** 2;
    N[i] = rows[at + 3];
    dT[i] = rows[at + 4];
  }
  return { t, U, N, dT };
}

/** When sign x rises through sign level, on the cubic through the four samples around each (kernels/levels.py). */
export function rises(t, x, level, sign = 1) {
  const out = [];
  for (let at = 0; at + 1 < t.length; at++) {
    if (!(sign * x[at] < sign * level && sign * x[at + 1] >= sign * level)) continue;
    const i = Math.min(Math.max(at - 1, 0), t.length - 4);
    const [s0, s1, s2, s3] = [t[i], t[i + 1], t[i + 2], t[i + 3]];
    const [v0, v1, v2, v3] = [x[i] - level, x[i + 1] - level, x[i + 2] - level, x[i + 3] - level];
    const a = (v1 - v0) / (s1 - s0);
    const b = (v2 - v1) / (s2 - s1);
    const c = (v3 - v2) / (s3 - s2);
    const ab = (b - a) / (s2 - s0);
    const abc = ((c - b) / (s3 - s1) - ab) / (s3 - s0);
    let [left, right] = [t[at], t[at + 1]];
    for (let k = 0; k < 48; k++) {
      const middle = 0.5 * (left + right);
      const value = v0 + (middle - s0) * (a + (middle - s1) * (ab + (middle - s2) * abc));
      if (sign * value < 0) left = middle;
      else right = middle;
    }
    out.push(0.5 * (left + right));
  }
  return out;
}

function extent(x, first = 0, stop = x.length) {
  let low = Infinity;
  let high = -Infinity;
  for (let i = first; i < stop; i++) {
    if (x[i] < low) low = x[i];
    if (x[i] > high) high = x[i];
  }
  return [low, high];
}

/** Largest minus smallest value of a smooth function within its samples, by the parabolas through the outermost three. */
function swingOf(t, x) {
  const outermost = (sign) => {
    let k = 1;
    for (let i = 2; i + 1 < x.length; i++) if (sign * x[i] > sign * x[k]) k = i;
    const [h, g] = [t[k] - t[k - 1], t[k + 1] - t[k]];
    const [a, b] = [(x[k] - x[k - 1]) / h, (x[k + 1] - x[k]) / g];
    const slope = (a * g + b * h) / (h + g);
    return b === a ? x[k] : x[k] - (slope * slope * (h + g)) / (4 * (b - a));
  };
  return outermost(1) - outermost(-1);
}

function firstAt(t, time) {
  let low = 0;
  let high = t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Fraction of [begin, end] with the drop power, or energy, above min + 0.45 (max - min). */
export function dutyOf(t, U, begin, end) {
  const first = firstAt(t, begin);
  const last = firstAt(t, end);
  const [low, high] = extent(U, first, last);
  const level = low + DUTY_LEVEL * (high - low);
  const from = Math.max(first - 3, 0);
  const to = Math.min(last + 3, t.length);
  const [tt, uu] = [t.subarray(from, to), U.subarray(from, to)];
  const inside = [...rises(tt, uu, level), ...rises(tt, uu, level, -1)].filter((x) => x > begin && x < end);
  const edges = [begin, ...inside.sort((a, b) => a - b), end];
  let above = 0;
  for (let k = 0; k + 1 < edges.length; k++) {
    const middle = (edges[k] + edges[k + 1]) / 2;
    const i = Math.min(Math.max(firstAt(tt, middle), 1), tt.length - 1);
    const f = (middle - tt[i - 1]) / (tt[i] - tt[i - 1]);
    if (uu[i - 1] + f * (uu[i] - uu[i - 1]) > level) above += edges[k + 1] - edges[k];
  }
  return above / (end - begin);
}

function amplitudeLimit(heights) {
  const n = heights.length;
  if (n < 3) return heights[n - 1] > (1 - SETTLED) * heights[0] ? heights[n - 1] : 0;
  const length = Math.max(Math.floor((2 * n) / 9), 1);
  const mean = (k) => heights.slice(n - 3 * length + k * length, n - 3 * length + (k + 1) * length).reduce((a, b) => a + b, 0) / length;
  const [first, middle, last] = [mean(0), mean(1), mean(2)];
  if (last > (1 - SETTLED) * first) return heights[n - 1];
  const curvature = last - middle - (middle - first);
  const limit = curvature > 0 ? last - (last - middle) ** 2 / curvature : -Infinity;
  if (limit > -last) return Math.max(limit, 0);
  return last > 0.9 * first ? heights[n - 1] : NaN;
}

/** How many cycles repeat together: the smallest number after which heights and lengths return, or 1. */
export function patternOf(heights, waits) {
  for (let m = 1; m <= 4; m++) {
    const n = heights.length;
    if (n < 3 * m) return 1;
    const repeats = [heights, waits].every((x) => {
      const size = x.length;
      const allowed = SETTLED * Math.max(...x.slice(size - 3 * m));
      for (let k = size - 2 * m; k < size; k++) if (Math.abs(x[k] - x[k - m]) > allowed) return false;
      return true;
    });
    if (repeats) return m;
  }
  return 1;
}

/**
 * Classify a trace { t (ns), U, N, dT }: regime "self-pulsing", "stable" or "slow transient", and for a pulsing one
 * period (ns), duty, swing (K), begin and end of the last cycle (ns), level of N, pattern. Without carriers U takes the
 * place of N.
 */
export function classify({ t, U, N: carriers, dT }, rtol = 1e-6) {
  const N = carriers.some((x) => x > 0) ? carriers : U;
  const n = t.length;
  const span = t[n - 1] - t[0];
  const [coldest, hottest] = extent(dT, firstAt(t, (t[0] + t[n - 1]) / 2), n);
  const quiet = (regime) => ({ regime, period: NaN, duty: NaN, swing: hottest - coldest, cycles: 0 });
  const noise = Math.min(Math.max(1e-4, 10 * rtol), SETTLED);
  let up = [];
  let waits = [];
  let level = 0;
  let found = false;
  for (const share of [1 / 2, 1 / 4]) {
    const [low, high] = extent(N, firstAt(t, t[n - 1] - share * span), n);
    if (high - low <= noise * high) return quiet("stable");
    level = (low + high) / 2;
    up = rises(t, N, level);
    waits = up.map((x, k) => (k + 1 < up.length ? up[k + 1] : t[n - 1]) - x);
    const w = waits.length;
    const enough = up.length >= 3;
    if (enough && waits[w - 2] <= 1.5 * Math.max(...waits.slice(-6, -2)) && waits[w - 1] <= 1.5 * Math.max(...waits.slice(-6, -1))) {
      found = true;
      break;
    }
  }
  if (!found) return quiet(underWay(t, N));
  const edges = up.map((x) => firstAt(t, x));
  const heights = [];
  for (let k = 0; k + 1 < edges.length; k++) {
    const [low, high] = extent(N, edges[k], edges[k + 1]);
    heights.push(high - low);
  }
  const pattern = patternOf(heights, waits.slice(0, -1));
  const tops = [];
  for (let k = heights.length % pattern; k < heights.length; k += pattern) tops.push(Math.max(...heights.slice(k, k + pattern)));
  const limit = amplitudeLimit(tops);
  const top = tops[tops.length - 1];
  if (limit < GONE * top) return quiet("stable");
  if (!(limit >= LEFT * top)) return quiet("slow transient");
  const begin = up[up.length - 1 - pattern];
  const end = up[up.length - 1];
  const [low, high] = extent(dT, firstAt(t, begin), firstAt(t, end));
  return { regime: "self-pulsing", period: end - begin, duty: dutyOf(t, U, begin, end), swing: high - low, cycles: heights.length, begin, end, level, pattern };
}

/** A trace with fewer than two cycles: at rest or still moving. */
function underWay(t, N) {
  const n = t.length;
  const span = t[n - 1] - t[0];
  const at = (time) => {
    const i = Math.min(Math.max(firstAt(t, time), 1), n - 1);
    return N[i - 1] + ((time - t[i - 1]) / (t[i] - t[i - 1])) * (N[i] - N[i - 1]);
  };
  const [low, high] = extent(N, firstAt(t, t[n - 1] - span / 4), n);
  const values = [at(t[n - 1] - span / 4), at(t[n - 1] - span / 8), N[n - 1]];
  const before = values[1] - values[0];
  const after = values[2] - values[1];
  const ratio = before ? Math.min(Math.max(after / before, 0), 0.95) : 0;
  return (high - low + (Math.abs(after) * ratio) / (1 - ratio)) / high <= SETTLED ? "stable" : "slow transient";
}

/** From a state on the section N = level, through `pattern` returns to it: { y, t, steps }, or null. */
function around(system, drive, detuning, start, level, pattern, longest, options) {
  let y = start;
  let t = 0;
  const steps = [];
  for (let k = 0; k < pattern; k++) {
    const taken = [];
    const event = { level, stop: true, leaving: true };
    const run = integrate(system, drive, detuning, y, longest, { ...options, event, steps: taken, first: 0.1 / system.loss });
    if (run.ended !== EVENT) return null;
    const whole = taken.reduce((sum, h) => sum + h, 0);
    steps.push(...taken, run.t - whole);
    y = run.y;
    t += run.t;
  }
  return { y, t, steps };
}

/**
 * The derivative of the flow along the given steps, column by column, row-major, by differences: one-sided ones for
 * Newton's method, `central` ones for multipliers. Their error grows with the curvature of the flow, for short pulses most.
 */
function monodromy(system, drive, detuning, start, steps, method, central = false) {
  const m = start.length;
  const base = replay(system, drive, detuning, start, steps, method);
  const M = new Float64Array(m * m);
  const field = Math.hypot(start[0], start[1]);
  let heat = 0;
  for (let i = 3; i < m; i++) heat += Math.abs(start[i]);
  for (let j = 0; j < m; j++) {
    const delta = (central ? 3e-7 : 1e-7) * (j < 2 ? field : j === 2 ? start[2] : heat);
    const shifted = (by) => {
      const moved = Float64Array.from(start);
      moved[j] += by;
      return replay(system, drive, detuning, moved, steps, method);
    };
    const after = shifted(delta);
    const before = central ? shifted(-delta) : base;
    const width = central ? 2 * delta : delta;
    for (let i = 0; i < m; i++) M[i * m + j] = (after[i] - before[i]) / width;
  }
  return { M, end: base };
}

/** The step of Newton's method on the section: (I - DP)^-1 residual, DP = M - f (row N of M)/f_N without N. */
function correction(system, drive, detuning, { M, end }, residual) {
  const m = end.length;
  const f = flow(system, drive, detuning, end, new Float64Array(m));
  const keep = [];
  for (let i = 0; i < m; i++) if (i !== 2) keep.push(i);
  const n = m - 1;
  const A = new Float64Array(n * n);
  keep.forEach((i, r) => {
    keep.forEach((j, c) => {
      A[r * n + c] = (i === j ? 1 : 0) - (M[i * m + j] - (f[i] * M[2 * m + j]) / f[2]);
    });
  });
  const step = solve(A, Float64Array.from(keep, (i) => residual[i]), n);
  const out = new Float64Array(m);
  keep.forEach((i, r) => {
    out[i] = step[r];
  });
  return out;
}

/**
 * The settled cycle from a state near it, for N through `level`: { period (ns), y, rows, count, multipliers, duty,
 * swing, residual }, or null where Newton's method does not find one.
 *
 * options: rough and fine { method, rtol }, guess of the period (ns), pattern, exact (multipliers along fine steps), close:
 * relative residuals at which it is found, and found if they no longer fall, renew: the share of the last residual above which
 * the derivative is computed anew.
 */
export function limitCycle(system, drive, detuning, near, level, options) {
  const { rough, fine, period, pattern = 1, exact = false, close = [1e-10, 1e-7], renew = 0.1 } = options;
  const longest = 3 * period;
  const approach = integrate(system, drive, detuning, near, longest, { ...rough, event: { level, stop: true } });
  if (approach.ended !== EVENT) return null;
  let y = approach.y;
  let jet = null;
  let before = Infinity;
  let at = null;
  let size = Infinity;
  for (let iteration = 0; iteration < 14; iteration++) {
    const accurate = size < 1e-3 ? fine : rough;
    at = around(system, drive, detuning, y, level, pattern, longest, accurate);
    if (!at || at.y[2] <= 0) return null;
    const residual = at.y.map((v, i) => v - y[i]);
    const field = Math.hypot(y[0], y[1]);
    let heat = 1e-12;
    let moved = 0;
    for (let i = 3; i < y.length; i++) {
      heat += Math.abs(y[i]);
      moved = Math.max(moved, Math.abs(residual[i]));
    }
    before = size;
    size = Math.max(Math.hypot(residual[0], residual[1]) / field, moved / heat);
    if (!(size < 10)) return null;
    if (accurate === fine && (size < close[0] || (size < close[1] && size > 0.3 * before))) break;
    if (!jet || size > renew * before) {
      const along = accurate === rough ? at : around(system, drive, detuning, y, level, pattern, longest, rough);
      if (!along) return null;
      jet = monodromy(system, drive, detuning, y, along.steps, rough.method);
    }
    const step = correction(system, drive, detuning, jet, residual);
    let grown = 0;
    for (let i = 3; i < y.length; i++) grown = Math.max(grown, Math.abs(step[i]));
    const damped = Math.min(1, (0.5 * heat) / Math.max(grown, 1e-300));
    y = y.map((v, i) => v + damped * step[i]);
  }
  if (!(size < 10 * close[1])) return null;
  if (exact || !jet) {
    const along = around(system, drive, detuning, y, level, pattern, longest, exact ? fine : rough);
    jet = monodromy(system, drive, detuning, y, along.steps, (exact ? fine : rough).method, exact);
  }
  const run = integrate(system, drive, detuning, y, at.t, { ...fine, first: 0.1 / system.loss });
  const c = columns(run.rows, 0, run.count);
  return {
    period: at.t,
    y,
    level,
    rows: run.rows.slice(0, 5 * run.count),
    count: run.count,
    multipliers: eigenvalues(jet.M, y.length),
    duty: dutyOf(c.t, c.U, 0, at.t),
    swing: swingOf(c.t, c.dT),
    residual: size,
  };
}

/** The largest modulus of the multipliers but the one nearest to 1, which belongs to a shift in time. */
export function settling({ re, im }) {
  let trivial = 0;
  for (let k = 0; k < re.length; k++) {
    if (Math.hypot(re[k] - 1, im[k]) < Math.hypot(re[trivial] - 1, im[trivial])) trivial = k;
  }
  let largest = 0;
  for (let k = 0; k < re.length; k++) if (k !== trivial) largest = Math.max(largest, Math.hypot(re[k], im[k]));
  return largest;
}
