// The pointer on the figures: values under it, the laser dragged on the plane, and what is zoomed in to.

import { takeAll } from "./fields.mjs";
import { draw } from "./paint.mjs";
import { timeLabel } from "./plot.mjs";
import { toPicometres } from "./ring.mjs";
import { planeWindow, ringOf, watts } from "./state.mjs";
import { $, page, shown } from "./view.mjs";

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
