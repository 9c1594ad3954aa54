// Numbers read off a trace, and whether it pulses, rests, or still moves (coupled/runs/pulsing.py, repetition.py). Every
// sample is an accepted step.

import { bisect } from "./eigen.mjs";

const DUTY_LEVEL = 0.45;

/** Columns of rows (t, Re a, Im a, N, dT): { t, U, N, dT } from row `first` to `stop`. */
export function columns(rows, first, stop) {
  const column = (value) => Float64Array.from({ length: stop - first }, (_, i) => value(5 * (first + i)));
  const [re, im] = [column((k) => rows[k + 1]), column((k) => rows[k + 2])];
  return { t: column((k) => rows[k]), re, im, U: re.map((x, i) => x * x + im[i] * im[i]), N: column((k) => rows[k + 3]), dT: column((k) => rows[k + 4]) }; // prettier-ignore
}

/** When sign x rises through sign level, on the cubic through the four samples around each. */
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
    const below = (s) => sign * (v0 + (s - s0) * (a + (s - s1) * (ab + (s - s2) * abc))) < 0;
    out.push(bisect(below, t[at], t[at + 1], 48));
  }
  return out;
}

/** Smallest and largest value among the samples from `first` to `stop`. */
export function extent(x, first = 0, stop = x.length) {
  let [low, high] = [Infinity, -Infinity];
  for (let i = first; i < stop; i++) [low, high] = [Math.min(low, x[i]), Math.max(high, x[i])];
  return [low, high];
}

/** Largest minus smallest of these values. */
function rangeOf(...samples) {
  const [low, high] = extent(...samples);
  return high - low;
}

/** Smallest and largest value of a smooth function within its samples, by the parabolas through the outermost three. */
export function tipsOf(t, x) {
  const outermost = (sign) => {
    let k = 1;
    for (let i = 2; i + 1 < x.length; i++) if (sign * x[i] > sign * x[k]) k = i;
    const [h, g] = [t[k] - t[k - 1], t[k + 1] - t[k]];
    const [a, b] = [(x[k] - x[k - 1]) / h, (x[k + 1] - x[k]) / g];
    const slope = (a * g + b * h) / (h + g);
    return b === a ? x[k] : x[k] - (slope * slope * (h + g)) / (4 * (b - a));
  };
  return [outermost(-1), outermost(1)];
}

/** The first sample at or after a time. */
export function firstAt(t, time) {
  let low = 0;
  let high = t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Fraction of [begin, end] with the drop power, or energy, above min + 0.45 (max - min); `tips` are min and max. */
export function dutyOf(t, U, begin, end, tips = null) {
  const first = firstAt(t, begin);
  const last = firstAt(t, end);
  const [low, high] = tips || extent(U, first, last);
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

const SETTLED = 0.02; // relative change that counts as none
const FAR = 0.1; // relative change of the period per cycle above which no period is given
const LONGEST_PATTERN = 4;
const QUIET_RANGE = 1e-4; // relative range of the carriers that is no oscillation
const GONE = 0.2; // share of the last amplitude: an oscillation whose limit is smaller decays to rest
const GROWS = 1e-3; // relative movement in the last eighth that counts where it was smaller before
const PLACES = 64; // of an eighth of a trace, where it is read

/**
 * Classify a trace { t (ns), U, N, dT }: regime "self-pulsing", "stable" or "slow transient", swing (K) and cycles. A pulsing
 * one has period (ns), duty, begin and end of the last cycle (ns), level of N and pattern. Without carriers U takes the
 * place of N.
 */
export function classify({ t, U, N: carriers, dT }, rtol = 1e-6) {
  const N = carriers.some((x) => x > 0) ? carriers : U;
  const n = t.length;
  const late = firstAt(t, (t[0] + t[n - 1]) / 2);
  const quiet = { regime: "stable", period: NaN, duty: NaN, swing: rangeOf(dT, late), cycles: 0 };
  const noise = Math.min(Math.max(QUIET_RANGE, 10 * rtol), SETTLED);
  const { rests, up, waits, level, repeats } = risesOf(t, N, noise);
  if (rests) return quiet;
  if (!repeats) return underWay(t, N, { ...quiet, cycles: Math.max(up.length - 1, 0) });
  const heights = heightsOf(t, N, up);
  quiet.cycles = heights.length;
  let pattern = patternOf(heights, waits);
  const tops = topsOf(heights, pattern);
  const limit = amplitudeLimit(tops);
  const top = tops.at(-1);
  if (limit < GONE * top) return quiet;
  const slow = { ...quiet, regime: "slow transient" };
  if (!(Math.abs(limit / top - 1) <= SETTLED) || top < (1 - SETTLED) * Math.max(...tops.slice(-2))) return slow;
  if (pattern === 1 && alternate(heights)) return slow;
  if (pattern === 1 && doubled(heights, 10 * noise)) pattern = 2;
  const [earlier, drift] = driftOf(up, pattern);
  if (Math.abs(drift) > longestChange(earlier, drift, heights.length > 2 * pattern)) return slow;
  const [begin, end] = [up.at(-1 - pattern), up.at(-1)];
  const swing = rangeOf(dT, firstAt(t, begin), firstAt(t, end));
  return { regime: "self-pulsing", period: end - begin, duty: dutyOf(t, U, begin, end), swing, cycles: heights.length, begin, end, level, pattern };
}

/** Where N rises through the middle of its late range, and how long each cycle takes; a slow drift may hide a small oscillation. */
function risesOf(t, N, noise) {
  const n = t.length;
  let up = [];
  for (const share of [1 / 2, 1 / 4]) {
    const [low, high] = extent(N, firstAt(t, t[n - 1] - share * (t[n - 1] - t[0])), n);
    if (high - low <= noise * high) return { rests: true };
    const level = (low + high) / 2;
    up = rises(t, N, level);
    const waits = up.map((x, k) => (k + 1 < up.length ? up[k + 1] : t[n - 1]) - x); // the last one is still running
    const usual = (stop) => 1.5 * Math.max(...waits.slice(-6, stop));
    if (up.length >= 3 && waits.at(-2) <= usual(-2) && waits.at(-1) <= usual(-1)) return { up, waits: waits.slice(0, -1), level, repeats: true };
  }
  return { up };
}

/** Range of N in every cycle. */
function heightsOf(t, N, up) {
  const edges = up.map((x) => firstAt(t, x));
  return edges.slice(1).map((stop, k) => rangeOf(N, edges[k], stop));
}

/** The largest height of every pattern, the last one at the end. */
function topsOf(heights, pattern) {
  const tops = [];
  for (let k = heights.length % pattern; k < heights.length; k += pattern) tops.push(Math.max(...heights.slice(k, k + pattern)));
  return tops;
}

/** The last two relative changes of the length of a pattern from one to the next; 0 where there are fewer. */
function driftOf(up, pattern) {
  const lengths = [];
  for (let k = up.length - 1; k >= pattern; k -= pattern) lengths.push(up[k] - up[k - pattern]);
  const change = (k) => (k + 1 < lengths.length ? lengths[k] / lengths[k + 1] - 1 : 0);
  return [change(1), change(0)];
}

/** Values of x at a time, linear between samples. */
function valueAt(t, x, time) {
  const i = Math.min(Math.max(firstAt(t, time), 1), t.length - 1);
  return x[i - 1] + ((time - t[i - 1]) / (t[i] - t[i - 1])) * (x[i] - x[i - 1]);
}

/** Values of x at equal distances from one share of the trace before its end to another. */
function valuesIn(t, x, from, to) {
  const end = t[t.length - 1];
  const passed = end - t[0];
  return Float64Array.from({ length: PLACES }, (_, k) => valueAt(t, x, end - passed * (from + ((to - from) * k) / (PLACES - 1))));
}

/** A trace with fewer than two cycles, or whose oscillation has ended: at rest or still moving. */
function underWay(t, N, quiet) {
  const n = t.length;
  const passed = t[n - 1] - t[0];
  const [low, high] = extent(N, firstAt(t, t[n - 1] - passed / 4), n);
  const [first, middle, last] = [1 / 4, 1 / 8, 0].map((share) => valueAt(t, N, t[n - 1] - share * passed));
  const [before, after] = [middle - first, last - middle];
  const ratio = before ? Math.min(Math.max(after / before, 0), 0.95) : 0;
  const left = (Math.abs(after) * ratio) / (1 - ratio); // of an exponential
  const range = (from, to) => rangeOf(valuesIn(t, N, from, to));
  const grows = range(1 / 8, 0) > Math.max(range(1 / 4, 1 / 8), GROWS * high);
  if ((high - low + left) / high <= SETTLED && !grows) return quiet;
  return { ...quiet, regime: "slow transient" };
}

/**
 * A stable trace { t, U, dT }, unless the fixed point at its end is unstable or still far. `points` are all fixed points
 * { U, dT, growth (1/ns) }, of which there is at least one.
 *
 * `rest` is the rise (K) of the fixed point at which the ring comes to rest. Of a slow transient `heat` holds the rise at
 * the end of the trace and at that fixed point, { now, end }, and `wanted` how long a run should be (ns); or `leaves` the rise of the
 * nearest one if it is not stable.
 */
export function lasting(found, { t, U, dT }, points) {
  const mean = (x) => valuesIn(t, x, 1 / 8, 0).reduce((sum, value) => sum + value, 0) / PLACES;
  const [energy, now] = [mean(U), mean(dT)];
  const apart = (a, b) => Math.abs(a - b) / Math.max(Math.abs(a), Math.abs(b) + 1e-99);
  const offs = points.map((p) => Math.max(apart(p.U, energy), apart(p.dT, now)));
  const k = offs.indexOf(Math.min(...offs));
  const { growth, dT: end } = points[k];
  const passed = t[t.length - 1] - t[0];
  const slow = { ...found, regime: "slow transient" };
  if (!(growth < 0)) return { ...slow, leaves: end };
  if (offs[k] <= SETTLED) return { ...found, rest: end };
  const missing = Math.log(Math.max(offs[k], SETTLED) / (0.1 * SETTLED)) / -growth;
  return { ...slow, heat: { now, end }, wanted: passed + Math.max(passed, missing) };
}

/** How many cycles repeat together: the smallest number after which heights and lengths return, or 1. */
function patternOf(heights, waits) {
  for (let m = 1; m <= LONGEST_PATTERN; m++) if (missOf(heights, waits, m) <= SETTLED) return m;
  return 1;
}

/** Largest relative change of heights and lengths over m cycles; infinite where there are too few. */
function missOf(heights, waits, m) {
  const n = heights.length;
  if (n < 3 * m) return Infinity;
  const of = (x) => Math.max(...x.slice(n - 2 * m, n).map((v, k) => Math.abs(v - x[n - 3 * m + k]))) / Math.max(...x.slice(n - 3 * m, n));
  return Math.max(of(heights), of(waits));
}

/** Where amplitudes are heading, from the means of three blocks; NaN where that is not clear. */
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

/** Changes from each value to the next. */
const changes = (x) => x.slice(1).map((value, k) => value - x[k]);

/** Whether changes take turns in sign. */
const takeTurns = (steps) => steps.every((step, k) => k === 0 || step * steps[k - 1] < 0);

/** Whether large and small pulses alternate at the end with a difference of more than 2 % that does not decay. */
function alternate(heights) {
  const steps = changes(heights.slice(-4));
  const [before, last] = steps.slice(-2).map(Math.abs);
  return steps.length >= 2 && takeTurns(steps) && last > SETTLED * heights.at(-1) && last > 0.5 * before;
}

/** Whether large and small pulses have alternated by more than `least` for five cycles without decay. */
function doubled(heights, least) {
  const steps = changes(heights.slice(-5));
  if (steps.length !== 4 || !takeTurns(steps)) return false;
  const sizes = steps.map(Math.abs);
  return sizes[3] > least * heights.at(-1) && sizes.every((size, k) => k === 0 || size > (1 - SETTLED) * sizes[k - 1]);
}

/** Largest relative change of the period of a cycle that goes on; `enough` cycles prove more than the fewest. */
function longestChange(earlier, drift, enough) {
  if (!enough) return SETTLED;
  return earlier * drift > 0 ? Math.max(SETTLED, Math.min(FAR, Math.abs(earlier))) : FAR;
}
