// Hopf and fold curves of the plane of power and detuning.
//
// The eigenvalues at the fixed point (U, D) obey A + D^2 - D B = 0 (equilibria.mjs). At lambda = i w its imaginary part
// gives D = Im A/Im B; the real part is then an equation over (log U, log w), whose contour is the Hopf curve.
// At a fold lambda = 0: D = -U shift' +- sqrt((U shift')^2 - gamma^2 - 2 U gamma gamma').

import { bisect } from "./eigen.mjs";
import { balance, countBeyond, energy, impedance, lineAt, reach, secular, termsAt } from "./equilibria.mjs";
import { UW, driveOf } from "./ring.mjs";

const ENERGIES = 300;
const FREQUENCIES = 2400; // both branches of a curve run close together in w where they meet
const BISECTIONS = 40;

/** What vanishes at a Hopf point of frequency w, and its D; c by `secular`, Z by `impedance` at i w. */
export function hopfAt(c, w, Z) {
  const [Ar, Ai, Br, Bi] = termsAt(c, 0, w, Z);
  const [a, b] = [Ai / w, Bi / w];
  return { f: Ar * b * b + a * a - a * b * Br, D: a / b };
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

function laserOf(U, D, sys) {
  const at = balance(U, sys);
  return { power: ((U * (at.gamma ** 2 + D * D)) / (2 * sys.bus)) * UW, detuning: at.shift - D };
}

/**
 * Hopf curves whose energies a window of powers [low, high] in W and detunings [low, high] in rad/ns can hold: lists
 * of { U, D, w, power (W), detuning (rad/ns), leading: whether no other eigenvalue grows }. They are not cut to the window.
 */
export function hopfCurves(sys, powers, detunings) {
  const { low, high, wLow, wHigh } = ranges(sys, powers, detunings);
  const [x, y] = [logSpaced(low, high, ENERGIES), logSpaced(wLow, wHigh, FREQUENCIES)];
  const coefficients = Array.from(x, (u) => secular(Math.exp(u), sys));
  const values = Array.from(y, Math.exp).flatMap((w) => {
    const Z = impedance(0, w, sys);
    return coefficients.map((c) => hopfAt(c, w, Z).f);
  });
  const evaluate = (u, v) => {
    const [U, w] = [Math.exp(u), Math.exp(v)];
    return { u, v, U, w, ...hopfAt(secular(U, sys), w, impedance(0, w, sys)) };
  };
  const between = (a, b, share) => evaluate(a.u + share * (b.u - a.u), a.v + share * (b.v - a.v));
  const line = lineAt(1e-4 * Math.min(...sys.rate), sys); // the pair at +- i w itself lies to the left
  const pointOn = ([i, j, along]) => {
    const [a, b] = [evaluate(x[j], y[i]), along ? evaluate(x[j], y[i + 1]) : evaluate(x[j + 1], y[i])];
    const { U, D, w } = between(a, b, bisect((share) => between(a, b, share).f > 0 === a.f > 0, 0, 1, BISECTIONS));
    return { U, D, w, ...laserOf(U, D, sys), leading: countBeyond(line, U, D, sys) === 0 };
  };
  return contours(values, x.length, y.length).map((edges) => edges.map(pointOn));
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
