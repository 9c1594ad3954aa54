// The ring in internal units (ns, fJ, uW, K, 1e23/m^3), as coupled/kernel/cpp/equations.hpp has it.
//
//   da/dt = (i D - gamma) a + i drive,   D = -thermal_shift dT - S(N) - kerr U - detuning
//   gamma = loss + fca N + tpa U,        dN/dt = -N (1 + b N)/(tau0 (1 + a N)) + g U^2
//   P_abs = 2 (absorbed + fca N + tpa U) U

export const NS = 1e-9;
export const FJ = 1e-15;
export const UW = 1e-6;
export const DENSITY = 1e23;
export const EPSILON = 1e15 / DENSITY;
const C = 299792458.0;

export const dropRate = (ring) => ring.drop_rate ?? ring.bus_rate;
export const linearRate = (ring) => ring.bus_rate + dropRate(ring) + ring.loss_rate + ring.scattering_rate;
export const loadedQ = (ring) => (Math.PI * ring.frequency) / linearRate(ring);
export const intrinsicQ = (ring) => (Math.PI * ring.frequency) / (ring.loss_rate + ring.scattering_rate);

/**
 * Ring and thermal model in internal units; `model` has R (K/W), tau (s) and an optional coefficient (1/K). The ring's own
 * numbers that follow from several fields come from Python (`internal_rates`).
 */
export function systemOf(ring, model) {
  const { thermal_shift: shift, fca, tpa, g, tau0, a, b, kerr, fcd } = ring.internal; // each by name: the result of a spread is slow to read
  return {
    fca, tpa, g, tau0, a, b, shift, kerr,
    law: [tau0, a, b], // of the kernel's `Carriers`
    loss: linearRate(ring) * NS,
    absorbed: ring.loss_rate * NS,
    bus: ring.bus_rate * NS,
    drop: dropRate(ring) * NS,
    fcd: Float64Array.from(fcd),
    gain: Float64Array.from(model.R, (R, i) => (R * UW * NS) / model.tau[i]),
    rate: Float64Array.from(model.tau, (tau) => NS / tau),
    curvature: model.coefficient || 0,
    R: model.R.reduce((sum, R) => sum + R, 0) * UW,
  }; // prettier-ignore
}

/** sqrt(2 gamma_e P) in sqrt(fJ)/ns for a power in W. */
export const driveOf = (system, power) => Math.sqrt((2 * system.bus * power) / UW);

/** Power (W) that passes on the bus, |sqrt(P) + i sqrt(2 gamma_e) a|^2, of the field a = re + i im; `bus` is gamma_e in 1/ns. */
export function throughPower(re, im, power, bus) {
  const [inside, coupling] = [Math.sqrt(power / UW), Math.sqrt(2 * bus)];
  return ((inside - coupling * im) ** 2 + (coupling * re) ** 2) * UW;
}

/** `throughPower` at a fixed point, where a = i drive/(gamma - i D). */
export function steadyThrough(gamma, D, power, bus) {
  const scale = Math.sqrt((2 * bus * power) / UW) / (gamma * gamma + D * D);
  return throughPower(-scale * D, scale * gamma, power, bus);
}

/** Detuning in Hz to rad/ns. */
export const turnOf = (detuning) => 2 * Math.PI * detuning * NS;

/** Detuning in GHz as a change of wavelength in pm, of the same sign. */
export const toPicometres = (detuning, ring) => (1e21 * detuning * C) / ring.frequency ** 2;

/** Free-carrier dispersion S(N) and its slope. */
export function dispersion(N, fcd) {
  const square = N * N + EPSILON * EPSILON;
  let [shift, slope] = [0, 0];
  for (let k = 0; k < fcd.length; k += 2) {
    const p = fcd[k + 1];
    const factor = p === 1 ? fcd[k] : fcd[k] * Math.exp(0.5 * (p - 1) * Math.log(square));
    shift += factor * N;
    slope += factor * (1 + ((p - 1) * N * N) / square);
  }
  return [shift, slope];
}

// Numbers [x, dx/dN] with their slopes, as dual.hpp has them
const product = (x, y) => [x[0] * y[0], x[0] * y[1] + x[1] * y[0]];
const quotient = (x, y) => [x[0] / y[0], (x[1] * y[0] - x[0] * y[1]) / (y[0] * y[0])];
const affine = (constant, factor, x) => [constant + factor * x[0], factor * x[1]];

/** Recombination in 1e23/m^3 per ns, and its slope in 1/ns. */
export function recombination(N, { tau0, a, b }) {
  const n = [N, 1];
  return quotient(product(n, affine(1, b, n)), affine(tau0, tau0 * a, n));
}

/** The density N at which recombination balances generation, and dN/d(made): coupled/kernel/rates.py. */
export function steadyCarriers(made, system) {
  const k = system.tau0 * made;
  const p = 1 - system.a * k;
  const root = Math.sqrt(p * p + 4 * system.b * k);
  let N = p > 0 ? (2 * k) / (p + root) : (root - p) / (2 * system.b);
  let [lost, slope] = recombination(N, system);
  for (let pass = 0; Math.abs(lost - made) > 1e-12 * made && pass < 60; pass++) {
    N = Math.max(N - (lost - made) / slope, N / 10);
    [lost, slope] = recombination(N, system);
  }
  return [N, 1 / slope];
}

export const absorbedPower = (U, N, system) => 2 * (system.absorbed + system.fca * N + system.tpa * U) * U;

/** Sizes of field, carriers and temperature below which errors are absolute (coupled/kernel/units.py). */
export function floorOf(system, drive) {
  const U = (drive / system.loss) ** 2;
  const N = system.g > 0 ? system.tau0 * (system.b > 0 ? system.a / system.b : 1) * system.g * U ** 2 : 1;
  const sizes = [[Math.sqrt(U), Infinity], [N, 1], [system.R * 2 * system.absorbed * U, 10]]; // prettier-ignore
  return sizes.map(([size, most]) => 1e-3 * Math.min(Math.max(size, 1e-27), most));
}

/** From nothing: no light, no carriers, no heat. */
export const cold = (system) => new Float64Array(3 + system.gain.length);

// Heaters of constant power beside the ring: coupled/heaters.py.
//
// A linear model adds what heaters do to what the light does: dT = rise + sum_i x_i, rise = sum_h R_h P_h. The light
// sees the same equations at detuning + thermal_shift rise/2 pi, from x_i(0) = -sum_h R_ih P_h where heaters and laser
// are switched on together; x_i then holds what is still missing of the heaters' rise.

/** The model with the powers in W of those of its heaters that are `on`, and the static rise of every pole under them, K. */
export function heatedBy(model, powers) {
  const on = Object.fromEntries(Object.entries(powers).filter(([name, power]) => power > 0 && model.heaters && name in model.heaters));
  const held = model.tau.map((_, i) => Object.entries(on).reduce((sum, [name, power]) => sum + model.heaters[name][i] * power, 0));
  return Object.keys(on).length ? { ...model, on, held } : model;
}

/** What the heaters of a model add to the temperature in the end, K. */
export const riseOf = ({ held = [] }) => held.reduce((sum, x) => sum + x, 0);

/** What a request needs of its setting: ring, model, power (W), detuning (Hz). `moved` is the shift by heaters, rad/ns. */
export function setting({ ring, model, power, detuning }) {
  const system = systemOf(ring, model);
  const rise = riseOf(model);
  const moved = system.shift * rise;
  const start = cold(system);
  (model.held || []).forEach((x, i) => (start[3 + i] = -x));
  return { system, drive: driveOf(system, power), turn: turnOf(detuning) + moved, rise, moved, start };
}

/** Rows (t, Re a, Im a, N, dT) with the heaters' rise in dT; changes them. */
export function lifted(rows, rise) {
  for (let at = 4; rise !== 0 && at < rows.length; at += 5) rows[at] += rise;
  return rows;
}

/** What heaters move the resonance by, Hz; added to a detuning it gives that of the ring without them. */
export const turnedBy = (ring, model) => (ring.internal.thermal_shift * riseOf(model)) / turnOf(1);
