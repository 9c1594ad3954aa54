// Answers what the page asks, numbers in, numbers out: in a worker for each channel, newest request first.

import { foldCurves, hopfCurves } from "./curves.mjs";
import { limitCycle, settling } from "./cycle.mjs";
import { countBeyond, lineAt, reach, steadyStates, survey, tilted } from "./equilibria.mjs";
import { DONE, integrate, loadKernel } from "./kernel.mjs";
import { classify, columns, extent, lasting } from "./pulsing.mjs";
import { DENSITY, FJ, NS, UW, absorbedPower, driveOf, lifted, setting, steadyThrough, turnOf } from "./ring.mjs";

const EQUAL = 1e-4; // relative difference of periods that counts as none; a cycle of a slider is found within 1e-5

export function engineOf() {
  const known = { cycle: null }; // the last settled one
  return {
    trace: (request) => trace(request, known),
    light: (request) => ({ states: states(request), points: request.curve === false ? null : transmission(request) }),
    plane: (request) => plane(request),
  };
}

/**
 * A trace from cold, what it does, and where it is wanted the settled cycle. With `follow` the cycle of the last request is
 * followed to the present setting, without a trace, as long as it stays stable.
 */
function trace(request, known) {
  const { system, drive, turn, rise, start } = setting(request);
  const { duration, rtol, settled } = request;
  if (request.follow && settled && known.cycle) {
    known.cycle = followed(system, drive, turn, known.cycle);
    if (known.cycle) {
      const rows = lifted(known.cycle.rows.slice(), rise);
      const { period, duty, swing, level, pattern } = known.cycle;
      const pulsing = { regime: "self-pulsing", period, duty, swing, cycles: pattern, begin: 0, end: period, level, pattern };
      return { ended: DONE, steps: 0, rows, pulsing, cycle: { ...known.cycle, rows }, followed: true };
    }
  }
  const run = integrate(system, drive, turn, start, duration / NS, { method: "rodas4", rtol });
  const rows = lifted(run.rows, rise);
  const all = columns(rows, 0, run.count);
  const found = verdict(all, rtol, () => steadyStates(drive, turn, system).map((p) => ({ ...p, dT: p.dT + rise })));
  const out = { ended: run.ended, steps: run.accepted, rows, pulsing: found, cycle: null };
  if (!settled) return out;
  const pulses = found.regime === "self-pulsing" && all.N.some((x) => x > 0); // settled cycles are told by carriers
  known.cycle = pulses ? settle(system, drive, turn, run.y, found, accuracyOf(request.quick)) : null;
  if (known.cycle) out.cycle = { ...known.cycle, rows: lifted(known.cycle.rows.slice(), rise) };
  return out;
}

/** What a trace does; `points` gives the fixed points, which tell whether a trace that looks like rest is there. */
function verdict(all, rtol, points) {
  const found = classify(all, rtol);
  return found.regime === "stable" ? lasting(found, all, points()) : found;
}

/** How accurately a settled cycle is computed. */
function accuracyOf(quick) {
  const rough = { method: "rodas4", rtol: 1e-5 };
  return quick ? { rough, fine: rough, close: [1e-5, 1e-4], renew: 0.5 } : { rough, fine: { method: "rodas5p", rtol: 1e-8 } };
}

/** The stable cycle that another one becomes when the setting moves a little, or null. */
function followed(system, drive, turn, { y, rows, count, period, pattern }) {
  if (y.length !== system.gain.length + 3) return null;
  const [low, high] = extent(columns(rows, 0, count).N);
  const cycle = limitCycle(system, drive, turn, y, (low + high) / 2, { ...accuracyOf(true), period, pattern });
  const slowest = cycle ? settling(cycle.multipliers) : Infinity;
  return slowest < 1 ? { ...cycle, slowest, pattern } : null;
}

/** The stable cycle that a pulsing trace tends to, or null; unequal pulses in a pattern are one cycle. */
function settle(system, drive, turn, y, found, accuracy) {
  let { period, pattern } = found;
  let near = y;
  for (let tries = 0; tries < 3; tries++) {
    const cycle = limitCycle(system, drive, turn, near, found.level, { ...accuracy, period, pattern });
    if (cycle) {
      const slowest = settling(cycle.multipliers);
      if (slowest < 1) return shortest(system, drive, turn, { ...cycle, slowest, pattern }, accuracy);
      const { re, im } = cycle.multipliers;
      if (!re.some((x, k) => x < -1 && Math.abs(im[k]) < 1e-6)) return null; // an unstable one is not where the ring settles
      [period, pattern] = [2 * period, 2 * pattern]; // pulses that alternate by less than classify sees
    }
    near = integrate(system, drive, turn, near, 20 * found.period, accuracy.rough).y;
  }
  return null;
}

/** A stable cycle, or the one of fewer pulses that it repeats: pulses that become equal may alternate while the ring settles. */
function shortest(system, drive, turn, cycle, accuracy) {
  for (let pattern = 1; pattern < cycle.pattern; pattern++) {
    const period = (cycle.period * pattern) / cycle.pattern;
    if (cycle.pattern % pattern) continue;
    const part = limitCycle(system, drive, turn, cycle.y, cycle.level, { ...accuracy, period, pattern });
    const slowest = part ? settling(part.multipliers) : Infinity;
    if (slowest < 1 && Math.abs(part.period / period - 1) < EQUAL) return { ...part, slowest, pattern };
  }
  return cycle;
}

/** Every fixed point at one laser setting, SI. */
function states(request) {
  const { system, drive, turn, rise } = setting(request);
  return steadyStates(drive, turn, system).map(({ U, D, N, dT, gamma, growth, omega, regime }) => ({
    energy: U * FJ, carriers: N * DENSITY, delta_T: dT + rise, drop: 2 * system.drop * U * UW, regime,
    through: steadyThrough(gamma, D, request.power, system.bus), absorbed: absorbedPower(U, N, system) * UW, growth_rate: growth / NS, frequency: omega / (2 * Math.PI * NS),
  })); // prettier-ignore
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
      stable.set(survey(turns, driveOf(system, P[i]), system), i * m);
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

/** The tilted resonance at one power between two detunings (Hz): detuning, drop and through (W), regime along it. */
function transmission(request) {
  const { system, drive, moved } = setting(request);
  const [first, last] = request.detunings.map((x) => turnOf(x) + moved);
  const end = reach(Math.max(Math.abs(first), Math.abs(last)), drive, system);
  const points = [];
  const n = 400;
  const [at, line] = [tilted(drive, system), lineAt(0, system)];
  let cut = false; // whether the curve was outside before this point
  for (let k = 0; k <= n; k++) {
    const p = at(-end + (2 * end * k) / n);
    if (p.detuning < first - 1 || p.detuning > last + 1) {
      cut = true;
      continue;
    }
    const grow = countBeyond(line, p.U, p.D, system);
    const regime = grow % 2 ? "saddle" : grow ? "unstable" : "stable";
    const through = steadyThrough(p.gamma, p.D, request.power, system.bus);
    points.push({ detuning: (p.detuning - moved) / turnOf(1), drop: 2 * system.drop * p.U * UW, through, energy: p.U * FJ, regime, cut });
    cut = false;
  }
  return points;
}

const LISTEN = 30; // ms between two looks for a newer request

/** Answer one request; `report` is called for every part, `stale` says whether a newer request has come. */
async function answer(engine, request, report, stale) {
  const result = engine[request.kind](request);
  if (!result.next) return report(result, true);
  let since = performance.now();
  for (const part of result) {
    if (part) report(part, false);
    if (performance.now() - since < LISTEN) continue;
    await new Promise((resume) => setTimeout(resume)); // 4 ms at least, for a browser
    if (stale()) return undefined;
    since = performance.now();
  }
  return report(null, true);
}

/** What runs in a worker. */
export function serve(scope) {
  const engine = engineOf();
  let ready = null;
  let newest = 0;
  scope.onmessage = async ({ data }) => {
    if (data.kernel) {
      ready = loadKernel(data.kernel);
      return;
    }
    newest = data.id;
    const report = (part, last) => scope.postMessage({ id: data.id, part, last });
    try {
      await ready;
      await answer(engine, data.request, report, () => newest !== data.id);
    } catch (error) {
      scope.postMessage({ id: data.id, error: String(error.message || error), last: true });
    }
  };
}

const DEPTH = 2; // requests with a worker: it begins the next while the page draws

/**
 * A channel: ask(request) runs the newest request that was asked; what comes while the worker has enough to do waits, and only
 * the last of it. `preempt` says that a newer request ends those that run (their parts are given up between two of them).
 */
export function channel(code, kernel, receive, { preempt = false } = {}) {
  const running = new Map();
  let waiting = null;
  let id = 0;
  const arrived = ({ id: of, part, last, error }) => {
    const request = running.get(of);
    if (!request) return;
    if (error) receive({ error }, request);
    else if (part !== null) receive(part, request);
    if (!last) return;
    running.delete(of);
    if (waiting) ask(waiting);
  };
  const worker = new Worker(URL.createObjectURL(new Blob([code], { type: "text/javascript" })));
  worker.onmessage = ({ data }) => arrived(data);
  worker.onerror = () => [...running.keys()].forEach((of) => arrived({ id: of, error: "the worker stopped", last: true }));
  worker.postMessage({ kernel });
  function ask(request) {
    if (preempt) running.clear();
    waiting = running.size < DEPTH ? null : request;
    if (waiting) return;
    running.set(++id, request);
    worker.postMessage({ id, request });
  }
  return ask;
}
