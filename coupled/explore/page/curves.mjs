// Hopf and fold curves of the plane of power and detuning: coupled/equilibria/boundaries.py.
//
// The eigenvalues at the fixed point (U, D) obey A(lambda, U) + D^2 - D B(lambda, U) = 0 with
//   A = (lambda + gamma)[lambda + gamma + 2 tpa U + alpha/(lambda + rho)]
//   B = kerr + [beta + Z(lambda)(heat (lambda + rho) + cross)]/(lambda + rho)
// At lambda = i w the real part is a quadratic equation for D, which leaves one real equation on each of two sheets
// over (log U, log w): D = [Re B +- sqrt((Re B)^2 - 4 Re A)]/2,  Im A - D Im B = 0.
// At a fold lambda = 0: D = -U shift' +- sqrt((U shift')^2 - gamma^2 - 2 U gamma gamma').

import { bisect } from "./eigen.mjs";
import { balance, energy, follow, reach, secular, spectrumAt } from "./equilibria.mjs";
import { UW, driveOf } from "./ring.mjs";

const ENERGIES = 300;
const FREQUENCIES = 300;
const BISECTIONS = 40;

/** Thermal impedance of the network at i w, [re, im] in K/uW. */
export function impedance(w, sys) {
  let [re, im] = [0, 0];
  for (let i = 0; i < sys.gain.length; i++) {
    const f = sys.gain[i] / (sys.rate[i] ** 2 + w * w);
    re += f * sys.rate[i];
    im -= f * w;
  }
  return [re, im];
}

/** The remaining equation on one sheet, D, and what the square root is of; c by `secular`, Z by `impedance`. */
export function sheet(c, w, Z, sign) {
  const q = 1 / (c.rho * c.rho + w * w); // 1/(z + rho) = (rho - i w) q
  const pr = c.gamma2 + c.alpha * c.rho * q;
  const pi = w - c.alpha * w * q;
  const Ar = c.gamma * pr - w * pi;
  const Ai = c.gamma * pi + w * pr;
  const tr = c.heat * c.rho + c.cross;
  const ti = c.heat * w;
  const nr = c.beta + Z[0] * tr - Z[1] * ti;
  const ni = Z[0] * ti + Z[1] * tr;
  const Br = c.kerr + (nr * c.rho + ni * w) * q;
  const Bi = (ni * c.rho - nr * w) * q;
  const square = Br * Br - 4 * Ar;
  const D = (Br + sign * Math.sqrt(Math.max(square, 0))) / 2;
  return { f: (Ai - D * Bi) / w, D, square };
}

/** Energies and frequencies (rad/ns) that the fixed points of a window can have; powers in W, detunings in rad/ns. */
function ranges(sys, powers, detunings) {
  const farthest = Math.max(...detunings.map(Math.abs));
  const weak = driveOf(sys, powers[0]);
  const strong = driveOf(sys, powers[1]);
  const high = energy(0, strong, sys);
  const low = energy(reach(farthest, strong, sys), weak, sys);
  const speeds = Array.from(logSpaced(low, high, 21), (x) => balance(Math.exp(x), sys)).map((at) => at.gamma + Math.abs(at.shift));
  return { low, high, wLow: 1e-4 * Math.min(...sys.rate), wHigh: 2 * (Math.max(...speeds) + farthest) };
}

function logSpaced(low, high, n) {
  return Float64Array.from({ length: n }, (_, k) => Math.log(low) + (Math.log(high / low) * k) / (n - 1));
}

/** Zero contours of values[i * nx + j] as lists of crossed grid edges [i, j, along], along 0 for x and 1 for y. */
function contours(values, nx, ny) {
  const links = new Map();
  const link = (a, b) => {
    for (const [from, to] of [[a, b], [b, a]]) links.set(from, [...(links.get(from) || []), to]); // prettier-ignore
  };
  const up = (i, j) => values[i * nx + j] > 0;
  const edge = (i, j, along) => 2 * (i * nx + j) + along;
  for (let i = 0; i + 1 < ny; i++) {
    for (let j = 0; j + 1 < nx; j++) {
      const corners = [up(i, j), up(i, j + 1), up(i + 1, j + 1), up(i + 1, j)];
      if (corners.every((corner) => corner === corners[0])) continue;
      const around = [edge(i, j, 0), edge(i, j + 1, 1), edge(i + 1, j, 0), edge(i, j, 1)];
      const crossed = around.filter((_, k) => corners[k] !== corners[(k + 1) % 4]);
      const middle = values[i * nx + j] + values[i * nx + j + 1] + values[(i + 1) * nx + j] + values[(i + 1) * nx + j + 1] > 0;
      if (crossed.length === 4 && middle !== corners[0]) crossed.push(crossed.shift());
      for (let k = 0; k < crossed.length; k += 2) link(crossed[k], crossed[k + 1]);
    }
  }
  const lines = [];
  const seen = new Set();
  const ends = [...links.keys()].filter((one) => links.get(one).length === 1);
  for (const from of [...ends, ...links.keys()]) {
    if (seen.has(from)) continue;
    const line = [];
    for (let at = from; at !== undefined; at = links.get(at).find((x) => !seen.has(x))) {
      seen.add(at);
      line.push(at);
    }
    if (line.length > 2 && links.get(line.at(-1)).includes(from)) line.push(from);
    lines.push(line.map((x) => [Math.floor(x / 2 / nx), Math.floor(x / 2) % nx, x % 2]));
  }
  return lines;
}

/** Pieces of Hopf curves on one sheet, points { U, w, D }; where the sheets meet, a piece ends with a point `meets`. */
function piecesOf(sys, x, y, sign) {
  const values = new Float64Array(x.length * y.length);
  const at = Array.from(x, (v) => secular(Math.exp(v), sys));
  for (let i = 0; i < y.length; i++) {
    const w = Math.exp(y[i]);
    const Z = impedance(w, sys);
    for (let j = 0; j < x.length; j++) values[i * x.length + j] = sheet(at[j], w, Z, sign).f;
  }
  const evaluate = (u, v) => {
    const [U, w] = [Math.exp(u), Math.exp(v)];
    return { u, v, U, w, ...sheet(secular(U, sys), w, impedance(w, sys), sign) };
  };
  const between = (a, b, share) => evaluate(a.u + share * (b.u - a.u), a.v + share * (b.v - a.v));
  const out = [];
  for (const line of contours(values, x.length, y.length)) {
    const points = line.map(([i, j, along]) => {
      const [a, b] = [evaluate(x[j], y[i]), along ? evaluate(x[j], y[i + 1]) : evaluate(x[j + 1], y[i])];
      return between(a, b, bisect((share) => between(a, b, share).f > 0 === a.f > 0, 0, 1, BISECTIONS));
    });
    let piece = [];
    points.forEach((p, k) => {
      const before = points[k - 1];
      if (before && before.square > 0 !== p.square > 0) piece.push({ ...between(before, p, before.square / (before.square - p.square)), meets: true });
      if (p.square > 0) piece.push(p);
      if (piece.length && (p.square <= 0 || k === points.length - 1)) {
        out.push(piece);
        piece = [];
      }
    });
  }
  return out;
}

function laserOf(U, D, sys) {
  const at = balance(U, sys);
  return { power: ((U * (at.gamma ** 2 + D * D)) / (2 * sys.bus)) * UW, detuning: at.shift - D };
}

/** Whether no eigenvalue but the pair nearest to +- i w grows, along a curve of { U, D, w }. */
function mark(points, sys) {
  let z = null;
  for (const p of points.filter((one) => !one.meets)) {
    if (!z || !follow(z.re, z.im, p.U, p.D, sys)) z = spectrumAt(p.U, p.D, sys);
    const near = Array.from(z.re, (re, k) => ({ re, off: Math.hypot(re, Math.abs(z.im[k]) - p.w) })).sort((a, b) => a.off - b.off);
    p.leading = near.slice(2).every(({ re }) => re < 0);
  }
  points.forEach((p, k) => p.meets && (p.leading = points[k ? k - 1 : 1].leading));
}

/**
 * Hopf curves whose energies a window of powers [low, high] in W and detunings [low, high] in rad/ns can hold: lists
 * of { U, D, w, power (W), detuning (rad/ns), leading }. They are not cut to the window.
 */
export function hopfCurves(sys, powers, detunings) {
  const { low, high, wLow, wHigh } = ranges(sys, powers, detunings);
  const x = logSpaced(low, high, ENERGIES);
  const y = logSpaced(wLow, wHigh, FREQUENCIES);
  const pieces = [1, -1].flatMap((sign) => piecesOf(sys, x, y, sign)).filter((piece) => piece.length > 1);
  const ends = pieces.flat().filter((p) => p.meets);
  const far = (p, q) => (p === q ? Infinity : Math.hypot(p.u - q.u, p.v - q.v));
  const partners = ends.map((end) => ends.reduce((best, p) => (far(p, end) < far(best, end) ? p : best), end)).map(({ U, D }) => ({ U, D }));
  ends.forEach((end, k) => Object.assign(end, { U: (end.U + partners[k].U) / 2, D: (end.D + partners[k].D) / 2 })); // the ends on both sheets
  return pieces.map((piece) => {
    const points = piece.map((p) => ({ ...p, ...laserOf(p.U, p.D, sys) }));
    mark(points, sys);
    return points;
  });
}

/** Fold curves of the same window, lists of { U, D, power, detuning }: both folds of an energy from one cusp to the other. */
export function foldCurves(sys, powers, detunings) {
  const { low, high } = ranges(sys, powers, detunings);
  const terms = (U) => {
    const at = balance(U, sys);
    const a = U * at.shiftSlope;
    return { a, square: a * a - at.gamma ** 2 - 2 * U * at.gamma * at.gammaSlope };
  };
  const folds = (x) => terms(Math.exp(x)).square >= 0;
  const x = logSpaced(low, high, 1200);
  const ends = folds(x[0]) ? [x[0]] : [];
  for (let k = 0; k + 1 < x.length; k++) {
    if (folds(x[k]) !== folds(x[k + 1])) ends.push(folds(x[k]) ? bisect(folds, x[k], x[k + 1], BISECTIONS) : bisect(folds, x[k + 1], x[k], BISECTIONS));
  }
  if (ends.length % 2) ends.push(x.at(-1));
  const curves = [];
  for (let e = 0; e < ends.length; e += 2) {
    const both = Array.from({ length: 150 }, (_, k) => {
      const U = Math.exp(ends[e] + (ends[e + 1] - ends[e]) * (0.5 - 0.5 * Math.cos((Math.PI * k) / 149)));
      const { a, square } = terms(U);
      const root = Math.sqrt(Math.max(square, 0));
      return [-a - root, -a + root].map((D) => ({ U, D, ...laserOf(U, D, sys) }));
    });
    curves.push([...both.map(([lower]) => lower).reverse(), ...both.slice(1).map(([, upper]) => upper)]);
  }
  return curves;
}
