// Heaters of constant power beside the ring: coupled/heaters.py.
//
// A linear model adds what heaters do to what the light does: dT = rise + sum_i x_i, rise = sum_h R_h P_h. The light
// sees the same equations at detuning + thermal_shift rise/2 pi, from x_i(0) = -sum_h R_ih P_h where heaters and laser
// are switched on together; x_i then holds what is still missing of the heaters' rise.

import { cold, driveOf, systemOf, turnOf } from "./ring.mjs";

/** Powers in W of those heaters that a model has, by name. */
export function powersOf(model, powers) {
  return Object.fromEntries(Object.entries(powers).filter(([name, power]) => power > 0 && model.heaters && name in model.heaters));
}

/** The model with the static rise of every pole under its heaters, K. */
export function heatedBy(model, powers) {
  const on = powersOf(model, powers);
  const held = model.tau.map((_, i) => Object.entries(on).reduce((sum, [name, power]) => sum + model.heaters[name][i] * power, 0));
  return Object.keys(on).length ? { ...model, on, held } : model;
}

/** What the heaters of a model add to the temperature in the end, K. */
export function riseOf({ held = [] }) {
  return held.reduce((sum, x) => sum + x, 0);
}

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
export function turnedBy(ring, model) {
  return (systemOf(ring, model).shift * riseOf(model)) / turnOf(1);
}
