// Fields and sliders: from the state to what is shown, and from what is typed or dragged to the state.

import { escaped } from "./plot.mjs";
import { FIELDS, UNTOUCHED, fromShown, objection, shownUnit, toShown, valueOf, windowOf } from "./state.mjs";
import { $, page } from "./view.mjs";

/** Fill the selects and make the fields; names come as text, never as markup. */
export function build() {
  const { data } = page;
  const select = (id, names, change) => {
    names.forEach((name, value) => $(id).add(new Option(name, String(value))));
    $(id).addEventListener("change", () => change(Number($(id).value)));
  };
  for (const name of Object.keys(FIELDS)) field(name);
  select("ring", data.rings.map((ring) => ring.name), (ring) => set({ ring, ...UNTOUCHED }, { ring: true })); // prettier-ignore
  select("model", data.models.map((model) => model.name), (model) => set({ model, resistance: null }, { ring: true })); // prettier-ignore
  select("preset", ["Choose a preset…", ...data.presets.map((preset) => preset.name)], (k) => {
    if (k === 0) return;
    set({ ...data.start, ...data.presets[k - 1].state, units: page.state.units }, { ring: true });
    $("about").textContent = data.presets[k - 1].text;
  });
  $("units").addEventListener("change", () => set({ units: $("units").value }, {}));
  for (const input of document.querySelectorAll("input[name=view]")) input.addEventListener("change", () => set({ view: input.value }, {}));
  $("reset").addEventListener("click", () => set(UNTOUCHED, { ring: true }));
  if (data.family) $("family-error").textContent = `Interpolated between members: steps within ${(100 * data.family.error).toPrecision(2)} % of the thermal resistance.`;
}

/** One field: number and slider, which move together; a value out of range is marked and not taken. */
function field(name) {
  const { log, step, label, group } = FIELDS[name];
  const html =
    `<div class="field"><div class="row"><label for="${name}">${escaped(label)}</label><span class="value">` +
    `<input type="number" id="${name}" step="any" aria-describedby="${name}-problem"><span class="unit"></span></span></div>` +
    `<input type="range" id="${name}-slider" min="0" step="1"><p class="problem" id="${name}-problem" role="alert"></p></div>`;
  $(`${group}-fields`).insertAdjacentHTML("beforeend", html);
  const [number, slider] = [$(name), $(`${name}-slider`)];
  const typed = () => (number.value.trim() === "" ? NaN : fromShown(name, Number(number.value), page.state, page.data));
  number.addEventListener("input", () => refused(name, typed()) || takeAll({ [name]: typed() }, name));
  number.addEventListener("change", () => number.getAttribute("aria-invalid") !== "true" && fill());
  slider.addEventListener("input", () => {
    const [low, high] = span(name);
    const share = Number(slider.value) / stepsOf(name);
    let value = log ? low * (high / low) ** share : low + share * (high - low);
    value = step ? Math.round(value / step) * step : value;
    takeAll({ [name]: Number(value.toPrecision(log ? 4 : 6)) });
  });
}

/** What a slider spans: less than what its field takes. */
function span(name) {
  const { low, high, group } = FIELDS[name];
  const { power } = page.data.rings[page.state.ring].window;
  if (name === "power") return [power[0] - 7, power[1] + 5];
  if (name === "detuning") return windowOf(page.state, page.data, 2.5).detuning;
  if (name === "duration") return [1, 100];
  if (name === "absorbed" || group === "geometry") return [low, high];
  if (group === "heaters") return [0, page.data.heaters[Number(name[1])].span];
  const own = valueOf(name, { ...page.state, [name]: null }, page.data);
  return name === "lifetime" ? [own / 30, own * 10] : [own / 5, own * 5];
}

/** Places of a slider: one for every step, so that an arrow key moves it by one. */
function stepsOf(name, [low, high] = span(name)) {
  return FIELDS[name].step ? Math.round((high - low) / FIELDS[name].step) : 1000;
}

/** Why a value of a field cannot be taken; the field then says so. */
function refused(name, value) {
  const problem = objection(name, value, page.state, page.data);
  $(name).setAttribute("aria-invalid", problem ? "true" : "false");
  $(`${name}-problem`).textContent = problem;
  return problem !== "";
}

/** Take values; one that is out of range is left out. `typing` is the field that is being typed in. */
export function takeAll(values, typing = null) {
  const taken = Object.entries(values).filter(([name, value]) => !refused(name, value));
  const groups = taken.map(([name]) => FIELDS[name].group);
  const member = groups.includes("geometry") ? { model: page.data.models.findIndex((model) => model.family) } : {};
  set({ ...Object.fromEntries(taken), ...member }, { ring: groups.some((group) => !["laser", "time"].includes(group)) }, typing);
}

/** Write the state into the fields, but not into the one that is being typed in. */
export function fill(typing = null) {
  const { state, data } = page;
  $("link-problem").textContent = "";
  for (const name of Object.keys(FIELDS)) {
    const [value, unit, slider] = [valueOf(name, state, data), shownUnit(name, state), $(`${name}-slider`)];
    const [low, high] = span(name);
    const share = FIELDS[name].log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    slider.max = stepsOf(name, [low, high]);
    slider.value = String(Math.round(slider.max * Math.min(Math.max(share, 0), 1)));
    slider.setAttribute("aria-valuetext", `${Number(toShown(name, value, state, data).toPrecision(5))} ${unit}`);
    slider.setAttribute("aria-label", `${FIELDS[name].label}, slider${unit ? `, ${unit}` : ""}`);
    $(name).nextElementSibling.textContent = unit;
    if (typing === name) continue;
    $(name).value = String(Number(toShown(name, value, state, data).toPrecision(state.units === "pm" || state[name] === null ? 6 : 10)));
    $(name).setAttribute("aria-invalid", "false");
    $(`${name}-problem`).textContent = "";
  }
  for (const name of ["ring", "model", "units"]) $(name).value = String(state[name]);
  for (const [k, { name }] of data.heaters.entries()) {
    const none = !(name in (data.models[state.model].heaters || {}));
    $(`h${k}`).disabled = $(`h${k}-slider`).disabled = none;
    $(`h${k}-problem`).textContent ||= none ? "The chosen thermal model has no such heater." : "";
  }
  for (const input of document.querySelectorAll("input[name=view]")) input.checked = input.value === state.view;
}

function set(change, what, typing = null) {
  page.state = { ...page.state, ...change };
  fill(typing);
  page.changed(what);
}
