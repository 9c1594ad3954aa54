// Whether the cycles of a trace repeat: their heights and lengths from one to the next (coupled/runs/repetition.py).

export const SETTLED = 0.02; // relative change that counts as none
const FAR = 0.1; // relative change of the period per cycle above which no period is given
const LONGEST_PATTERN = 4;

/** How many cycles repeat together: the smallest number after which heights and lengths return, or 1. */
export function patternOf(heights, waits) {
  for (let m = 1; m <= LONGEST_PATTERN; m++) if (missOf(heights, waits, m) <= SETTLED) return m;
  return 1;
}

/** Largest relative change of heights and lengths over m cycles; infinite where there are too few. */
function missOf(heights, waits, m) {
  const n = heights.length;
  if (n < 3 * m) return Infinity;
  const of = (x) => {
    let most = 0;
    for (let k = n - 2 * m; k < n; k++) most = Math.max(most, Math.abs(x[k] - x[k - m]));
    return most / Math.max(...x.slice(n - 3 * m, n));
  };
  return Math.max(of(heights), of(waits));
}

/** Where amplitudes are heading, from the means of three blocks; NaN where that is not clear. */
export function amplitudeLimit(heights) {
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
export function alternate(heights) {
  const steps = changes(heights.slice(-4));
  const [before, last] = steps.slice(-2).map(Math.abs);
  return steps.length >= 2 && takeTurns(steps) && last > SETTLED * heights.at(-1) && last > 0.5 * before;
}

/** Whether large and small pulses have alternated by more than `least` for five cycles without decay. */
export function doubled(heights, least) {
  const steps = changes(heights.slice(-5));
  if (steps.length !== 4 || !takeTurns(steps)) return false;
  const sizes = steps.map(Math.abs);
  return sizes[3] > least * heights.at(-1) && sizes.every((size, k) => k === 0 || size > (1 - SETTLED) * sizes[k - 1]);
}

/** Largest relative change of the period of a cycle that goes on; `enough` cycles prove more than the fewest. */
export function longestChange(earlier, drift, enough) {
  if (!enough) return SETTLED;
  return earlier * drift > 0 ? Math.max(SETTLED, Math.min(FAR, Math.abs(earlier))) : FAR;
}
