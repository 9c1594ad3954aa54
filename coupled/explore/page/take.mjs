// What is taken along: the view as a Python script, links, traces, figures; and a kept setting. Rings come as Python from
// Python; what was moved is put in.

import { draw, lightNow, stretch } from "./paint.mjs";
import { DENSITY, FJ, NS, UW, absorbedPower, systemOf, throughPower } from "./ring.mjs";
import { changesOf, hashOf, modelOf, page, ringOf, shown, watts } from "./state.mjs";

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
    'print(f"{found.regime}: period {found.period * 1e9:.4f} ns, duty {found.duty:.4g}, swing {found.swing:.4f} K")',
    ...(state.view === "cycle" ? settled : []),
  ];
  return `${lines.join("\n")}\n`;
}

/** Buttons of the group "Take along", those that save figures, and the one that keeps a setting. */
export function watchButtons() {
  $("python").addEventListener("click", () => copy(pythonOf(page.state, page.data), "Python script"));
  $("link").addEventListener("click", () => copy(`${address()}#${hashOf(page.state)}`, "Link"));
  $("keep").addEventListener("click", keep);
  for (const { id } of document.querySelectorAll(".plot")) {
    const kinds = id === "traces" ? ["svg", "csv"] : ["svg"];
    const button = (kind) => `<button type="button" data-save="${id} ${kind}" aria-label="Save ${id} as ${kind.toUpperCase()}">${kind.toUpperCase()}</button>`;
    $(id).closest("figure").insertAdjacentHTML("beforeend", `<div class="save">${kinds.map(button).join("")}</div>`);
  }
  for (const button of document.querySelectorAll("button[data-save]")) {
    const [id, kind] = button.dataset.save.split(" ");
    button.addEventListener("click", () => (kind === "csv" ? download(traceTable(), "trace.csv", "text/csv") : download(svgOf(id), `${id}.svg`, "image/svg+xml")));
  }
}

/** Keep what is shown, to compare it with other settings, or forget it. */
function keep() {
  const { state, data } = page;
  const kept = shown.kept ? null : { now: stretch(), points: shown.points, light: lightNow(), model: modelOf(state, data), state };
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
  const { t, U, re, im, N, dT } = stretch();
  const ring = ringOf(page.state, page.data);
  const system = systemOf(ring, modelOf(page.state, page.data));
  const { drop, bus, power } = lightNow();
  const ports = (i) => [2 * drop * U[i] * UW, throughPower(re[i], im[i], power, bus)];
  const row = (time, i) => [time * NS, U[i] * FJ, N[i] * DENSITY, dT[i], ...ports(i), absorbedPower(U[i], N[i], system) * UW].join(",");
  return `${["time_s,energy_J,carriers_per_m3,delta_T_K,drop_W,through_W,absorbed_W", ...Array.from(t, row)].join("\n")}\n`;
}

const svgOf = (id) => new XMLSerializer().serializeToString($(id).querySelector("svg"));

function download(content, name, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
