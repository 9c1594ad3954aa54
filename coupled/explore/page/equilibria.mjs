// Fixed points of ring and heat, and their stability: coupled/equilibria/balance.py and steady_states.py.
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

/**
 * Coefficients of E(lambda) = A + D^2 - D B at a fixed point of energy U (bifurcation_curves.py). Its zeros are the eigenvalues.
 *   A = (lambda + gamma)[lambda + gamma2 + alpha/(lambda + rho)]
 *   B = kerr + [beta + Z(lambda)(heat (lambda + rho) + cross)]/(lambda + rho), with the thermal impedance Z
 */
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

/** Thermal impedance of the network at x + i w, [re, im] in K/uW. */
export function impedance(x, w, sys) {
  let [re, im] = [0, 0];
  for (let i = 0; i < sys.gain.length; i++) {
    const f = sys.gain[i] / ((sys.rate[i] + x) ** 2 + w * w);
    re += f * (sys.rate[i] + x);
    im -= f * w;
  }
  return [re, im];
}

/** A and B at x + i w, [re A, im A, re B, im B]; c by `secular`, Z by `impedance`. */
export function termsAt(c, x, w, Z) {
  const r = c.rho + x;
  const q = 1 / (r * r + w * w); // 1/(lambda + rho) = (r - i w) q
  const u = c.gamma + x;
  const pr = c.gamma2 + x + c.alpha * r * q;
  const pi = w - c.alpha * w * q;
  const tr = c.heat * r + c.cross;
  const ti = c.heat * w;
  const nr = c.beta + Z[0] * tr - Z[1] * ti;
  const ni = Z[0] * ti + Z[1] * tr;
  return [u * pr - w * pi, u * pi + w * pr, c.kerr + (nr * r + ni * w) * q, (ni * r - nr * w) * q];
}

/** The line x + i w in the plane of eigenvalues: places w from far below the slowest rate to far above the fastest. */
export function lineAt(x, sys) {
  const rates = [...sys.rate, sys.loss, 1 / sys.tau0];
  const [low, high] = [1e-3 * Math.min(...rates), 1e4 * Math.max(...rates)];
  const n = Math.ceil(12 * Math.log10(high / low)); // the imaginary part of E/w changes within a decade
  const w = Float64Array.from({ length: n + 1 }, (_, k) => low * (high / low) ** (k / n));
  return { x, w, Z: Array.from(w, (one) => impedance(x, one, sys)), start: impedance(x, 0, sys) };
}

/**
 * How many eigenvalues of the fixed point (U, D) lie to the right of a line, by the argument principle: E goes as lambda^2
 * far away, so there are 1 minus the half turns of E along the upper half of the line. A half turn leads from one side of
 * the real axis to the other.
 */
export function countBeyond(line, U, D, sys) {
  const c = secular(U, sys);
  const valueAt = (w, Z) => {
    const [Ar, Ai, Br, Bi] = termsAt(c, line.x, w, Z);
    return [Ar + D * D - D * Br, Ai - D * Bi];
  };
  const direct = (w) => valueAt(w, impedance(line.x, w, sys));
  let right = valueAt(0, line.start)[0] > 0; // where E was last on the real axis
  let above = null; // in which half of the plane it has been since
  let count = 1;
  const meets = (side) => {
    if (side !== right) count -= above === right ? 1 : -1;
    right = side;
  };
  line.w.forEach((w, k) => {
    const now = valueAt(w, line.Z[k])[1] > 0;
    if (k && now !== above) meets(direct(bisect((v) => direct(v)[1] > 0 === above, line.w[k - 1], w, 40))[0] > 0);
    above = now;
  });
  meets(false);
  return count;
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

/** Number of stable points at one power for each of the detunings (rad/ns). */
export function survey(detunings, drive, sys) {
  const farthest = detunings.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
  const [branches, line] = [branchesOf(farthest, drive, sys), lineAt(0, sys)];
  return Int8Array.from(detunings, (x) => fixedPoints(x, drive, sys, branches).filter(({ U, D }) => !countBeyond(line, U, D, sys)).length);
}
