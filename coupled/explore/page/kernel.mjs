// coupled/kernel as WebAssembly, and the loop around it that coupled/kernel/integrator.py has: the equations stand there.
//
// kernel.wasm is compiled from kernel.cpp by coupled/explore/bundle.py. It is committed, so that a page can be written on a
// machine without zig, which brings the C library of WebAssembly; a test compiles it again and compares.

import { eigenvalues } from "./eigen.mjs";
import { floorOf } from "./ring.mjs";

const [FULL, RESTING] = [2, 4];
export const [DONE, EVENT] = [0, 3];
const MAX_STEPS = 400000;
const CAP = 0.25; // step times the rate of what grows, where the state rests
const [H, RTOL, LONGEST, LIMIT, LOOKED, LEVEL, SEEN] = [1, 5, 6, 8, 9, 10, 11]; // of `Loop`, as doubles
const [ACCEPTED, REJECTED, LOOK_AGAIN, FILLED, ROOM, BUDGET, PER_STEP, QUANTITY, HALT] = [26, 28, 30, 32, 34, 36, 42, 43, 45]; // as integers

let wasm = null;
let loading = null;
const methods = {};
const buffers = {};

/** Start the module, once; `bytes` in base64, and the tables of the methods. */
export function loadKernel(kernel) {
  return (loading ||= instantiate(kernel));
}

async function instantiate({ bytes, tableaus }) {
  const { instance } = await WebAssembly.instantiate(Uint8Array.from(atob(bytes), (x) => x.charCodeAt(0)));
  wasm = instance.exports;
  wasm._initialize();
  for (const [name, { order, gamma, ...arrays }] of Object.entries(tableaus)) {
    const places = Object.entries(arrays).map(([key, rows]) => store(`${name} ${key}`, rows.flat()));
    methods[name] = { words: [arrays.a.length, order, 0, 0, ...places, 0], gamma };
  }
}

const doubles = (at, n) => new Float64Array(wasm.memory.buffer, at, n);
const integers = (at, n) => new Int32Array(wasm.memory.buffer, at, n);

const identity = (n) => Float64Array.from({ length: n * n }, (_, k) => (k % (n + 1) ? 0 : 1));

/** Address of a named buffer of at least n numbers, which keeps what it holds. */
function buffer(name, n) {
  const own = (buffers[name] ||= { at: 0, size: 0 });
  if (own.size < n) Object.assign(own, { at: wasm.realloc(own.at, 8 * n), size: n });
  return own.at;
}

function store(name, values) {
  const at = buffer(name, values.length);
  doubles(at, values.length).set(values);
  return at;
}

/** Address of `Problem` (equations.hpp): one ring under constant light until `stop` ns. */
function problemOf(system, drive, detuning, stop, method) {
  const s = system;
  const { words, gamma } = methods[method];
  const edges = store("edges", [0, stop]);
  const zero = store("zero", [0]); // of the only piece of the drive, which neither jumps nor varies
  const constant = (name, value) => [1, 4, zero, edges, store(name, [value, 0, 0, 0])];
  const ones = s.gain.map(() => 1);
  const arrays = {
    modes: [s.loss, s.absorbed, s.fca, s.tpa, s.g, s.shift, 1, s.kerr], carriers: s.law, dispersion: s.fcd,
    bend: [s.curvature], own: [0, 0], floor: floorOf(s, drive), read: ones, weight: ones, gain: s.gain, rate: s.rate,
  }; // prettier-ignore
  const at = buffer("problem", 34);
  const absent = (n) => Array(n).fill(0);
  const pointers = Object.entries(arrays).map(([name, values]) => store(name, values));
  const tables = [constant("power", drive * drive), constant("phase", 0), constant("detuning", detuning)].flat();
  const light = [store("entry", [1, 0]), store("brightest", [Math.max(drive * drive, 1e-300)])];
  const sizes = [1, 1, s.gain.length, s.fcd.length / 2, 1, 1, 0, 0, 0, 0];
  integers(at, 68).set([...sizes, ...words, ...pointers, ...absent(5), edges, zero, zero, ...tables, ...light, ...absent(13)]);
  doubles(at, 34)[6] = gamma;
  return at;
}

/**
 * Integrate from y at t = 0 to `stop` ns under a constant laser.
 *
 * options: method, rtol, first (step to try first), event { level, leaving } (it ends where N rises through level),
 * times (wanted output times, ns), steps (whether to keep the lengths of the steps).
 * Returns rows (t, Re a, Im a, N, dT for each accepted step or wanted time), count, y, t, accepted, steps, ended.
 */
export function integrate(system, drive, detuning, start, stop, { method, rtol, first = 0, event = null, times = null, steps = false }) {
  const problem = problemOf(system, drive, detuning, stop, method);
  const wanted = times ? times.length : 0;
  const [y, output, loop] = [store("y", start), wanted && store("times", times), buffer("loop", 26)];
  let [L, I] = [doubles(loop, 26).fill(0), integers(loop, 52)];
  [L[H], L[RTOL], L[LONGEST], L[LEVEL]] = [first, rtol, Infinity, event ? event.level : 0];
  L[SEEN] = event && event.leaving ? 0 : Infinity;
  [I[PER_STEP], I[QUANTITY], I[HALT]] = [1, event ? 2 : 0, event ? 1 : 0];
  let capacity = Math.max(8192, wanted);
  let ended = FULL;
  while ([FULL, RESTING].includes(ended)) {
    const [rows, kept] = [buffer("rows", 5 * capacity), steps ? buffer("steps", capacity) : 0];
    [L, I] = [doubles(loop, 26), integers(loop, 52)]; // anew: memory may have grown
    [I[ROOM], I[BUDGET]] = [capacity, MAX_STEPS - I[ACCEPTED] - I[REJECTED]];
    ended = wasm.ring_integrate(problem, loop, y, rows, capacity, output, wanted, kept);
    if (ended === FULL) capacity *= 2;
    if (ended === RESTING) {
      // an L-stable method damps with a long step what grows by the equations
      const { re, im } = eigenvalues(slopesAt(problem, y, start.length).J, start.length);
      const fastest = re.reduce((most, x, k) => (x > 0 ? Math.max(most, Math.hypot(x, im[k])) : most), 0);
      [L[LIMIT], L[LOOKED], I[LOOK_AGAIN]] = [CAP / fastest, L[H], I[ACCEPTED] + 20];
      L[H] = Math.min(L[H], L[LIMIT]);
    }
  }
  const [accepted, count] = [I[ACCEPTED], I[FILLED]];
  return {
    rows: doubles(buffers.rows.at, 5 * count).slice(), count, y: doubles(y, start.length).slice(), t: L[0], accepted, ended,
    steps: steps ? doubles(buffers.steps.at, accepted).slice() : null,
  }; // prettier-ignore
}

function slopesAt(problem, y, n) {
  const [rate, J] = [buffer("slopes", n), store("matrix", identity(n))];
  wasm.ring_slopes(problem, y, rate, J);
  return { rate: doubles(rate, n).slice(), J: doubles(J, n * n).slice() };
}

/** dy/dt at a state and its derivative, row-major. */
export function slopes(system, drive, detuning, y) {
  return slopesAt(problemOf(system, drive, detuning, 1, "rodas4"), store("y", y), y.length);
}

/** The derivative of the flow along the given steps, row-major. */
export function flowAlong(system, drive, detuning, start, steps, method) {
  const n = start.length;
  const problem = problemOf(system, drive, detuning, 1, method);
  const [y, V, kept, end] = [store("y", start), store("matrix", identity(n)), store("steps", steps), buffer("slopes", n)];
  wasm.ring_follow(problem, y, kept, steps.length, end, V);
  return doubles(V, n * n).slice();
}
