// Answers what the page asks, in a worker or beside it: numbers in, numbers out.

import { lifted, setting } from "./heater.mjs";
import { integrate } from "./integrate.mjs";
import { methodOf } from "./rosenbrock.mjs";
import { FJ, NS, UW, absorbedPower, driveOf, turnOf } from "./ring.mjs";
import { classify, columns, limitCycle, settling } from "./cycle.mjs";
import { foldCurves, hopfCurves } from "./curves.mjs";
import { follow, kindOf, reach, spectrumAt, steadyStates, survey, tilted } from "./equilibria.mjs";

export function engineOf(tableaus) {
  const rodas4 = methodOf(tableaus.rodas4);
  const rodas5p = methodOf(tableaus.rodas5p);
  return {
    trace: (request) => trace(request, rodas4, rodas5p),
    light: (request) => ({ states: states(request), points: transmission(request) }),
    plane: (request) => plane(request),
  };
}

/** A trace from cold, what it does, and where it is wanted the settled cycle. */
function trace(request, rodas4, rodas5p) {
  const { system, drive, turn, rise, start } = setting(request);
  const { duration, rtol, settled } = request;
  const run = integrate(system, drive, turn, start, duration / NS, { method: rodas4, rtol });
  const all = columns(run.rows, 0, run.count);
  const found = classify(all, rtol);
  const rows = lifted(run.rows.slice(0, 5 * run.count), rise);
  const out = { ended: run.ended, steps: run.accepted, rows, pulsing: found, cycle: null };
  if (settled && found.regime === "self-pulsing") {
    out.cycle = settle(system, drive, turn, run.y, found, request.quick, rodas4, rodas5p);
    if (out.cycle) lifted(out.cycle.rows, rise);
  }
  return out;
}

/** The stable cycle that a pulsing trace tends to, or null; unequal pulses in a pattern are one cycle. */
function settle(system, drive, turn, y, found, quick, rodas4, rodas5p) {
  const rough = { method: rodas4, rtol: 1e-5 };
  const fine = quick ? { method: rodas4, rtol: 1e-6 } : { method: rodas5p, rtol: 1e-8 };
  let { period, pattern } = found;
  let near = y;
  for (let tries = 0; tries < 3; tries++) {
    const cycle = limitCycle(system, drive, turn, near, found.level, { rough, fine, period, pattern });
    if (cycle) {
      const slowest = settling(cycle.multipliers);
      if (slowest < 1) return { ...cycle, slowest, pattern };
      const { re, im } = cycle.multipliers;
      if (!re.some((x, k) => x < -1 && im[k] === 0)) return null; // an unstable one is not where the ring settles
      [period, pattern] = [2 * period, 2 * pattern]; // pulses that alternate by less than classify sees
    }
    near = integrate(system, drive, turn, near, 20 * found.period, rough).y;
  }
  return null;
}

/** Every fixed point at one laser setting, SI. */
function states(request) {
  const { system, drive, turn, rise } = setting(request);
  return steadyStates(drive, turn, system).map((p) => ({
    energy: p.U * FJ,
    carriers: p.N * 1e23,
    delta_T: p.dT + rise,
    drop: 2 * system.drop * p.U * UW,
    absorbed: absorbedPower(p.U, p.N, system) * UW,
    growth_rate: p.growth / NS,
    frequency: p.omega / (2 * Math.PI * NS),
    regime: p.regime,
  }));
}

/** Regimes over powers (W) and detunings (Hz): coarse at once, then fine; then the curves. A generator of parts. */
function* plane(request) {
  const { system, moved } = setting(request);
  const { powers, detunings, sizes } = request;
  for (const [n, m] of sizes) {
    const P = Array.from({ length: n }, (_, i) => powers[0] * (powers[1] / powers[0]) ** ((i + 0.5) / n));
    const nu = Array.from({ length: m }, (_, j) => detunings[0] + ((j + 0.5) / m) * (detunings[1] - detunings[0]));
    const turns = nu.map((x) => turnOf(x) + moved);
    const stable = new Int8Array(n * m);
    for (let i = 0; i < n; i++) {
      stable.set(survey(turns, driveOf(system, P[i]), system).stable, i * m);
      if (i % 4 === 3) yield null;
    }
    yield { kind: "map", n, m, stable };
    if (n === sizes[0][0]) {
      const window = [powers, detunings.map((x) => turnOf(x) + moved)];
      const inHertz = (line) => line.map((p) => ({ power: p.power, detuning: (p.detuning - moved) / turnOf(1), leading: p.leading }));
      const folds = foldCurves(system, ...window).map(inHertz);
      yield null;
      yield { kind: "curves", folds, hopf: hopfCurves(system, ...window).map(inHertz) };
    }
  }
}

/** The tilted resonance at one power between two detunings (Hz): detuning, drop (W), regime along it. */
function transmission(request) {
  const { system, drive, moved } = setting(request);
  const [first, last] = request.detunings.map((x) => turnOf(x) + moved);
  const end = reach(Math.max(Math.abs(first), Math.abs(last)), drive, system);
  const points = [];
  const n = 400;
  let z = null;
  let cut = false; // whether the curve was outside before this point
  for (let k = 0; k <= n; k++) {
    const s = -end + (2 * end * k) / n;
    const p = tilted(s, drive, system);
    if (p.detuning < first - 1 || p.detuning > last + 1) {
      z = null;
      cut = true;
      continue;
    }
    if (!z || !follow(z.re, z.im, p.U, p.D, system)) z = spectrumAt(p.U, p.D, system);
    points.push({ detuning: (p.detuning - moved) / turnOf(1), drop: 2 * system.drop * p.U * UW, energy: p.U * FJ, regime: kindOf(z).regime, cut });
    cut = false;
  }
  return points;
}
