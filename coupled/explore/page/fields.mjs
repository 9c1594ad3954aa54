// Controls: fields and sliders; the pointer on the figures, which drags the laser, reads values and zooms.

import { draw } from "./paint.mjs";
import { escaped, timeLabel } from "./plot.mjs";
import { toPicometres } from "./ring.mjs";
import { FIELDS, UNTOUCHED, fromShown, objection, page, planeWindow, ringOf, shown, shownUnit, toShown, valueOf, watts, windowOf } from "./state.mjs";

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

const FEWEST = 6; // pixels of a rectangle that counts as one

const clamp = (v, low, high) => Math.min(Math.max(v, low), high);

/** The panel of a figure that an event is nearest to, its number, and the place in pixels of the figure, within the panel. */
function placeOf(plot, event) {
  const svg = plot.querySelector("svg");
  const panels = shown.panels[plot.id];
  if (!svg || !panels) return null;
  const [rect, size] = [svg.getBoundingClientRect(), svg.viewBox.baseVal];
  const [u, v] = [((event.clientX - rect.left) * size.width) / rect.width, ((event.clientY - rect.top) * size.height) / rect.height];
  const off = panels.map(({ box }) => Math.abs(clamp(v, box.top, box.top + box.height) - v));
  const k = off.indexOf(Math.min(...off));
  const { box } = panels[k];
  return { k, panel: panels[k], u: clamp(u, box.left, box.left + box.width), v: clamp(v, box.top, box.top + box.height), outside: off[k] > 20 };
}

/** The value of an axis in words, from its label "Drop (mW)". */
function said({ label, time }, value) {
  const [, name, unit] = label.match(/^(.*?)(?: \(([^()]*)\))?$/);
  return `${name} ${time ? timeLabel(value) : `${Number(value.toPrecision(4))}${unit ? ` ${unit}` : ""}`}`;
}

/** The values under the pointer, beside it; of a curve over time its own value. */
function readOut(event, place) {
  $("readout").hidden = !place || place.outside;
  if ($("readout").hidden) return;
  const { x, y } = place.panel;
  const value = x.scale.invert(place.u);
  $("readout").textContent = `${said(x, value)}, ${said(y, y.read ? y.read(value) : y.scale.invert(place.v))}`;
  const left = Math.min(event.clientX + 14, innerWidth - $("readout").offsetWidth - 8);
  $("readout").style.translate = `${left}px ${event.clientY + 16}px`;
}

/** Zoom to the rectangle between two places of one panel. */
function zoomTo(id, from, to) {
  if (id === "plane") {
    const { x, y } = shown.plane;
    const inverse = (scale, a, b) => [scale.invert(a), scale.invert(b)].sort((p, q) => p - q);
    zoomPlane({ detuning: inverse(x, from.u, to.u), power: inverse(y, from.v, to.v) });
    return;
  }
  const { x, y } = from.panel;
  const [left, right] = [from.u, to.u].sort((a, b) => a - b);
  const [top, bottom] = [from.v, to.v].sort((a, b) => a - b);
  shown.zoom[id] = { x: [left, right].map((u) => x.scale.invert(u)), y: [bottom, top].map((v) => y.scale.invert(v)), panel: from.k };
  draw();
}

/** Compute the plane in a window of dBm and GHz, or in all of it. */
function zoomPlane(window) {
  shown.zoom.plane = window;
  page.changed({ ring: true });
}

/** The plane `factor` times as wide about the laser; 0 for all of it. */
function zoomBy(factor) {
  const window = planeWindow(page.state, page.data);
  const about = (name) => {
    const at = clamp(page.state[name], ...window[name]);
    return window[name].map((end) => at + factor * (end - at));
  };
  zoomPlane(factor ? { power: about("power"), detuning: about("detuning") } : null);
}

/** Every figure: values under the pointer, a rectangle to zoom in to (on the plane with Shift), all of it by a double click. The plane has buttons, too. */
export function watchFigures() {
  for (const button of document.querySelectorAll("button[data-zoom]")) button.addEventListener("click", () => zoomBy(Number(button.dataset.zoom)));
  for (const plot of document.querySelectorAll(".plot")) {
    let from = null;
    plot.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "touch" || (plot.id === "plane" && !event.shiftKey)) return;
      from = placeOf(plot, event);
      plot.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    plot.addEventListener("pointermove", (event) => {
      const place = placeOf(plot, event);
      readOut(event, place);
      if (!from || !place) return;
      const rect = plot.getBoundingClientRect();
      const at = [rect.left + Math.min(from.u, place.u), rect.top + Math.min(from.v, place.v)];
      Object.assign($("band").style, { translate: `${at[0]}px ${at[1]}px`, width: `${Math.abs(place.u - from.u)}px`, height: `${Math.abs(place.v - from.v)}px` });
      $("band").hidden = false;
    });
    plot.addEventListener("pointerup", (event) => {
      const to = placeOf(plot, event);
      $("band").hidden = true;
      if (from && Math.abs(to.u - from.u) > FEWEST && Math.abs(to.v - from.v) > FEWEST) zoomTo(plot.id, from, to);
      from = null;
    });
    plot.addEventListener("pointerleave", () => ($("readout").hidden = true));
    plot.addEventListener("dblclick", () => {
      if (plot.id === "plane") return;
      delete shown.zoom[plot.id];
      draw();
    });
  }
}

/** The laser on the plane: dragged with the pointer, moved with the arrow keys. */
export function watchPlane() {
  const target = $("plane");
  const under = (event) => {
    const { u, v } = placeOf(target, event);
    return { detuning: Number(shown.plane.x.invert(u).toFixed(2)), power: Number(shown.plane.y.invert(v).toFixed(3)) };
  };
  const point = ({ detuning, power }) => {
    const picometres = -toPicometres(detuning, ringOf(page.state, page.data));
    $("pointed").textContent = `Under the pointer: ${power.toFixed(2)} dBm = ${(1e3 * watts(power)).toPrecision(3)} mW, ${detuning.toFixed(1)} GHz = ${picometres.toFixed(0)} pm from the cold resonance.`;
  };
  target.addEventListener("pointerdown", (event) => {
    if (event.shiftKey) return;
    target.setPointerCapture(event.pointerId);
    takeAll(under(event));
    target.focus({ preventScroll: true });
    event.preventDefault();
  });
  target.addEventListener("pointermove", (event) => {
    if (!shown.plane) return;
    point(under(event));
    if (event.buttons && !event.shiftKey && target.hasPointerCapture(event.pointerId)) takeAll(under(event));
  });
  target.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!steps) return;
    event.preventDefault();
    const window = planeWindow(page.state, page.data);
    const fine = event.shiftKey ? 500 : 100;
    const moved = (name, k) => Number((page.state[name] + (steps[k] * (window[name][1] - window[name][0])) / fine).toPrecision(8));
    takeAll({ detuning: moved("detuning", 0), power: moved("power", 1) });
  });
}
