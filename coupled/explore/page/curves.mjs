// Hopf and fold curves of the plane of power and detuning.
//
// The eigenvalues at the fixed point (U, D) obey A + D^2 - D B = 0 (equilibria.mjs). At lambda = i w its imaginary part
// gives D = Im A/Im B; the real part is then an equation over (log U, log w), whose contour is the Hopf curve.
// At a fold lambda = 0: D^2 + 2 D U shift' + gamma^2 + 2 U gamma gamma' = 0, over (log U, arsinh D/loss).

import { bisect } from "./eigen.mjs";
import { balance, countBeyond, impedance, lineAt, reach, resonantEnergy, secular, termsAt } from "./equilibria.mjs";
import { UW, driveOf } from "./ring.mjs";

const ENERGIES = 300;
const FREQUENCIES = 2400; // both branches of a curve run close together in w where they meet
const DETUNED = 200;
const BISECTIONS = 40;

/** What vanishes at a Hopf point of frequency w, and its D; c by `secular`, Z by `impedance` at i w. */
function hopfAt(c, w, Z) {
  const [Ar, Ai, Br, Bi] = termsAt(c, 0, w, Z);
  const [a, b] = [Ai / w, Bi / w];
  return { f: Ar * b * b + a * a - a * b * Br, D: a / b };
}

/** Grids of log U, log w and arsinh D/loss over what fixed points in a window can have; powers in W, detunings in rad/ns. */
function gridsOf(sys, powers, detunings) {
  const farthest = Math.max(...detunings.map(Math.abs));
  const [weak, strong] = powers.map((power) => driveOf(sys, power));
  const low = Math.log(resonantEnergy(weak, sys) / Math.cosh(reach(farthest, strong, sys)) ** 2);
  const U = spaced(low, Math.log(resonantEnergy(strong, sys)), ENERGIES);
  const fastest = U.reduce((most, x) => {
    const at = balance(Math.exp(x), sys);
    return Math.max(most, at.gamma + Math.abs(at.shift) + farthest);
  }, 0);
  const w = spaced(Math.log(1e-4 * Math.min(...sys.rate)), Math.log(2 * fastest), FREQUENCIES);
  const widest = Math.asinh(fastest / sys.loss);
  return { U, w, D: spaced(-widest, widest, DETUNED) };
}

function spaced(low, high, n) {
  return Float64Array.from({ length: n }, (_, k) => low + ((high - low) * k) / (n - 1));
}

/** Zero contours of f(u, v) on the grid of x and y, lists of roots [u, v]; row(v) is a fast function of j for f(x[j], v). */
function contours(f, row, x, y) {
  const values = new Float64Array(x.length * y.length);
  y.forEach((v, i) => {
    const at = row(v);
    for (let j = 0; j < x.length; j++) values[i * x.length + j] = at(j);
  });
  const up = (i, j) => values[i * x.length + j] > 0;
  const edge = (i, j, along) => 2 * (i * x.length + j) + along; // along 0 for x and 1 for y
  const next = new Map(); // of a crossed edge, where the contour leaves the cell that it enters there
  for (let i = 0; i + 1 < y.length; i++) {
    for (let j = 0; j + 1 < x.length; j++) {
      if (up(i, j) === up(i, j + 1) && up(i, j) === up(i + 1, j) && up(i, j) === up(i + 1, j + 1)) continue;
      const corners = [up(i, j), up(i, j + 1), up(i + 1, j + 1), up(i + 1, j)];
      const around = [edge(i, j, 0), edge(i, j + 1, 1), edge(i + 1, j, 0), edge(i, j, 1)];
      const changes = (k, from) => corners[k] === from && corners[(k + 1) % 4] !== from;
      const middle = [0, 1].reduce((sum, k) => sum + values[(i + k) * x.length + j] + values[(i + k) * x.length + j + 1], 0) > 0;
      for (const k of [0, 1, 2, 3].filter((side) => changes(side, true))) {
        let leaves = k;
        while (!changes(leaves, false)) leaves = (leaves + (middle ? 1 : 3)) % 4;
        next.set(around[k], around[leaves]);
      }
    }
  }
  const rootOn = (crossed) => {
    const [i, j, along] = [Math.floor(crossed / 2 / x.length), Math.floor(crossed / 2) % x.length, crossed % 2];
    const between = (share) => [along ? x[j] : x[j] + share * (x[j + 1] - x[j]), along ? y[i] + share * (y[i + 1] - y[i]) : y[i]];
    return between(bisect((share) => f(...between(share)) > 0 === up(i, j), 0, 1, BISECTIONS));
  };
  const entered = new Set(next.values());
  const starts = [...next.keys()].sort((a, b) => entered.has(a) - entered.has(b)); // open contours first
  return starts.flatMap((from) => {
    const line = [];
    for (let [at, to] = [from, next.get(from)]; to !== undefined; [at, to] = [to, next.get(to)]) {
      next.delete(at);
      line.push(to);
    }
    return line.length ? [[from, ...line].map(rootOn)] : [];
  });
}

function laserOf(U, D, sys) {
  const at = balance(U, sys);
  return { U, D, power: ((U * (at.gamma ** 2 + D * D)) / (2 * sys.bus)) * UW, detuning: at.shift - D };
}

/**
 * Hopf curves whose energies a window of powers [low, high] in W and detunings [low, high] in rad/ns can hold: lists
 * of { U, D, w, power (W), detuning (rad/ns), leading: whether no other eigenvalue grows }. They are not cut to the window.
 */
export function hopfCurves(sys, powers, detunings) {
  const { U, w } = gridsOf(sys, powers, detunings);
  const known = Array.from(U, (u) => secular(Math.exp(u), sys));
  const row = (v) => {
    const omega = Math.exp(v);
    const Z = impedance(0, omega, sys);
    return (j) => hopfAt(known[j], omega, Z).f;
  };
  const at = (u, v) => hopfAt(secular(Math.exp(u), sys), Math.exp(v), impedance(0, Math.exp(v), sys));
  const line = lineAt(1e-4 * Math.min(...sys.rate), sys); // the pair at +- i w itself lies to the left
  const pointAt = ([u, v]) => {
    const [U, D] = [Math.exp(u), at(u, v).D];
    return { ...laserOf(U, D, sys), w: Math.exp(v), leading: countBeyond(line, U, D, sys) === 0 };
  };
  return contours((u, v) => at(u, v).f, row, U, w).map((points) => points.map(pointAt));
}

/** Fold curves of the same window, lists of { U, D, power, detuning }. */
export function foldCurves(sys, powers, detunings) {
  const { U, D } = gridsOf(sys, powers, detunings);
  const terms = (u) => {
    const at = balance(Math.exp(u), sys);
    return { a: Math.exp(u) * at.shiftSlope, b: at.gamma ** 2 + 2 * Math.exp(u) * at.gamma * at.gammaSlope };
  };
  const value = ({ a, b }, D) => D * D + 2 * a * D + b;
  const known = Array.from(U, terms);
  const detuned = (v) => sys.loss * Math.sinh(v);
  const row = (v) => {
    const D = detuned(v);
    return (j) => value(known[j], D);
  };
  const found = contours((u, v) => value(terms(u), detuned(v)), row, U, D);
  return found.map((points) => points.map(([u, v]) => laserOf(Math.exp(u), detuned(v), sys)));
}
