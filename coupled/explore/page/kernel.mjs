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

let wasm = null;
let loading = null;
const offsets = {}; // bytes from the start of a structure to a field, such as "Loop.t", and sizes of structures, such as "Loop"
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
  readLayout();
  for (const [name, { order, gamma, ...arrays }] of Object.entries(tableaus)) {
    const addresses = Object.entries(arrays).map(([key, rows]) => [key, store(`${name} ${key}`, rows.flat())]);
    methods[name] = { words: { stages: arrays.a.length, order, ...Object.fromEntries(addresses) }, gamma };
  }
}

/** Read the table of layout.cpp: rows of a name's address (0 ends it) and a number of bytes, 16 bytes each. */
function readLayout() {
  const view = memory();
  for (let row = wasm.ring_layout(); view.getUint32(row, true); row += 16) {
    let name = "";
    for (let at = view.getUint32(row, true); view.getUint8(at); at++) name += String.fromCharCode(view.getUint8(at));
    offsets[name] = view.getUint32(row + 8, true);
  }
}

const memory = () => new DataView(wasm.memory.buffer);

function offsetOf(field) {
  if (!(field in offsets)) throw new Error(`kernel.wasm has no ${field}`);
  return offsets[field];
}

/** Address of a new structure, all zero. */
function structure(type) {
  const numbers = offsetOf(type) / 8;
  const at = buffer(type, numbers);
  doubles(at, numbers).fill(0);
  return at;
}

/** Set fields of the structure at an address by their names: integers and addresses. */
function setWords(type, at, values) {
  for (const [name, value] of Object.entries(values)) memory().setInt32(at + offsetOf(`${type}.${name}`), value, true);
}

function setReals(type, at, values) {
  for (const [name, value] of Object.entries(values)) memory().setFloat64(at + offsetOf(`${type}.${name}`), value, true);
}

const word = (type, at, name) => memory().getInt32(at + offsetOf(`${type}.${name}`), true);

const real = (type, at, name) => memory().getFloat64(at + offsetOf(`${type}.${name}`), true);

const doubles = (at, n) => new Float64Array(wasm.memory.buffer, at, n);

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
  const ones = s.gain.map(() => 1);
  const arrays = {
    modes: [s.loss, s.absorbed, s.fca, s.tpa, s.g, s.shift, 1, s.kerr], carriers: s.law, dispersion: s.fcd,
    bend: [s.curvature], own: [0, 0], floor: floorOf(s, drive), read: ones, weight: ones, gain: s.gain, rate: s.rate,
    entry: [1, 0], brightest: [Math.max(drive * drive, 1e-300)],
  }; // prettier-ignore
  const at = structure("Problem");
  const addresses = Object.entries(arrays).map(([name, values]) => [name, store(name, values)]);
  const sizes = { rings: 1, fields: 1, order: s.gain.length, terms: s.fcd.length / 2, lasers: 1, pieces: 1 };
  setWords("Problem", at, { ...sizes, ...Object.fromEntries(addresses), edges, jumps: zero, varies: zero });
  for (const [name, value] of Object.entries({ power: drive * drive, phase: 0, detuning })) {
    const table = { columns: 1, terms: 4, place: zero, edges, c: store(name, [value, 0, 0, 0]) };
    setWords("Table", at + offsetOf(`Problem.${name}`), table);
  }
  setWords("Method", at + offsetOf("Problem.method"), words);
  setReals("Method", at + offsetOf("Problem.method"), { gamma });
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
  const [y, output, loop] = [store("y", start), wanted && store("times", times), structure("Loop")];
  const count = (name) => word("Loop", loop, name);
  setReals("Loop", loop, { h: first, rtol, longest: Infinity, level: event ? event.level : 0, seen: event && event.leaving ? 0 : Infinity });
  setWords("Loop", loop, { per_step: 1, quantity: event ? 2 : 0, stop: event ? 1 : 0 });
  let capacity = Math.max(8192, wanted);
  let ended = FULL;
  while ([FULL, RESTING].includes(ended)) {
    const [rows, kept] = [buffer("rows", 5 * capacity), steps ? buffer("steps", capacity) : 0];
    setWords("Loop", loop, { room: capacity, budget: MAX_STEPS - count("accepted") - count("rejected") });
    ended = wasm.page_integrate(problem, loop, y, rows, capacity, output, wanted, kept);
    if (ended === FULL) capacity *= 2;
    if (ended === RESTING) {
      // an L-stable method damps with a long step what grows by the equations
      const { re, im } = eigenvalues(slopesAt(problem, y, start.length).J, start.length);
      const fastest = re.reduce((most, x, k) => (x > 0 ? Math.max(most, Math.hypot(x, im[k])) : most), 0);
      const [h, cap] = [real("Loop", loop, "h"), CAP / fastest];
      setReals("Loop", loop, { cap, rest_step: h, h: Math.min(h, cap) });
      setWords("Loop", loop, { rest_again: count("accepted") + 20 });
    }
  }
  const [accepted, filled] = [count("accepted"), count("filled")];
  return {
    rows: doubles(buffers.rows.at, 5 * filled).slice(), count: filled, y: doubles(y, start.length).slice(), t: real("Loop", loop, "t"), accepted, ended,
    steps: steps ? doubles(buffers.steps.at, accepted).slice() : null,
  }; // prettier-ignore
}

function slopesAt(problem, y, n) {
  const [rate, J] = [buffer("slopes", n), store("matrix", identity(n))];
  wasm.page_slopes(problem, y, rate, J);
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
  wasm.page_follow(problem, y, kept, steps.length, end, V);
  return doubles(V, n * n).slice();
}
