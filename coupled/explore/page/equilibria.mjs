// Fixed points of ring and heat, and their stability: coupled/equilibria/balance.py and steady_states.py.
//
// At one power the fixed points lie on one smooth curve, the tilted resonance, with the parameter t:
//   U = top/cosh^2 t,   top gamma(top)^2 = drive^2,   D = +- sqrt(drive^2/U - gamma^2) with the sign of t
//   detuning(t) = shift(U) - D
// Cut at its turning points, every piece holds a detuning at most once.

import { bisect, eigenvalues } from "./eigen.mjs";
import { slopes } from "./kernel.mjs";
import { absorbedPower, dispersion, recombination, steadyCarriers } from "./ring.mjs";

const SPACING = 0.02;

/** The root of a function with value and slope [f, f'] between a, where it is negative, and b: Newton's method or bisection. */
function newton(f, a, b, start) {
  let x = start;
  for (let step = Infinity, k = 0; Math.abs(step) > 1e-9 && k < 200; k++) {
    const [value, slope] = f(x);
    if (value > 0) b = x;
    else a = x;
    step = -value / slope; // the error is its square
    if (!((x + step - a) * (x + step - b) <= 0)) step = 0.5 * (a + b) - x;
    x += step;
  }
  return x;
}

/** Everything at a fixed point of energy U that does not depend on the laser, and its derivatives by U. */
export function balance(U, sys) {
  const [N, perMade] = steadyCarriers(sys.g * U * U, sys);
  const NSlope = 2 * sys.g * U * perMade;
  const gamma = sys.loss + sys.fca * N + sys.tpa * U;
  const z = sys.R * absorbedPower(U, N, sys);
  const lift = 1 + 2 * sys.curvature * z;
  const dT = z + sys.curvature * z * z;
  const dTSlope = sys.R * lift * 2 * (sys.absorbed + sys.fca * (N + NSlope * U) + 2 * sys.tpa * U);
  const [S, SSlope] = dispersion(N, sys.fcd);
  const shift = -sys.shift * dT - S - sys.kerr * U;
  const shiftSlope = -sys.shift * dTSlope - SSlope * NSlope - sys.kerr;
  return { N, dT, lift, shift, shiftSlope, gamma, gammaSlope: sys.fca * NSlope + sys.tpa, S, SSlope };
}

/** The energy on resonance, the root U of U gamma(U)^2 = drive^2. */
export function resonantEnergy(drive, sys) {
  const high = 2 * Math.log(drive / sys.loss);
  const low = high - 2 * Math.log(balance(Math.exp(high), sys).gamma / sys.loss);
  const equation = (x) => {
    const { gamma, gammaSlope } = balance(Math.exp(x), sys);
    return [x + 2 * Math.log(gamma / drive), 1 + (2 * Math.exp(x) * gammaSlope) / gamma];
  };
  return Math.exp(newton(equation, low, high, high));
}

/** The tilted resonance at one drive: a function of t with U, D, detuning and d(detuning)/dt. */
export function tilted(drive, sys) {
  const top = resonantEnergy(drive, sys);
  return (t) => {
    const share = Math.tanh(t);
    const U = top / Math.cosh(t) ** 2;
    const at = balance(U, sys);
    const perU = 2 * U * at.gamma * at.gammaSlope;
    const square = (drive * drive) / U;
    // near the peak a difference of gammas is less exact than their slope
    const rest = share ** 2 > 1e-8 ? ((drive * drive) / top - at.gamma ** 2) / share ** 2 : perU;
    const ratio = Math.sqrt(square + rest);
    const slope = -2 * U * share * at.shiftSlope - (square + perU) / ratio;
    return { U, D: share * ratio, detuning: at.shift - share * ratio, slope, N: at.N, dT: at.dT, gamma: at.gamma };
  };
}

/** A t beyond which, on either side, the tilted resonance is farther off than the detuning (rad/ns). */
export function reach(detuning, drive, sys) {
  const U = resonantEnergy(drive, sys);
  const { dT, S } = balance(U, sys);
  const largest = Math.abs(sys.shift * dT) + Math.abs(S) + Math.abs(sys.kerr * U);
  return Math.asinh((Math.abs(detuning) + largest) / sys.loss + 1);
}

/** A function that gives every fixed point { U, D, N, dT } at one drive and a detuning of at most the size `farthest` (rad/ns). */
function fixedPoints(farthest, drive, sys) {
  const at = tilted(drive, sys);
  const end = reach(farthest, drive, sys);
  const n = Math.ceil((2 * end) / SPACING);
  const grid = Array.from({ length: n + 1 }, (_, k) => -end + (2 * end * k) / n);
  const rises = (t) => at(t).slope > 0;
  const up = grid.map(rises);
  const turns = grid.slice(1).flatMap((right, k) => (up[k] === up[k + 1] ? [] : [bisect((t) => rises(t) === up[k], grid[k], right)]));
  const ends = [-end, ...turns, end];
  const detunings = ends.map((t) => at(t).detuning);
  const last = turns.concat(end).map((right, k) => 0.5 * (ends[k] + right)); // a search begins where one on that piece ended
  return (detuning) =>
    last.flatMap((start, k) => {
      const above = detunings[k] > detuning;
      if (above === detunings[k + 1] > detuning) return [];
      const equation = (t) => {
        const point = at(t);
        return [point.detuning - detuning, point.slope];
      };
      last[k] = newton(equation, ends[above ? k + 1 : k], ends[above ? k : k + 1], start);
      return [at(last[k])];
    });
}

/** All eigenvalues at the fixed point (U, D), in 1/ns, by a dense factorization; the phase is that of a real field. */
function spectrumAt(U, D, sys) {
  const { N, shift } = balance(U, sys);
  const P = absorbedPower(U, N, sys);
  const y = Float64Array.of(Math.sqrt(U), 0, N, ...sys.gain.map((gain, i) => (gain / sys.rate[i]) * P));
  return eigenvalues(slopes(sys, 0, shift - D, y).J, y.length);
}

/**
 * Coefficients of E(lambda) = A + D^2 - D B at a fixed point of energy U (bifurcation_curves.py). Its zeros are the eigenvalues.
 *   A = (lambda + gamma)[lambda + gamma2 + alpha/(lambda + rho)]
 *   B = kerr + [beta + Z(lambda)(heat (lambda + rho) + cross)]/(lambda + rho), with the thermal impedance Z
 */
export function secular(U, sys) {
  const at = balance(U, sys);
  const N = at.N;
  const [, rho] = recombination(N, sys);
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
  return { x, w, Z: Array.from(w, (one) => impedance(x, one, sys)) };
}

/**
 * How many eigenvalues of the fixed point (U, D) lie to the right of a line, by the argument principle: E goes as lambda^2
 * far away, so there are 1 minus the half turns of E along the upper half of the line. Those are the ones from the real
 * axis to the half plane where E ends, and two for each time that E passes the negative half of this axis.
 */
export function countBeyond(line, U, D, sys) {
  const c = secular(U, sys);
  const valueAt = (w, Z) => {
    const [Ar, Ai, Br, Bi] = termsAt(c, line.x, w, Z);
    return [Ar + D * D - D * Br, Ai - D * Bi];
  };
  const direct = (w) => valueAt(w, impedance(line.x, w, sys));
  let above = valueAt(line.w[0], line.Z[0])[1] > 0;
  let turns = direct(0)[0] > 0 ? 0 : above ? -1 : 1;
  for (let k = 1; k < line.w.length; k++) {
    if (valueAt(line.w[k], line.Z[k])[1] > 0 === above) continue;
    const w = bisect((v) => direct(v)[1] > 0 === above, line.w[k - 1], line.w[k], 40);
    if (direct(w)[0] < 0) turns += above ? 2 : -2;
    above = !above;
  }
  return 1 - turns - (above ? 1 : -1);
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
  return fixedPoints(Math.abs(detuning), drive, sys)(detuning)
    .sort((p, q) => p.U - q.U)
    .map((p) => ({ U: p.U, D: p.D, N: p.N, dT: p.dT, gamma: p.gamma, ...kindOf(spectrumAt(p.U, p.D, sys)) }));
}

/** Number of stable points at one power for each of the detunings (rad/ns). */
export function survey(detunings, drive, sys) {
  const farthest = detunings.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
  const [points, line] = [fixedPoints(farthest, drive, sys), lineAt(0, sys)];
  return Int8Array.from(detunings, (x) => points(x).filter(({ U, D }) => !countBeyond(line, U, D, sys)).length);
}
