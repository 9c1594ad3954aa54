// The state of the page: what its fields hold and its figures show, the link that restores it, and the ring and the
// thermal model that follow from it.

import { NS, dropRate, heatedBy, intrinsicQ, linearRate, loadedQ, toPicometres, turnedBy } from "./ring.mjs";
import { sumOf } from "./thermal.mjs";

export const $ = (id) => document.getElementById(id);

/** data: what the file holds; state: what the fields hold; changed: asks for the answers to a new state. */
export const page = { data: null, state: null, changed: () => {} };

/**
 * Everything the figures show; answers fill it as they come. moving: whether the exact answer to the state is still to come.
 * kept: a setting to compare with. zoom: by figure, what is zoomed in to. panels: by figure, its axes.
 */
export const shown = { moving: false, trace: null, states: [], ring: null, map: null, curves: { folds: [], hopf: [] }, points: [], plane: null, phase: 0, section: null, kept: null, zoom: {}, panels: {} };

const widths = new Map();

/** The width that a figure has, in pixels; read once, because a figure just put has to be laid out for it. */
export function widthOf(id) {
  if (!widths.has(id)) widths.set(id, Math.max(280, Math.min(760, $(id).clientWidth || 400)));
  return widths.get(id);
}

/** Read the widths anew. */
export const resized = () => widths.clear();

const standing = new Map();

/** Show a figure { svg, panels }, unless it is there already. */
export function put(id, { svg, panels }) {
  shown.panels[id] = panels;
  if (standing.get(id) === svg) return;
  standing.set(id, svg);
  $(id).innerHTML = svg;
}

const inWindow = new Set();

/** Whether a figure lies within the window. */
export const inSight = (id) => inWindow.has(id);

/** Watch which figures lie within the window; `draw` is called when one comes or goes. */
export function watchSight(draw) {
  const sight = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) inWindow[isIntersecting ? "add" : "delete"](target.id);
    draw();
  });
  for (const plot of document.querySelectorAll(".plot")) sight.observe(plot);
}

/**
 * Fields with a slider, by group: unit, range and step; values are in the unit. Those of the ring, and the thermal
 * resistance, are null while untouched. `other` is a second unit that the page may show.
 */
export const FIELDS = {
  power: { group: "laser", label: "Power in the bus", unit: "dBm", low: -40, high: 27, step: 0.05, other: "mW" },
  detuning: { group: "laser", label: "Detuning", unit: "GHz", low: -2000, high: 2000, step: 0.1, other: "pm" },
  loadedQ: { group: "ring", label: "Loaded Q", unit: "", low: 500, high: 5e6, log: true },
  intrinsicQ: { group: "ring", label: "Intrinsic Q", unit: "", low: 1000, high: 5e7, log: true },
  absorbed: { group: "ring", label: "Absorbed share", unit: "", low: 0, high: 1 },
  lifetime: { group: "ring", label: "Carrier lifetime", unit: "ns", low: 0.01, high: 1000, log: true },
  volume: { group: "ring", label: "Mode volume", unit: "µm³", low: 0.01, high: 1e5, log: true },
  thermoOptic: { group: "ring", label: "dn/dT", unit: "10⁻⁴/K", low: -100, high: 100 },
  resistance: { group: "heat", label: "R_th", unit: "K/mW", low: 0.001, high: 1000, log: true },
  duration: { group: "time", label: "Run from cold", unit: "µs", low: 0.5, high: 200, log: true },
};
export const RING_FIELDS = Object.keys(FIELDS).filter((name) => FIELDS[name].group === "ring");
export const UNTOUCHED = Object.fromEntries([...RING_FIELDS, "resistance"].map((name) => [name, null]));
const CHOICES = { view: ["cycle", "last", "cold"], units: ["GHz", "pm"] };

/** The value of a field as the ring or the model itself has it, in the unit of the field. */
function ownValue(name, state, data) {
  const ring = data.rings[state.ring];
  if (name === "loadedQ") return loadedQ(ring);
  if (name === "intrinsicQ") return intrinsicQ(ring);
  if (name === "absorbed") return ring.loss_rate / (ring.loss_rate + ring.scattering_rate || 1);
  if (name === "lifetime") return ring.internal.tau0;
  if (name === "volume") return ring.tpa_volume * 1e18;
  if (name === "thermoOptic") return ring.thermo_optic * 1e4;
  return sumOf(bareModelOf(state, data, state.model).R) * 1e-3;
}

export const valueOf = (name, state, data) => state[name] === null ? ownValue(name, state, data) : state[name];

/** The unit that a field is shown in, and a value in it; and back. */
export const shownUnit = (name, state) => (state.units === "pm" && FIELDS[name].other) || FIELDS[name].unit;

export function toShown(name, value, state, data) {
  const other = state.units === "pm" && FIELDS[name].other;
  if (other === "mW") return 1e3 * watts(value);
  return other === "pm" ? -toPicometres(value, data.rings[state.ring]) : value;
}

export function fromShown(name, value, state, data) {
  const other = state.units === "pm" && FIELDS[name].other;
  if (other === "mW") return value > 0 ? 10 * Math.log10(value) : NaN;
  return other === "pm" ? -value / toPicometres(1, data.rings[state.ring]) : value;
}

/** How many times its own value a field has. */
const ratioOf = (name, state, data) => valueOf(name, state, data) / ownValue(name, state, data);

/** What was moved of a ring, in SI: fields, numbers of the carriers' law, and derived rates that were set by hand. */
export function changesOf(state, data) {
  const base = data.rings[state.ring];
  const [fields, carriers, rates] = [{}, {}, {}];
  const ratio = (name) => ratioOf(name, state, data);
  if (["loadedQ", "intrinsicQ", "absorbed"].some((name) => state[name] !== null)) {
    const [whole, own] = ["loadedQ", "intrinsicQ"].map((name) => (Math.PI * base.frequency) / valueOf(name, state, data));
    const outside = base.bus_rate + dropRate(base);
    const absorbed = base.loss_rate + base.scattering_rate > 0 || state.absorbed !== null ? valueOf("absorbed", state, data) : 1;
    fields.bus_rate = ((whole - own) * base.bus_rate) / outside;
    if (base.drop_rate !== null) fields.drop_rate = ((whole - own) * base.drop_rate) / outside;
    Object.assign(fields, { loss_rate: own * absorbed, scattering_rate: own * (1 - absorbed) });
  }
  if (state.volume !== null) for (const name of ["tpa_volume", "fca_volume"]) fields[name] = base[name] * ratio("volume");
  if (state.thermoOptic !== null) fields.thermo_optic = state.thermoOptic * 1e-4;
  for (const [name, value] of base.rates) {
    const power = { eta_tpa: 1, kerr_shift: 1, g_tpa: 2 }[name];
    if (power && state.volume !== null) rates[name] = value / ratio("volume") ** power;
    if (name === "thermal_shift" && base.thermo_optic && state.thermoOptic !== null) rates[name] = value * ratio("thermoOptic");
  }
  if (state.lifetime !== null) for (const name of Object.keys(base.carriers)) if (name.startsWith("tau")) carriers[name] = base.carriers[name] * ratio("lifetime");
  return { fields, carriers, rates };
}

/** The ring with what was moved: its fields in SI, and `internal`, what follows from them and the numbers of the carriers' law. */
export function ringOf(state, data) {
  const base = data.rings[state.ring];
  const [own, { fields }] = [base.internal, changesOf(state, data)];
  const [volume, lifetime, optic] = ["volume", "lifetime", "thermoOptic"].map((name) => (state[name] === null ? 1 : ratioOf(name, state, data)));
  const internal = { ...own, tpa: own.tpa / volume, kerr: own.kerr / volume, g: own.g / volume ** 2, tau0: own.tau0 * lifetime };
  if (base.thermo_optic) internal.thermal_shift *= optic;
  else if (!base.rates.some(([name]) => name === "thermal_shift")) internal.thermal_shift = base.index_rate * (fields.thermo_optic || 0) * NS;
  return { ...base, ...fields, internal };
}

/** The window of the plane in dBm and GHz, or `stretch` times as many detunings: in widths of the resonance, about where heaters move it. */
export function windowOf(state, data, stretch = 1) {
  const base = data.rings[state.ring];
  const ring = ringOf(state, data);
  const scale = (stretch * linearRate(ring)) / linearRate(base);
  const turned = turnedBy(ring, modelOf(state, data)) / 1e9;
  return { power: base.window.power, detuning: base.window.detuning.map((x) => scale * x - turned) };
}

/** The window of the plane: all of it, or what is zoomed in to. */
export const planeWindow = (state, data) => shown.zoom.plane || windowOf(state, data);

/** Fields for the parameters of a family that the page moves, p0, p1, p2, and for the powers of heaters, h0, h1, .. */
export function addFields({ family, heaters }) {
  const moved = family ? family.parameters.filter((p) => p.moved) : [];
  moved.forEach((p, k) => (FIELDS[`p${k}`] = { group: "geometry", label: p.name, unit: p.unit, low: p.low * p.scale, high: p.high * p.scale }));
  heaters.forEach(({ name }, k) => (FIELDS[`h${k}`] = { group: "heaters", label: `Power in ${name}`, unit: "mW", low: 0, high: 10000 }));
}

/** A thermal model of the page under the heaters of the state; the one of the family follows its parameters. */
export function modelOf(state, data, index = state.model) {
  const powers = Object.fromEntries(data.heaters.map(({ name }, k) => [name, state[`h${k}`] * 1e-3]));
  const own = bareModelOf(state, data, index);
  if (index !== state.model || state.resistance === null) return heatedBy(own, powers);
  const factor = (state.resistance * 1e3) / sumOf(own.R);
  return heatedBy({ ...own, factor, R: own.R.map((R) => R * factor) }, powers);
}

/** The same without heaters: one that was given, or the member of the family at its parameters. */
function bareModelOf(state, data, index) {
  const given = data.models[index];
  if (!given.family) return given;
  const { parameters, points, R } = data.family;
  const moved = parameters.filter((p) => p.moved);
  const share = (value, p) => (p.log ? Math.log(value / p.low) / Math.log(p.high / p.low) : (value - p.low) / (p.high - p.low));
  const at = moved.map((p, k) => share(state[`p${k}`] / p.scale, p) * (points - 1));
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

/** The curves of folds of cycles that Python computed for the ring and model of the start; none for others, or once a number of the ring or R_th has moved. Heaters shift them. */
export function bordersOf(state, data) {
  if (state.ring !== data.start.ring || state.model !== data.start.model || Object.keys(UNTOUCHED).some((name) => state[name] !== null)) return [];
  const turned = turnedBy(ringOf(state, data), modelOf(state, data));
  return data.borders.map((curve) => curve.map(([power, detuning]) => ({ power, detuning: detuning - turned })));
}

/** Power in W of a level in dBm. */
export const watts = (dBm) => 1e-3 * 10 ** (dBm / 10);

/** Why a value cannot be taken, in words, or "" where it can. */
export function objection(name, value, state, data) {
  const { low, high } = FIELDS[name];
  if (!Number.isFinite(value)) return "This is not a number.";
  const ends = [low, high].map((end) => Number(toShown(name, end, state, data).toPrecision(6))).sort((a, b) => a - b);
  if (value < low || value > high) return `Give a value from ${ends[0]} to ${ends[1]} ${shownUnit(name, state)}.`.replace(" .", ".");
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
    else if (name in CHOICES && CHOICES[name].includes(text)) state[name] = text;
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
