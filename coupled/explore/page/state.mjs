// The state of the page: what its fields hold, the link that restores it, and the ring that follows from it.

import { heatedBy, turnedBy } from "./heater.mjs";
import { dropRate, intrinsicQ, lifetimeTerms, linearRate, loadedQ } from "./ring.mjs";

/** Fields with a slider: name, unit, range and step; values are in the unit. Those of the ring are null while untouched. */
export const FIELDS = {
  power: { label: "Power in the bus", unit: "dBm", low: -40, high: 27, step: 0.05 },
  detuning: { label: "Detuning, laser minus cold resonance", unit: "GHz", low: -2000, high: 2000, step: 0.1 },
  loadedQ: { label: "Loaded quality factor", unit: "", low: 500, high: 5e6, log: true },
  intrinsicQ: { label: "Intrinsic quality factor", unit: "", low: 1000, high: 5e7, log: true },
  lifetime: { label: "Carrier lifetime at low density", unit: "ns", low: 0.01, high: 1000, log: true },
  duration: { label: "Run from cold", unit: "µs", low: 0.5, high: 200, log: true },
};
export const RING_FIELDS = ["loadedQ", "intrinsicQ", "lifetime"];
export const VIEWS = ["cycle", "last", "cold"];

/** The value of a field of the ring as the ring itself has it, in the unit of the field. */
export function ownValue(name, ring) {
  if (name === "loadedQ") return loadedQ(ring);
  if (name === "intrinsicQ") return intrinsicQ(ring);
  return lifetimeTerms(ring.carriers).tau0 * 1e9;
}

export function valueOf(name, state, data) {
  const value = state[name];
  return value === null ? ownValue(name, data.rings[state.ring]) : value;
}

/** The ring with the fields that were moved, every number in SI; one that was not moved keeps its own digits. */
export function ringOf(state, data) {
  const base = data.rings[state.ring];
  let ring = { ...base };
  if (state.loadedQ !== null || state.intrinsicQ !== null) {
    const whole = (Math.PI * base.frequency) / valueOf("loadedQ", state, data);
    const own = (Math.PI * base.frequency) / valueOf("intrinsicQ", state, data);
    const outside = base.bus_rate + dropRate(base);
    const inside = base.loss_rate + base.scattering_rate;
    ring = {
      ...ring,
      bus_rate: ((whole - own) * base.bus_rate) / outside,
      drop_rate: base.drop_rate === null ? null : ((whole - own) * base.drop_rate) / outside,
      loss_rate: inside > 0 ? (own * base.loss_rate) / inside : own,
      scattering_rate: inside > 0 ? (own * base.scattering_rate) / inside : 0,
    };
  }
  if (state.lifetime !== null) {
    const factor = (state.lifetime * 1e-9) / lifetimeTerms(base.carriers).tau0;
    const c = base.carriers;
    ring.carriers = c.tau !== undefined ? { tau: state.lifetime * 1e-9 } : { ...c, tau_n: c.tau_n * factor, tau_p: c.tau_p * factor };
  }
  return ring;
}

/** The window of the plane in dBm and GHz, or `stretch` times as many detunings: in widths of the resonance, about where heaters move it. */
export function windowOf(state, data, stretch = 1) {
  const base = data.rings[state.ring];
  const ring = ringOf(state, data);
  const scale = (stretch * linearRate(ring)) / linearRate(base);
  const turned = turnedBy(ring, modelOf(state, data)) / 1e9;
  return { power: base.window.power, detuning: base.window.detuning.map((x) => scale * x - turned) };
}

/** Fields for the parameters of a family that the page moves: p0, p1, p2. */
export function addFamilyFields(family) {
  family.parameters.forEach((p, k) => {
    const scale = family.scale[k];
    if (p.moved) FIELDS[`p${k}`] = { label: p.name, unit: family.units[k], low: p.low * scale, high: p.high * scale };
  });
}

/** Fields for the powers of heaters, in mW: h0, h1, .. in the order of their names. */
export function addHeaterFields(heaters) {
  heaters.forEach(({ name }, k) => (FIELDS[`h${k}`] = { label: `Power in ${name}`, unit: "mW", low: 0, high: 10000 }));
}

/** The thermal model of a state, or another one, under the state's heaters. */
export function modelOf(state, data, index = state.model) {
  const powers = Object.fromEntries(data.heaters.map(({ name }, k) => [name, (state[`h${k}`] || 0) * 1e-3]));
  return heatedBy(bareModelOf(state, data, index), powers);
}

/** The same without heaters: one that was given, or the member of the family at its parameters. */
function bareModelOf(state, data, index) {
  const given = data.models[index];
  if (!given.family) return given;
  const { parameters, points, R, scale } = data.family;
  const moved = parameters.filter((p) => p.moved);
  const share = (value, p) => (p.log ? Math.log(value / p.low) / Math.log(p.high / p.low) : (value - p.low) / (p.high - p.low));
  const at = moved.map((p, k) => share(state[`p${k}`] / scale[k], p) * (points - 1));
  const base = at.map((x) => Math.min(Math.max(Math.floor(x), 0), points - 2));
  const out = new Array(data.family.tau.length).fill(0);
  for (let corner = 0; corner < 2 ** moved.length; corner++) {
    let [weight, index] = [1, 0];
    moved.forEach((_, k) => {
      const upper = (corner >> k) & 1;
      weight *= upper ? at[k] - base[k] : 1 - (at[k] - base[k]);
      index = index * points + base[k] + upper;
    });
    R[index].forEach((value, i) => (out[i] += weight * value));
  }
  const kept = out.map((_, i) => i).filter((i) => out[i] > 0);
  return { ...given, R: kept.map((i) => out[i]), tau: kept.map((i) => given.tau[i]) };
}

/** The curves of folds of cycles that Python computed for this ring and model; none once a field of the ring has moved. Heaters shift them. */
export function bordersOf(state, data) {
  if (RING_FIELDS.some((name) => state[name] !== null)) return [];
  const known = data.borders.find((entry) => entry.ring === state.ring && entry.model === state.model);
  const turned = turnedBy(ringOf(state, data), modelOf(state, data));
  return known ? known.curves.map((curve) => curve.map(([power, detuning]) => ({ power, detuning: detuning - turned }))) : [];
}

/** Power in W of a level in dBm. */
export function watts(dBm) {
  return 1e-3 * 10 ** (dBm / 10);
}

/** Why a value cannot be taken, in words, or "" where it can. */
export function objection(name, value, state, data) {
  const { unit, low, high } = FIELDS[name];
  if (!Number.isFinite(value)) return "This is not a number.";
  if (value < low || value > high) return `Give a value from ${low} to ${high} ${unit}.`.replace(" .", ".");
  const loaded = name === "loadedQ" ? value : valueOf("loadedQ", state, data);
  const own = name === "intrinsicQ" ? value : valueOf("intrinsicQ", state, data);
  if ((name === "loadedQ" || name === "intrinsicQ") && loaded >= 0.999 * own) return "The loaded quality factor must lie below the intrinsic one: coupling adds loss.";
  return "";
}

/** The text after # in a link: every field that matters, numbers with all their digits. */
export function hashOf(state) {
  const parts = [];
  for (const [name, value] of Object.entries(state)) if (value !== null) parts.push(`${name}=${encodeURIComponent(value)}`);
  return parts.join("&");
}

/** The state of a link over `fallback`, and in words what of it cannot be taken. Numbers hold together, whichever comes first. */
export function stateOf(hash, fallback, data) {
  const state = { ...fallback };
  const [values, refused] = [{}, []];
  const lists = { ring: data.rings, model: data.models };
  for (const [name, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
    const value = text.trim() === "" ? NaN : Number(text);
    if (FIELDS[name]) values[name] = value;
    else if (name === "view" && VIEWS.includes(text)) state.view = text;
    else if (name in lists && Number.isInteger(value) && value in lists[name]) state[name] = value;
    else refused.push(`${name} = ${text}: This page has no such setting.`);
    if (name === "ring") for (const field of RING_FIELDS) state[field] = null;
  }
  for (;;) {
    const whole = { ...state, ...values };
    const wrong = Object.keys(values).map((name) => [name, objection(name, values[name], whole, data)]).filter(([, problem]) => problem); // prettier-ignore
    if (!wrong.length) return { state: whole, refused };
    for (const [name, problem] of wrong) {
      refused.push(`${FIELDS[name].label} = ${values[name]}: ${problem}`);
      delete values[name];
    }
  }
}
