// Fixed points of ring and heat, and their stability: coupled/equilibria/balance.py and spectrum.py.
//
// At one power the fixed points lie on one smooth curve, the tilted resonance, with the parameter s:
//   D = gamma sinh s,   U gamma(U)^2 = drive^2/cosh^2 s,   detuning(s) = shift(U) - gamma sinh s
// Cut at its turning points, every piece holds a detuning at most once.

import { bisect, eigenvalues } from "./eigen.mjs";
import { slopes } from "./kernel.mjs";
import { absorbedPower, dispersion } from "./ring.mjs";

const SPACING = 0.02;
const CLOSE = 4e-16;

/** N, dN/dU, gamma and dgamma/dU at a fixed point of energy U. */
function carry(U, sys) {
  const k = sys.tau0 * sys.g * U * U;
  const p = 1 - sys.a * k;
  const root = Math.sqrt(p * p + 4 * sys.b * k);
  const N = p > 0 ? (2 * k) / (p + root) : (root - p) / (2 * sys.b);
  const NSlope = (2 * sys.tau0 * sys.g * U * (1 + sys.a * N)) / root;
  return { N, NSlope, gamma: sys.loss + sys.fca * N + sys.tpa * U, gammaSlope: sys.fca * NSlope + sys.tpa };
}

/** Everything at a fixed point of energy U that does not depend on the laser, and its derivatives by U. */
export function balance(U, sys) {
  const { N, NSlope, gamma, gammaSlope } = carry(U, sys);
  const z = sys.R * absorbedPower(U, N, sys);
  const lift = 1 + 2 * sys.curvature * z;
  const dT = z + sys.curvature * z * z;
  const dTSlope = sys.R * lift * 2 * (sys.absorbed + sys.fca * (N + NSlope * U) + 2 * sys.tpa * U);
  const [S, SSlope] = dispersion(N, sys.fcd);
  const shift = -sys.shift * dT - S - sys.kerr * U;
  const shiftSlope = -sys.shift * dTSlope - SSlope * NSlope - sys.kerr;
  return { N, NSlope, dT, z, lift, shift, shiftSlope, gamma, gammaSlope, S, SSlope };
}

/** U with U gamma(U)^2 = drive^2/cosh^2 s: Newton in log U, kept within a bracket. */
export function energy(s, drive, sys) {
  const target = 2 * (Math.log(drive) - Math.log(Math.cosh(s)));
  let high = target - 2 * Math.log(sys.loss);
  let low = target - 2 * Math.log(carry(Math.exp(high), sys).gamma);
  let x = high;
  for (let i = 0; i < 200; i++) {
    const U = Math.exp(x);
    const { gamma, gammaSlope } = carry(U, sys);
    const f = x + 2 * Math.log(gamma) - target;
    if (f >= 0) high = x;
    if (f <= 0) low = x;
    const before = x;
    x -= f / (1 + (2 * U * gammaSlope) / gamma);
    if (!(low <= x && x <= high)) x = 0.5 * (low + high);
    if (Math.abs(x - before) < 1e-9 * (1 + Math.abs(x))) break; // the step squares the error
  }
  return Math.exp(x);
}

/** U, D, detuning and d(detuning)/ds of the tilted resonance at s. */
export function tilted(s, drive, sys) {
  const U = energy(s, drive, sys);
  const at = balance(U, sys);
  const sinh = Math.sinh(s);
  const D = at.gamma * sinh;
  const USlope = (-2 * U * Math.tanh(s)) / (1 + (2 * U * at.gammaSlope) / at.gamma);
  const slope = (at.shiftSlope - at.gammaSlope * sinh) * USlope - at.gamma * Math.cosh(s);
  return { U, D, detuning: at.shift - D, slope, N: at.N, dT: at.dT };
}

/** An s beyond which, on either side, the tilted resonance is farther off than the detuning (rad/ns). */
export function reach(detuning, drive, sys) {
  const U = energy(0, drive, sys);
  const top = balance(U, sys);
  const largest = Math.abs(sys.shift * top.dT) + Math.abs(top.S) + Math.abs(sys.kerr * U);
  return Math.asinh((Math.abs(detuning) + largest) / sys.loss + 1);
}

/** -end, every s between where detuning(s) turns, and end, in increasing order. */
function turningPoints(end, drive, sys) {
  const n = Math.ceil((2 * end) / SPACING) + 1;
  const s = Array.from({ length: n }, (_, k) => -end + (2 * end * k) / (n - 1));
  const rises = (x) => tilted(x, drive, sys).slope > 0;
  const up = s.map(rises);
  const turns = s.slice(1).flatMap((right, k) => (up[k] === up[k + 1] ? [] : [bisect((x) => rises(x) === up[k], s[k], right)]));
  return [-end, ...turns, end];
}

/** Pieces of the curve that hold every detuning up to `farthest` at most once: their ends, and the last s found in each. */
function branchesOf(farthest, drive, sys) {
  const s = turningPoints(reach(farthest, drive, sys), drive, sys);
  return { s, ends: s.map((x) => tilted(x, drive, sys).detuning), last: new Float64Array(s.length).fill(NaN) };
}

/** The point of piece k at a detuning; a search begins at the point that was found there before. */
function crossing({ s: at, ends, last }, k, detuning, drive, sys) {
  const falling = ends[k] > detuning;
  let [left, right] = [at[k], at[k + 1]];
  let s = left < last[k] && last[k] < right ? last[k] : 0.5 * (left + right);
  let point = null;
  for (let i = 0; i < 200; i++) {
    point = tilted(s, drive, sys);
    const f = point.detuning - detuning;
    if (f > 0 === falling) left = s;
    else right = s;
    const before = s;
    s = point.slope !== 0 ? s - f / point.slope : left;
    if (!(left < s && s < right)) s = 0.5 * (left + right);
    if (f === 0 || Math.abs(s - before) <= CLOSE * (1 + Math.abs(s))) break;
  }
  last[k] = s;
  return point;
}

/** Every fixed point { U, D } at a detuning (rad/ns), in the order of s; branches by branchesOf. */
function fixedPoints(detuning, drive, sys, branches) {
  const { ends } = branches;
  const out = [];
  for (let k = 0; k + 1 < ends.length; k++) {
    if (ends[k] > detuning !== ends[k + 1] > detuning) out.push(crossing(branches, k, detuning, drive, sys));
  }
  return out;
}

/** The state at a fixed point, turned so that the field is real. */
export function stateAt(U, sys) {
  const at = balance(U, sys);
  const heat = absorbedPower(U, at.N, sys);
  const y = new Float64Array(3 + sys.gain.length);
  y[0] = Math.sqrt(U);
  y[2] = at.N;
  for (let i = 0; i < sys.gain.length; i++) y[3 + i] = (sys.gain[i] / sys.rate[i]) * heat;
  return y;
}

/** All eigenvalues at the fixed point (U, D), in 1/ns, by a dense factorization. */
export function spectrumAt(U, D, sys) {
  const y = stateAt(U, sys);
  return eigenvalues(slopes(sys, 0, balance(U, sys).shift - D, y).J, y.length);
}

/** Coefficients of the secular equation E(lambda) at the energy U (spectrum.py). */
export function secular(U, sys) {
  const at = balance(U, sys);
  const N = at.N;
  const saturation = 1 + sys.a * N;
  const rho = (1 + sys.b * N * (2 + sys.a * N)) / (sys.tau0 * saturation * saturation);
  const made = 4 * sys.g * U * U;
  return {
    gamma: at.gamma,
    gamma2: at.gamma + 2 * sys.tpa * U,
    rho,
    alpha: sys.fca * made,
    beta: at.SSlope * made,
    heat: at.lift * 4 * sys.shift * (sys.absorbed + sys.fca * N + 2 * sys.tpa * U) * U,
    cross: at.lift * 2 * sys.shift * sys.fca * U * made,
    kerr: 2 * sys.kerr * U,
  };
}

/**
 * Move the eigenvalues of a neighbour (re, im) to those at (U, D) by Aberth's iteration; returns whether they can be
 * trusted, checked by their sum, which is the trace.
 */
export function follow(re, im, U, D, sys) {
  const m = re.length;
  const c = secular(U, sys);
  for (let k = 0; k < m; k++) {
    const f = 1e-4 + 1e-5 * k;
    [re[k], im[k]] = [re[k] * (1 + f) - im[k] * f, im[k] * (1 + f) + re[k] * f];
  }
  let largest = 1;
  for (let sweep = 0; sweep < 60; sweep++) {
    const before = largest;
    largest = 0;
    for (let k = 0; k < m; k++) {
      const [x, y] = [re[k], im[k]];
      const [pr, pi] = newtonStep(x, y, c, D, sys);
      let sr = 0;
      let si = 0;
      for (let j = 0; j < m; j++) {
        const dr = x - re[j];
        const di = y - im[j];
        const square = dr * dr + di * di;
        if (square === 0) continue;
        sr += dr / square;
        si -= di / square;
      }
      const [qr, qi] = [1 - (pr * sr - pi * si), -(pr * si + pi * sr)];
      const q = qr * qr + qi * qi || Infinity;
      const [stepR, stepI] = [(pr * qr + pi * qi) / q, (pi * qr - pr * qi) / q];
      [re[k], im[k]] = [x - stepR, y - stepI];
      const size = Math.hypot(stepR, stepI) / Math.hypot(re[k], im[k]);
      if (!(size <= largest)) largest = size;
    }
    if (largest < 1e-13 || (largest < 1e-7 && largest > 0.5 * before)) break;
  }
  const [sumR, sumI] = [re, im].map((parts) => parts.reduce((sum, x) => sum + x, 0));
  const trace = sys.rate.reduce((sum, rate) => sum - rate, -(c.gamma + c.gamma2 + c.rho));
  return largest < 1e-7 && Math.hypot(sumR - trace, sumI) < 1e-7 * Math.abs(trace);
}

/** p/p' of the characteristic polynomial at x + iy, [re, im]. */
function newtonStep(x, y, c, D, sys) {
  const { gain, rate } = sys;
  let Gr = 0, Gi = 0, Hr = 0, Hi = 0, Lr = 0, Li = 0; // prettier-ignore
  for (let i = 0; i < rate.length; i++) {
    const a = x + rate[i];
    const square = a * a + y * y;
    if (square === 0) return [0, 0];
    const vr = a / square;
    const vi = -y / square;
    const g = gain[i];
    Gr += g * vr;
    Gi += g * vi;
    Hr -= g * (vr * vr - vi * vi);
    Hi -= 2 * g * vr * vi;
    Lr += vr;
    Li += vi;
  }
  const ur = x + c.gamma;
  const vr = x + c.gamma2;
  const wr = x + c.rho;
  const sr = c.heat * wr + c.cross;
  const si = c.heat * y;
  const vwr = vr * wr - y * y + c.alpha; // v w + alpha
  const vwi = (vr + wr) * y;
  const gsr = Gr * sr - Gi * si;
  const gsi = Gr * si + Gi * sr;
  const Er = ur * vwr - y * vwi + D * D * wr - D * (c.beta + c.kerr * wr + gsr);
  const Ei = ur * vwi + y * vwr + D * D * y - D * (c.kerr * y + gsi);
  const dr = vwr + (ur * (vr + wr) - 2 * y * y) + D * D - D * (c.kerr + Hr * sr - Hi * si + c.heat * Gr);
  const di = vwi + (y * (vr + wr) + 2 * ur * y) - D * (Hr * si + Hi * sr + c.heat * Gi);
  const nr = dr + Lr * Er - Li * Ei;
  const ni = di + Lr * Ei + Li * Er;
  const square = nr * nr + ni * ni || Infinity;
  return [(Er * nr + Ei * ni) / square, (Ei * nr - Er * ni) / square];
}

/** The kind of a fixed point from its eigenvalues: largest real part, angular frequency, and the regime in words. */
export function kindOf({ re, im }) {
  const first = re.indexOf(Math.max(...re));
  const growing = re.filter((x) => x > 0).length;
  const omega = Math.abs(im[first]) > 1e-6 * Math.hypot(re[first], im[first]) ? Math.abs(im[first]) : 0;
  const unstable = growing % 2 ? "saddle" : omega ? "unstable focus" : "unstable node";
  return { growth: re[first], omega, regime: growing ? unstable : "stable" };
}

/** Every fixed point of one laser setting by increasing energy, with N, dT and kind; detuning in rad/ns. */
export function steadyStates(drive, detuning, sys) {
  return fixedPoints(detuning, drive, sys, branchesOf(Math.abs(detuning), drive, sys))
    .sort((p, q) => p.U - q.U)
    .map((p) => ({ U: p.U, D: p.D, N: p.N, dT: p.dT, ...kindOf(spectrumAt(p.U, p.D, sys)) }));
}

/** Numbers of fixed and of stable points at one power over the detunings (rad/ns): { fixed, stable, growth }. */
export function survey(detunings, drive, sys) {
  const farthest = detunings.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
  const branches = branchesOf(farthest, drive, sys);
  const near = branches.s.map(() => null);
  const fixed = new Int8Array(detunings.length);
  const stable = new Int8Array(detunings.length);
  const growth = new Float64Array(detunings.length);
  detunings.forEach((detuning, j) => {
    growth[j] = Infinity;
    const points = fixedPoints(detuning, drive, sys, branches);
    fixed[j] = points.length;
    points.forEach(({ U, D }, k) => {
      const branch = points.length > 1 || D > 0 ? k : near.length - 1;
      let z = near[branch];
      if (!z || !follow(z.re, z.im, U, D, sys)) z = near[branch] = spectrumAt(U, D, sys);
      const first = Math.max(...z.re);
      if (first < 0) stable[j]++;
      growth[j] = Math.min(growth[j], first);
    });
  });
  return { fixed, stable, growth };
}
