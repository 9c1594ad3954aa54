// Fields and sliders: from the state to what is shown, and from what is typed or dragged to the state.

import { FIELDS, RING_FIELDS, objection, valueOf, windowOf } from "./state.mjs";
import { $, page } from "./view.mjs";

const UNTOUCHED = Object.fromEntries(RING_FIELDS.map((name) => [name, null]));

/** Fill the selects and make the fields; names come as text, never as markup. */
export function build() {
  const options = (id, names) => {
    for (const [value, name] of names.entries()) $(id).add(new Option(name, String(value)));
  };
  options("ring", page.data.rings.map((ring) => ring.name));
  options("model", page.data.models.map((model) => model.name));
  options("preset", ["Choose a preset…", ...page.data.presets.map((preset) => preset.name)]);
  for (const name of Object.keys(FIELDS)) field(name);
  $("ring").addEventListener("change", () => set({ ring: Number($("ring").value), ...UNTOUCHED }, { ring: true }));
  $("model").addEventListener("change", () => set({ model: Number($("model").value) }, { ring: true }));
  $("preset").addEventListener("change", () => {
    const preset = page.data.presets[Number($("preset").value) - 1];
    if (!preset) return;
    set({ ...page.data.start, ...preset.state }, { ring: true });
    $("about").textContent = preset.text || "";
  });
  for (const input of document.querySelectorAll("input[name=view]")) input.addEventListener("change", () => set({ view: input.value }, {}));
  $("reset").addEventListener("click", () => set(UNTOUCHED, { ring: true }));
}

/** One field: number and slider, which move together; a value out of range is marked and not taken. */
function field(name) {
  const { log, step, unit } = FIELDS[name];
  const [number, slider] = [$(name), $(`${name}-slider`)];
  slider.min = 0;
  slider.step = 1;
  number.addEventListener("input", () => take(name, number.value.trim() === "" ? NaN : Number(number.value), false));
  number.addEventListener("change", () => number.getAttribute("aria-invalid") !== "true" && fill());
  slider.addEventListener("input", () => {
    const [low, high] = span(name);
    const share = Number(slider.value) / ticksOf(name);
    let value = log ? low * (high / low) ** share : low + share * (high - low);
    value = step ? Math.round(value / step) * step : value;
    take(name, Number(value.toPrecision(log ? 4 : 6)), true);
  });
  slider.setAttribute("aria-label", `${FIELDS[name].label}, slider${unit ? `, ${unit}` : ""}`);
}

/** What a slider spans: less than what its field takes. */
function span(name) {
  const window = windowOf(page.state, page.data, 2.5);
  if (name === "power") return [window.power[0] - 7, window.power[1] + 5];
  if (name === "detuning") return window.detuning;
  if (name === "duration") return [1, 100];
  if (/^p\d$/.test(name)) return [FIELDS[name].low, FIELDS[name].high];
  if (/^h\d$/.test(name)) return [0, page.data.heaters[Number(name[1])].span];
  const own = valueOf(name, { ...page.state, [name]: null }, page.data);
  if (name === "lifetime") return [own / 30, own * 10];
  return [own / 5, own * 5];
}

/** Places of a slider: one for every step, so that an arrow key moves it by one. */
function ticksOf(name) {
  const [low, high] = span(name);
  return FIELDS[name].step ? Math.round((high - low) / FIELDS[name].step) : 1000;
}

/** Why a value of a field cannot be taken; the field then says so. */
function refused(name, value) {
  const problem = objection(name, value, page.state, page.data);
  $(name).setAttribute("aria-invalid", problem ? "true" : "false");
  $(`${name}-problem`).textContent = problem;
  return problem !== "";
}

/** Take a value into the state, unless it is out of range. */
function take(name, value, fromSlider) {
  if (!refused(name, value)) takeAll({ [name]: value }, fromSlider ? null : name);
}

/** Take several values at once; one that is out of range is left out. */
export function takeAll(values, typing = null) {
  const taken = Object.entries(values).filter(([name, value]) => !refused(name, value));
  page.state = { ...page.state, ...Object.fromEntries(taken) };
  if (taken.some(([name]) => /^p\d$/.test(name))) page.state.model = page.data.models.findIndex((model) => model.family);
  fill(typing);
  page.changed({ ring: taken.some(([name]) => !["power", "detuning", "duration"].includes(name)) });
}

/** Write the state into the fields, but not into the one that is being typed in. */
export function fill(typing = null) {
  $("link-problem").textContent = "";
  for (const name of Object.keys(FIELDS)) {
    const value = valueOf(name, page.state, page.data);
    const [low, high] = span(name);
    const share = FIELDS[name].log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    $(`${name}-slider`).max = ticksOf(name);
    $(`${name}-slider`).value = String(Math.round(ticksOf(name) * Math.min(Math.max(share, 0), 1)));
    $(`${name}-slider`).setAttribute("aria-valuetext", `${Number(value.toPrecision(5))} ${FIELDS[name].unit}`);
    if (typing === name) continue;
    $(name).value = String(Number(value.toPrecision(10)));
    $(name).setAttribute("aria-invalid", "false");
    $(`${name}-problem`).textContent = "";
  }
  $("ring").value = String(page.state.ring);
  $("model").value = String(page.state.model);
  for (const [k, { name }] of page.data.heaters.entries()) {
    const none = !(name in (page.data.models[page.state.model].heaters || {}));
    $(`h${k}`).disabled = $(`h${k}-slider`).disabled = none;
    $(`h${k}-problem`).textContent ||= none ? "The chosen thermal model has no such heater." : "";
  }
  for (const input of document.querySelectorAll("input[name=view]")) input.checked = input.value === page.state.view;
}

function set(change, what) {
  page.state = { ...page.state, ...change };
  fill();
  page.changed(what);
}
