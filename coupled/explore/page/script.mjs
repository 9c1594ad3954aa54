// The present view as a Python script and as a command line; numbers with all their digits.

import { modelOf, ringOf, watts } from "./state.mjs";

/** A number as Python reads it back, bit for bit. */
function number(x) {
  if (x === null || x === undefined) return "None";
  if (x === Infinity) return 'float("inf")';
  const text = String(x);
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/** A string as Python and TOML read it back; what JSON writes is understood by both, but for pairs of surrogates. */
function quoted(text) {
  return JSON.stringify(text).replace(/[\u007f-\u{10ffff}]/gu, (c) => `\\U${c.codePointAt(0).toString(16).padStart(8, "0")}`);
}

const RING_NUMBERS = ["frequency", "bus_rate", "loss_rate", "refractive_index", "group_index", "thermo_optic", "fca_cross_section", "tpa_coefficient", "tpa_confinement", "tpa_volume", "fca_confinement", "fca_volume", "scattering_rate", "kerr_coefficient"];
const UNITS = { frequency: "Hz", bus_rate: "1/s", loss_rate: "1/s", drop_rate: "1/s", scattering_rate: "1/s", thermo_optic: "1/K", fca_cross_section: "m^2", tpa_coefficient: "m/W", tpa_volume: "m^3", fca_volume: "m^3", kerr_coefficient: "m^2/W", lumped_fcd: "m^3" };
const CARRIERS = { tau_n: "s", tau_p: "s", intrinsic_density: "1/m^3", hole_density: "1/m^3", trap_energy: "eV" };
const RATES = { eta_fca: "m^3/s", eta_tpa: "1/s/J", g_tpa: "1/m^3/s/J^2", thermal_shift: "rad/s/K", kerr_shift: "rad/s/J" };
const BOLTZMANN = 1.380649e-23;
const CHARGE = 1.602176634e-19;

/** The thermal model: poles, and under heaters a system with an input for each of them. */
function modelLines(model) {
  if (model.on) {
    const { B, C } = matricesOf(model);
    return [
      "model = th.StateSpace(",
      `    E=np.diag([${model.tau.map(number).join(", ")}]),`,
      `    A=-np.eye(${model.tau.length}),`,
      `    B=np.array([${B.map((row) => `[${row.map(number).join(", ")}]`).join(", ")}]),`,
      `    C=np.ones((1, ${C[0].length})),`,
      `    inputs=(${inputsOf(model).map((name) => `${quoted(name)},`).join(" ")}),`,
      `    outputs=(${quoted(model.read)},),`,
      ")",
    ];
  }
  const lines = ["model = th.Foster(", `    R=[${model.R.map(number).join(", ")}],`, `    tau=[${model.tau.map(number).join(", ")}],`, ")"];
  return model.coefficient ? [...lines, `model = th.OutputMap(model, ${number(model.coefficient)})`] : lines;
}

/** The part that the light heats, and the heaters that are on. */
function inputsOf(model) {
  return [model.heated, ...Object.keys(model.on)];
}

/** tau dx/dt = -x + B P, dT = C x. */
function matricesOf(model) {
  const columns = [model.R, ...Object.keys(model.on).map((name) => model.heaters[name])];
  const diagonal = (values) => values.map((x, i) => values.map((_, j) => (i === j ? x : 0)));
  const n = model.tau.length;
  return { E: diagonal(model.tau), A: diagonal(new Array(n).fill(-1)), B: model.tau.map((_, i) => columns.map((R) => R[i])), C: [new Array(n).fill(1)] };
}

function heaterArguments(model) {
  if (!model.on) return "";
  const powers = Object.entries(model.on).map(([name, power]) => `${quoted(name)}: ${number(power)}`);
  return `, "heaters": {${powers.join(", ")}}, "heated": ${quoted(model.heated)}, "read": ${quoted(model.read)}`;
}

/** A Python script that runs the present view. */
export function pythonOf(state, data) {
  const ring = ringOf(state, data);
  const model = modelOf(state, data);
  const c = ring.carriers;
  const pair = (x) => `(${x.map(number).join(", ")})`;
  const carriers = c.tau !== undefined ? `coupled.ConstantLifetime(${number(c.tau)})` : `coupled.ShockleyReadHall(\n        ${Object.entries(c).map(([k, v]) => `${k}=${number(v)}`).join(", ")},\n    )`;
  const lines = [
    ...(model.on ? ["import numpy as np", ""] : []),
    "import coupled",
    "import thermofem as th",
    "",
    "ring = coupled.RingResonator(",
    `    name=${quoted(ring.name)},`,
    ...RING_NUMBERS.map((name) => `    ${name}=${number(ring[name])},`),
    `    drop_rate=${number(ring.drop_rate)},`,
    `    lumped_fcd=${number(ring.lumped_fcd)},`,
    `    fcd=(${ring.fcd.map((term) => `${pair(term)},`).join(" ")}),`,
    `    carriers=${carriers},`,
    `    rates=(${ring.rates.map(([name, value]) => `(${quoted(name)}, ${number(value)}),`).join(" ")}),`,
    ")",
    ...modelLines(model),
  ];
  lines.push(
    "",
    `light = {"power": ${number(watts(state.power))}, "detuning": ${number(state.detuning * 1e9)}${heaterArguments(model)}}`,
    `run = coupled.simulate(ring, model, **light, duration=${number(state.duration * 1e-6)}, rtol=1e-6)`,
    "found = coupled.pulsing(run)",
    'print(f"{found.regime}: period {found.period * 1e9:.4f} ns, duty {found.duty:.4f}, swing {found.swing:.4f} K")',
  );
  if (state.view === "cycle") {
    lines.push(
      'if found.regime == "self-pulsing":',
      "    cycle = coupled.limit_cycle(ring, model, **light)",
      "    print(f\"settled: period {cycle.attrs['period'] * 1e9:.4f} ns\")",
    );
  }
  return `${lines.join("\n")}\n`;
}

/** The ring as a TOML file. */
export function tomlOf(ring) {
  const quantity = (name, value) => (UNITS[name] ? `"${value} ${UNITS[name]}"` : number(value));
  const lines = [`name = ${quoted(ring.name)}`, ...RING_NUMBERS.map((name) => `${name} = ${quantity(name, ring[name])}`)];
  for (const name of ["drop_rate", "lumped_fcd"]) if (ring[name] !== null && ring[name] !== undefined) lines.push(`${name} = ${quantity(name, ring[name])}`);
  for (const [coefficient, exponent] of ring.fcd) lines.push("", "[[dispersion]]", `coefficient = ${number(coefficient)}`, `exponent = ${number(exponent)}`);
  const c = ring.carriers;
  lines.push("", "[carriers]");
  if (c.tau !== undefined) lines.push(`lifetime = "${c.tau} s"`);
  else {
    for (const [name, unit] of Object.entries(CARRIERS)) lines.push(`${name} = "${c[name]} ${unit}"`);
    lines.push(`temperature = "${(c.thermal_energy * CHARGE) / BOLTZMANN} K"`);
  }
  if (ring.rates.length) lines.push("", "[rates]", ...ring.rates.map(([name, value]) => `${name} = "${value} ${RATES[name]}"`));
  return `${lines.join("\n")}\n`;
}

/** The model as its JSON file. */
export function modelFileOf(model) {
  const total = model.R.reduce((sum, R) => sum + R, 0);
  const poles = { thermal_resistance: total, poles: model.R.map((R, i) => ({ R, tau: model.tau[i] })) };
  const units = { thermal_resistance: "K/W", R: "K/W", tau: "s" };
  const head = { format: "thermofem thermal model", schema: 1 };
  if (model.on) {
    const parts = { inputs: inputsOf(model), outputs: [model.read] };
    return `${JSON.stringify({ ...head, kind: "StateSpace", ...parts, ...matricesOf(model), units: { E: "J/K", A: "W/K", B: "1", C: "1" }, provenance: {} }, null, 1)}\n`;
  }
  const ends = { inputs: ["core"], outputs: ["core"] };
  const content = model.coefficient
    ? { ...head, kind: "OutputMap", ...ends, ...poles, coefficient: model.coefficient, units: { ...units, coefficient: "1/K" }, provenance: {} }
    : { ...head, kind: "Foster", ...ends, ...poles, units, provenance: {} };
  return `${JSON.stringify(content, null, 1)}\n`;
}

/** Lines for a shell: the ring and the model as files, and the command that runs them. */
export function commandOf(state, data) {
  const file = (name, text) => `cat > ${name} <<'END_OF_FILE'\n${text}END_OF_FILE\n`;
  const model = modelOf(state, data);
  const heaters = Object.entries(model.on || {}).map(([name, power]) => ` --heater "${name}=${power} W"`);
  const parts = heaters.length ? `${heaters.join("")} --heated "${model.heated}" --read "${model.read}"` : "";
  const command = `thermofem simulate model.json --ring ring.toml --power "${watts(state.power)} W" --detuning "${state.detuning * 1e9} Hz"${parts} --duration "${state.duration * 1e-6} s" --rtol 1e-6 -o traces.nc`;
  return file("ring.toml", tomlOf(ringOf(state, data))) + file("model.json", modelFileOf(model)) + `${command}\n`;
}
