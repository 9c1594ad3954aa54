// What is taken along: the view as a Python script and a command line, links, traces, figures; and a kept setting.
// Rings come as Python and TOML from Python; what was moved is put in.

import { draw, dropNow, stretch } from "./paint.mjs";
import { DENSITY, FJ, NS, UW, absorbedPower, dropRate, systemOf } from "./ring.mjs";
import { changesOf, hashOf, modelOf, page, ringOf, shown, watts } from "./state.mjs";

const UNITS = { thermo_optic: "1/K", tpa_volume: "m^3", fca_volume: "m^3", tau: "s", tau_n: "s", tau_p: "s", lifetime: "s", eta_tpa: "1/s/J", g_tpa: "1/m^3/s/J^2", thermal_shift: "rad/s/K", kerr_shift: "rad/s/J" };

/** A number as Python reads it back, bit for bit. */
function number(x) {
  const text = String(x);
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/** A string as Python reads it back; what JSON writes is understood, but for pairs of surrogates. */
function quoted(text) {
  return JSON.stringify(text).replace(/[\u007f-\u{10ffff}]/gu, (c) => `\\U${c.codePointAt(0).toString(16).padStart(8, "0")}`);
}

/** The ring in Python. */
function ringLines(state, data) {
  const { fields, carriers, rates } = changesOf(state, data);
  const given = (values) => Object.entries(values).map(([name, value]) => `${name}=${number(value)}`);
  const moved = given(fields);
  if (Object.keys(carriers).length) moved.push(`carriers=replace(ring.carriers, ${given(carriers).join(", ")})`);
  const lines = ["from dataclasses import replace", "from coupled import ConstantLifetime, RingResonator, ShockleyReadHall", "", `ring = ${data.rings[state.ring].python}`];
  if (moved.length) lines.push(`ring = replace(ring, ${moved.join(", ")})`);
  if (Object.keys(rates).length) lines.push(`ring = ring.with_rates(${given(rates).join(", ")})`);
  return lines;
}

/** The ring as a TOML file. */
function tomlOf(state, data) {
  const { fields, carriers, rates } = changesOf(state, data);
  const moved = { ...fields, ...carriers, ...rates };
  if ("tau" in moved) moved.lifetime = moved.tau;
  return data.rings[state.ring].toml.replace(/^(\w+) = .*$/gm, (line, name) => (name in moved ? `${name} = "${moved[name]} ${UNITS[name] || "1/s"}"` : line));
}

/** The part that the light heats and the heaters that are on, and their residues in K/W, a column for each. */
function inputsOf(model) {
  const on = Object.keys(model.on);
  const columns = [model.R, ...on.map((name) => model.heaters[name])];
  return { inputs: [model.heated, ...on], B: model.tau.map((_, i) => columns.map((R) => R[i])) };
}

/** The thermal model: poles, and under heaters a system with an input for each of them, tau dx/dt = -x + B P. */
function modelLines(model) {
  const list = (values) => `[${values.map(number).join(", ")}]`;
  if (!model.on) {
    const lines = [`model = th.Foster(R=${list(model.R)}, tau=${list(model.tau)})`];
    return model.coefficient ? [...lines, `model = th.OutputMap(model, ${number(model.coefficient)})`] : lines;
  }
  const { inputs, B } = inputsOf(model);
  return [
    "model = th.StateSpace(",
    `    E=np.diag(${list(model.tau)}), A=-np.eye(${B.length}), B=np.array([${B.map(list).join(", ")}]), C=np.ones((1, ${B.length})),`,
    `    inputs=(${inputs.map(quoted).join(", ")}), outputs=(${quoted(model.read)},),`,
    ")",
  ];
}

/** A Python script that runs the present view. */
export function pythonOf(state, data) {
  const model = modelOf(state, data);
  const powers = Object.entries(model.on || {}).map(([name, power]) => `${quoted(name)}: ${number(power)}`);
  const heaters = model.on ? `, "heaters": {${powers.join(", ")}}, "heated": ${quoted(model.heated)}, "read": ${quoted(model.read)}` : "";
  const settled = ['if found.regime == "self-pulsing":', "    cycle = coupled.limit_cycle(ring, model, **light)", "    print(f\"settled: period {cycle.attrs['period'] * 1e9:.4f} ns\")"]; // prettier-ignore
  const lines = [
    "import coupled",
    "import numpy as np",
    "import thermofem as th",
    ...ringLines(state, data),
    ...modelLines(model),
    "",
    `light = {"power": ${number(watts(state.power))}, "detuning": ${number(state.detuning * 1e9)}${heaters}}`,
    `run = coupled.simulate(ring, model, **light, duration=${number(state.duration * 1e-6)}, rtol=1e-6)`,
    "found = coupled.pulsing(run)",
    'print(f"{found.regime}: period {found.period * 1e9:.4f} ns, duty {found.duty:.4f}, swing {found.swing:.4f} K")',
    ...(state.view === "cycle" ? settled : []),
  ];
  return `${lines.join("\n")}\n`;
}

/** The model as its JSON file. */
function modelFileOf(model) {
  const head = { format: "thermofem thermal model", schema: 1, provenance: {} };
  const diagonal = (values) => values.map((x, i) => values.map((_, j) => (i === j ? x : 0)));
  if (model.on) {
    const matrices = { E: diagonal(model.tau), A: diagonal(model.tau.map(() => -1)), C: [model.tau.map(() => 1)], ...inputsOf(model) };
    return JSON.stringify({ ...head, kind: "StateSpace", outputs: [model.read], ...matrices, units: { E: "J/K", A: "W/K", B: "1", C: "1" } });
  }
  const poles = { thermal_resistance: model.R.reduce((sum, R) => sum + R, 0), poles: model.R.map((R, i) => ({ R, tau: model.tau[i] })) };
  const units = { thermal_resistance: "K/W", R: "K/W", tau: "s" };
  const foster = { ...head, kind: "Foster", inputs: ["core"], outputs: ["core"], ...poles, units };
  const { coefficient } = model;
  return JSON.stringify(coefficient ? { ...foster, kind: "OutputMap", coefficient, units: { ...units, coefficient: "1/K" } } : foster);
}

/** Lines for a shell: the ring and the model as files, and the command that runs them. */
export function commandOf(state, data) {
  const file = (name, text) => `cat > ${name} <<'END_OF_FILE'\n${text.trimEnd()}\nEND_OF_FILE\n`;
  const model = modelOf(state, data);
  const heaters = Object.entries(model.on || {}).map(([name, power]) => ` --heater "${name}=${power} W"`);
  const parts = heaters.length ? `${heaters.join("")} --heated "${model.heated}" --read "${model.read}"` : "";
  const command = `thermofem simulate model.json --ring ring.toml --power "${watts(state.power)} W" --detuning "${state.detuning * 1e9} Hz"${parts} --duration "${state.duration * 1e-6} s" --rtol 1e-6 -o traces.nc`;
  return `${file("ring.toml", tomlOf(state, data))}${file("model.json", modelFileOf(model))}${command}\n`;
}

/** Buttons of the group "Take along", those that save figures, and the one that keeps a setting. */
export function watchButtons() {
  $("python").addEventListener("click", () => copy(pythonOf(page.state, page.data), "Python script"));
  $("command").addEventListener("click", () => copy(commandOf(page.state, page.data), "Command line"));
  $("link").addEventListener("click", () => copy(`${address()}#${hashOf(page.state)}`, "Link"));
  $("keep").addEventListener("click", keep);
  for (const { id } of document.querySelectorAll(".plot")) {
    const kinds = id === "traces" ? ["svg", "png", "csv"] : ["svg", "png"];
    const button = (kind) => `<button type="button" data-save="${id} ${kind}" aria-label="Save ${id} as ${kind.toUpperCase()}">${kind.toUpperCase()}</button>`;
    $(id).closest("figure").insertAdjacentHTML("beforeend", `<div class="save">${kinds.map(button).join("")}</div>`);
  }
  for (const button of document.querySelectorAll("button[data-save]")) {
    const [id, kind] = button.dataset.save.split(" ");
    button.addEventListener("click", () => (kind === "csv" ? download(traceTable(), "trace.csv", "text/csv") : saveFigure($(id).querySelector("svg"), `${id}.${kind}`, kind)));
  }
}

/** Keep what is shown, to compare it with other settings, or forget it. */
function keep() {
  const { state, data } = page;
  const kept = shown.kept ? null : { now: stretch(), points: shown.points, drop: dropNow(), model: modelOf(state, data), state };
  shown.kept = kept && kept.now ? kept : null;
  $("keep").textContent = shown.kept ? "Forget the kept setting" : "Keep to compare";
  $("kept").textContent = shown.kept ? `Kept (grey, dashed): ${$("numbers").textContent} ${$("summary").textContent}` : "";
  draw();
}

/** Where the page lies; inside a report or a notebook it has no address of its own. */
function address() {
  return ["file:", "http:", "https:"].includes(location.protocol) ? location.href.split("#")[0] : "ring.html";
}

async function copy(text, what) {
  $("copied-text").value = text;
  $("copied").hidden = false;
  try {
    await navigator.clipboard.writeText(text);
    $("copied-note").textContent = `${what} copied. It stands below as well.`;
  } catch {
    $("copied-note").textContent = `${what}: select and copy it below.`;
    $("copied-text").focus();
    $("copied-text").select();
  }
}

/** The trace that is shown, SI, with the fields of coupled.simulate. */
function traceTable() {
  const { t, U, N, dT } = stretch();
  const ring = ringOf(page.state, page.data);
  const system = systemOf(ring, modelOf(page.state, page.data));
  const row = (time, i) => [time * NS, U[i] * FJ, N[i] * DENSITY, dT[i], 2 * dropRate(ring) * NS * U[i] * UW, absorbedPower(U[i], N[i], system) * UW].join(",");
  return `${["time_s,energy_J,carriers_per_m3,delta_T_K,drop_W,absorbed_W", ...Array.from(t, row)].join("\n")}\n`;
}

function download(content, name, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** An SVG as it stands, or as a PNG of twice its size. */
function saveFigure(svg, name, kind) {
  const text = new XMLSerializer().serializeToString(svg);
  if (kind === "svg") {
    download(text, name, "image/svg+xml");
    return;
  }
  const image = new Image();
  image.onload = () => {
    const canvas = Object.assign(document.createElement("canvas"), { width: 2 * image.width, height: 2 * image.height });
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.toBlob((blob) => download(blob, name, "image/png"), "image/png");
  };
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
}
