// Hopf and fold curves of the plane of power and detuning: coupled/equilibria/boundaries.py.
//
// The eigenvalues at the fixed point (U, D) obey A(lambda, U) + D^2 - D B(lambda, U) = 0 with
//   A = (lambda + gamma)[lambda + gamma + 2 tpa U + alpha/(lambda + rho)]
//   B = kerr + [beta + Z(lambda)(heat (lambda + rho) + cross)]/(lambda + rho)
// At lambda = i w the real part is a quadratic equation for D, which leaves one real equation on each of two sheets
// over (log U, log w): D = [Re B +- sqrt((Re B)^2 - 4 Re A)]/2,  Im A - D Im B = 0.
// At a fold lambda = 0: D = -U shift' +- sqrt((U shift')^2 - gamma^2 - 2 U gamma gamma').

import { balance, energy, follow, reach, secular, spectrumAt } from "./equilibria.mjs";
import { UW, driveOf } from "./ring.mjs";

const ENERGIES = 240;
const FREQUENCIES = 200;
const BISECTIONS = 40;
const JOIN = 0.3;

/** Thermal impedance of the network at i w, [re, im] in K/uW. */
function impedance(w, sys) {
  let re = 0;
  let im = 0;
  for (let i = 0; i < sys.gain.length; i++) {
    const f = sys.gain[i] / (sys.rate[i] ** 2 + w * w);
    re += f * sys.rate[i];
    im -= f * w;
  }
  return [re, im];
}

/** The remaining equation on one sheet, D, and whether the square root is real; c by `secular`, Z by `impedance`. */
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
  return { f: (Ai - D * Bi) / w, D, real: square > 0 };
}

/** Energies and frequencies (rad/ns) that the fixed points of a window can have; powers in W, detunings in rad/ns. */
function ranges(sys, powers, detunings) {
  const farthest = Math.max(...detunings.map(Math.abs));
  const weak = driveOf(sys, powers[0]);
  const strong = driveOf(sys, powers[1]);
  const high = energy(0, strong, sys);
  const low = energy(reach(farthest, strong, sys), weak, sys);
  let fastest = 0;
  for (let k = 0; k <= 20; k++) {
    const at = balance(low * (high / low) ** (k / 20), sys);
    fastest = Math.max(fastest, at.gamma + Math.abs(at.shift));
  }
  const slowest = sys.rate.reduce((least, x) => Math.min(least, x), Infinity);
  return { low, high, wLow: 1e-4 * slowest, wHigh: 2 * (fastest + farthest) };
}

function logSpaced(low, high, n) {
  return Float64Array.from({ length: n }, (_, k) => Math.log(low) + (Math.log(high / low) * k) / (n - 1));
}

/** Zero contours of values[i * nx + j] as lists of crossed grid edges [i, j, along], along 0 for x and 1 for y. */
function contours(values, nx, ny) {
  const id = (i, j, along) => 2 * (i * nx + j) + along;
  const links = new Map();
  const link = (a, b) => {
    if (!links.has(a)) links.set(a, []);
    if (!links.has(b)) links.set(b, []);
    links.get(a).push(b);
    links.get(b).push(a);
  };
  const up = (i, j) => values[i * nx + j] > 0;
  for (let i = 0; i + 1 < ny; i++) {
    for (let j = 0; j + 1 < nx; j++) {
      const a = up(i, j), b = up(i, j + 1), c = up(i + 1, j + 1), d = up(i + 1, j); // prettier-ignore
      const edges = [];
      if (a !== b) edges.push(id(i, j, 0));
      if (b !== c) edges.push(id(i, j + 1, 1));
      if (c !== d) edges.push(id(i + 1, j, 0));
      if (d !== a) edges.push(id(i, j, 1));
      if (edges.length === 2) link(edges[0], edges[1]);
      else if (edges.length === 4) {
        const middle = values[i * nx + j] + values[i * nx + j + 1] + values[(i + 1) * nx + j] + values[(i + 1) * nx + j + 1] > 0;
        if (middle === a) {
          link(edges[0], edges[1]);
          link(edges[2], edges[3]);
        } else {
          link(edges[0], edges[3]);
          link(edges[1], edges[2]);
        }
      }
    }
  }
  const lines = [];
  const seen = new Set();
  const walk = (from) => {
    const line = [from];
    seen.add(from);
    for (let at = from; ; ) {
      const next = links.get(at).find((x) => !seen.has(x));
      if (next === undefined) {
        if (line.length > 2 && links.get(at).includes(from)) line.push(from);
        break;
      }
      seen.add(next);
      line.push(next);
      at = next;
    }
    lines.push(line.map((x) => [Math.floor(x / 2 / nx), Math.floor(x / 2) % nx, x % 2]));
  };
  for (const [edge, to] of links) if (to.length === 1 && !seen.has(edge)) walk(edge);
  for (const edge of links.keys()) if (!seen.has(edge)) walk(edge);
  return lines;
}

/** Pieces of Hopf curves, points { x: log U, y: log w, D }, on one sheet. */
function piecesOf(sys, x, y, sign) {
  const values = new Float64Array(x.length * y.length);
  const at = Array.from(x, (v) => secular(Math.exp(v), sys));
  for (let i = 0; i < y.length; i++) {
    const w = Math.exp(y[i]);
    const Z = impedance(w, sys);
    for (let j = 0; j < x.length; j++) values[i * x.length + j] = sheet(at[j], w, Z, sign).f;
  }
  const evaluate = (u, v) => {
    const w = Math.exp(v);
    return sheet(secular(Math.exp(u), sys), w, impedance(w, sys), sign);
  };
  const out = [];
  for (const line of contours(values, x.length, y.length)) {
    const points = line.map(([i, j, along]) => {
      let a = [x[j], y[i]];
      let b = along ? [x[j], y[i + 1]] : [x[j + 1], y[i]];
      const start = evaluate(...a).f > 0;
      for (let k = 0; k < BISECTIONS; k++) {
        const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
        if (evaluate(...middle).f > 0 === start) a = middle;
        else b = middle;
      }
      const p = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
      return { x: p[0], y: p[1], ...evaluate(...p) };
    });
    let piece = [];
    let opened = false;
    points.forEach((p, k) => {
      if (p.real) {
        if (!piece.length) opened = k > 0;
        piece.push(p);
      }
      if (piece.length && (!p.real || k === points.length - 1)) {
        out.push({ points: piece, meets: [opened, !p.real] });
        piece = [];
      }
    });
  }
  return out;
}

/** Join pieces whose ends lie where the sheets meet, each with the nearest such end. */
function joined(pieces) {
  let lines = pieces.slice();
  for (;;) {
    const ends = [];
    lines.forEach((line, k) => line.meets.forEach((meets, e) => meets && ends.push([k, e])));
    const at = ([k, e]) => lines[k].points.at(e ? -1 : 0);
    let best = { distance: Infinity };
    for (let i = 0; i < ends.length; i++) {
      for (let j = i + 1; j < ends.length; j++) {
        const [p, q] = [at(ends[i]), at(ends[j])];
        const distance = Math.hypot(p.x - q.x, p.y - q.y);
        if (distance < best.distance) best = { distance, one: ends[i], two: ends[j] };
      }
    }
    if (!(best.distance <= JOIN)) return lines.map((line) => line.points);
    const [[k, e], [m, f]] = [best.one, best.two];
    if (k === m) {
      lines[k] = { points: [...lines[k].points, lines[k].points[0]], meets: [false, false] };
      continue;
    }
    const one = e === 1 ? lines[k].points : lines[k].points.slice().reverse();
    const two = f === 0 ? lines[m].points : lines[m].points.slice().reverse();
    const whole = { points: [...one, ...two], meets: [lines[k].meets[1 - e], lines[m].meets[1 - f]] };
    lines = [...lines.filter((_, i) => i !== k && i !== m), whole];
  }
}

function laserOf(U, D, sys) {
  const at = balance(U, sys);
  return { power: ((U * (at.gamma ** 2 + D * D)) / (2 * sys.bus)) * UW, detuning: at.shift - D };
}

/** Whether no eigenvalue but the pair nearest to +- i w grows, along a curve of { U, D, w }. */
function mark(points, sys) {
  let z = null;
  for (const p of points) {
    if (!z || !follow(z.re, z.im, p.U, p.D, sys)) z = spectrumAt(p.U, p.D, sys);
    const rest = Array.from(z.re, (re, k) => ({ re, im: z.im[k] }));
    for (const w of [p.w, -p.w]) {
      let near = 0;
      rest.forEach((v, k) => {
        if (Math.hypot(v.re, v.im - w) < Math.hypot(rest[near].re, rest[near].im - w)) near = k;
      });
      rest.splice(near, 1);
    }
    p.leading = rest.every((v) => v.re < 0);
  }
}

/**
 * Hopf curves whose energies a window of powers [low, high] in W and detunings [low, high] in rad/ns can hold: lists
 * of { U, D, w, power (W), detuning (rad/ns), leading }. They are not cut to the window.
 */
export function hopfCurves(sys, powers, detunings) {
  const { low, high, wLow, wHigh } = ranges(sys, powers, detunings);
  const x = logSpaced(low, high, ENERGIES);
  const y = logSpaced(wLow, wHigh, FREQUENCIES);
  const lines = joined([...piecesOf(sys, x, y, 1), ...piecesOf(sys, x, y, -1)]);
  return lines.map((line) => {
    const points = line.map((p) => {
      const U = Math.exp(p.x);
      return { U, D: p.D, w: Math.exp(p.y), ...laserOf(U, p.D, sys) };
    });
    mark(points, sys);
    return points;
  });
}

/** Every Hopf point { D, w } of one energy, by a scan over the frequencies of a window and bisection. */
export function hopfPoints(U, sys, powers, detunings) {
  const { wLow, wHigh } = ranges(sys, powers, detunings);
  const y = logSpaced(wLow, wHigh, 2000);
  const c = secular(U, sys);
  const at = (v, sign) => sheet(c, Math.exp(v), impedance(Math.exp(v), sys), sign);
  const out = [];
  for (const sign of [1, -1]) {
    for (let k = 0; k + 1 < y.length; k++) {
      let [a, b] = [y[k], y[k + 1]];
      const start = at(a, sign);
      if (start.f > 0 === at(b, sign).f > 0) continue;
      for (let i = 0; i < 60; i++) {
        const middle = (a + b) / 2;
        if (at(middle, sign).f > 0 === start.f > 0) a = middle;
        else b = middle;
      }
      const found = at((a + b) / 2, sign);
      if (found.real) out.push({ D: found.D, w: Math.exp((a + b) / 2) });
    }
  }
  return out;
}

/** Fold curves of the same window, lists of { U, D, power, detuning }. */
export function foldCurves(sys, powers, detunings) {
  const { low, high } = ranges(sys, powers, detunings);
  const terms = (U) => {
    const at = balance(U, sys);
    const a = U * at.shiftSlope;
    return { a, square: a * a - at.gamma ** 2 - 2 * U * at.gamma * at.gammaSlope };
  };
  const n = 1200;
  const U = logSpaced(low, high, n).map(Math.exp);
  const has = Array.from(U, (u) => terms(u).square >= 0);
  const edges = has[0] ? [U[0]] : [];
  for (let k = 0; k + 1 < n; k++) {
    if (has[k] === has[k + 1]) continue;
    let [inside, outside] = has[k] ? [U[k], U[k + 1]] : [U[k + 1], U[k]];
    for (let i = 0; i < BISECTIONS; i++) {
      const middle = (inside + outside) / 2;
      if (terms(middle).square >= 0) inside = middle;
      else outside = middle;
    }
    edges.push(inside);
  }
  if (has[n - 1]) edges.push(U[n - 1]);
  const curves = [];
  for (let e = 0; e + 1 < edges.length; e += 2) {
    const lower = [];
    const upper = [];
    for (let k = 0; k < 150; k++) {
      const turn = 0.5 - 0.5 * Math.cos((Math.PI * k) / 149);
      const u = edges[e] * (edges[e + 1] / edges[e]) ** turn;
      const { a, square } = terms(u);
      const root = Math.sqrt(Math.max(square, 0));
      lower.push({ U: u, D: -a - root, ...laserOf(u, -a - root, sys) });
      upper.push({ U: u, D: -a + root, ...laserOf(u, -a + root, sys) });
    }
    curves.push([...lower.reverse(), ...upper.slice(1)]);
  }
  return curves;
}
