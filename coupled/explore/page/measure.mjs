// Numbers read off the samples of a trace: its columns, crossings of a level, extremes, duty cycle.

import { bisect } from "./eigen.mjs";

const DUTY_LEVEL = 0.45;

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
    const below = (s) => sign * (v0 + (s - s0) * (a + (s - s1) * (ab + (s - s2) * abc))) < 0;
    out.push(bisect(below, t[at], t[at + 1], 48));
  }
  return out;
}

/** Smallest and largest value among the samples from `first` to `stop`. */
export function extent(x, first = 0, stop = x.length) {
  let low = Infinity;
  let high = -Infinity;
  for (let i = first; i < stop; i++) {
    if (x[i] < low) low = x[i];
    if (x[i] > high) high = x[i];
  }
  return [low, high];
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
