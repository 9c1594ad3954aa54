// The cross-section with the temperature field at one phase of the cycle, and its player.

import { figure, pathOf, theme } from "./plot.mjs";
import { columns, firstAt } from "./pulsing.mjs";
import { NS, UW, absorbedPower, systemOf } from "./ring.mjs";
import { page, put, shown, widthOf } from "./state.mjs";
import { fieldOf, periodicStates } from "./thermal.mjs";

/** The images of a cross-section from base64 to arrays of 8-bit numbers. */
export function decoded(section) {
  const image = ({ scale, values }) => ({ scale, values: Int8Array.from(atob(values), (c) => (c.charCodeAt(0) << 24) >> 24) });
  const heaters = Object.fromEntries(Object.entries(section.heaters).map(([name, one]) => [name, image(one)]));
  return { ...section, modes: section.modes.map(image), heaters };
}

/** The field at one phase of the cycle, from the absorbed power of the trace. */
export function drawSection() {
  if (!page.data.section || !shown.trace) return;
  const colours = theme();
  if (!shown.section) shown.section = thermalCycle();
  const { states, top, times } = shown.section;
  const field = fieldOf(page.data.section, states(shown.phase), shown.trace.request.model.on);
  put("section", sectionFigure(widthOf("section"), { section: page.data.section, image: fieldImage(page.data.section, field, top, colours), top }, colours));
  $("phase-text").textContent = times ? `${(shown.phase * times).toFixed(0)} ns of ${times.toFixed(0)} ns` : "at rest";
}

/** Rows of the trace that make one cycle: the settled one, or the last of the run; at rest the last few. */
function cycleRows({ rows, cycle, pulsing }) {
  if (pulsing.regime !== "self-pulsing") return columns(rows, rows.length / 5 - 4, rows.length / 5);
  if (cycle) return columns(cycle.rows, 0, cycle.count);
  const { t } = columns(rows, 0, rows.length / 5);
  return columns(rows, firstAt(t, pulsing.begin), Math.max(firstAt(t, pulsing.end), 1));
}

/** States of the modes over the present cycle, or at the end of a trace that rests. */
function thermalCycle() {
  const { request, pulsing } = shown.trace;
  const { section } = page.data;
  const system = systemOf(request.ring, request.model);
  const model = { R: section.R.map((R) => R * (request.model.factor || 1)), tau: section.tau };
  const c = cycleRows(shown.trace);
  const powers = c.t.map((_, i) => absorbedPower(c.U[i], c.N[i], system) * UW);
  if (pulsing.regime !== "self-pulsing") {
    const x = model.R.map((R) => R * powers.at(-1));
    return { states: () => x, top: peak(section, x, request.model.on), times: 0 };
  }
  const times = c.t.map((t) => (t - c.t[0]) * NS);
  const cycle = periodicStates(model, times, powers);
  const states = (phase) => cycle.at(phase * times.at(-1));
  const tops = Array.from({ length: 24 }, (_, k) => peak(section, states(k / 24), request.model.on));
  return { states, top: Math.max(...tops), times: times.at(-1) / NS };
}

function peak(section, x, powers) {
  return Math.max(fieldOf(section, x, powers).reduce((a, b) => Math.max(a, b), 0), 1e-9);
}

// from cool to hot: lightness falls (light theme) or rises (dark theme) throughout
const RAMPS = { light: ["#ffffff", "#fee8c8", "#fdbb84", "#e34a33", "#7f0000"], dark: ["#171b20", "#4a1c1c", "#a33c1c", "#f08a3c", "#fff0c0"] };

/** The image of a field on the grid of the section, as a data URL; `top` is the rise of the hottest colour. */
function fieldImage(section, field, top, colours) {
  const { width, height } = section;
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  const ramp = d3.scaleLinear([0, 0.25, 0.5, 0.75, 1], RAMPS[colours.name]).clamp(true);
  const table = Array.from({ length: 256 }, (_, k) => ramp(k / 255).match(/\d+/g).map(Number));
  for (let i = 0; i < height; i++) {
    for (let j = 0; j < width; j++) {
      const value = field[(height - 1 - i) * width + j];
      image.data.set([...table[Math.max(0, Math.min(255, Math.round((255 * value) / top)))], 255], 4 * (i * width + j));
    }
  }
  context.putImageData(image, 0, 0);
  return canvas.toDataURL("image/png");
}

function sectionFigure(width, { section, image, top }, colours) {
  const [r, z] = [section.r, section.z].map((ends) => ends.map((x) => x * 1e6));
  const inner = width - 72;
  const box = { left: 58, top: 10, width: inner, height: (inner * (z[1] - z[0])) / (r[1] - r[0]) };
  const bar = box.top + box.height + 46;
  const fig = figure(width, bar + 18, colours, shown.zoom.section);
  fig.panel(box, { domain: r, label: "Radius (µm)" }, { domain: z, label: "Height (µm)" }, (x, y) => {
    const place = `x="${x(r[0])}" y="${y(z[1])}" width="${x(r[1]) - x(r[0])}" height="${y(z[0]) - y(z[1])}"`;
    const outlines = section.outlines.map((line) => `<path d="${pathOf(line.map(([u]) => x(u * 1e6)), line.map(([, v]) => y(v * 1e6)), { sorted: false })}Z" fill="none" stroke="${colours.ink}" stroke-opacity=".7"/>`); // prettier-ignore
    return `<image href="${image}" ${place} preserveAspectRatio="none"/>${outlines.join("")}`;
  });
  const ramp = RAMPS[colours.name].map((c, k) => `<stop offset="${25 * k}%" stop-color="${c}"/>`).join("");
  const text = `y="${bar + 9}" font-size="11.5" fill="${colours.soft}"`;
  fig.text(`<defs><linearGradient id="heat">${ramp}</linearGradient></defs><rect x="${box.left + 40}" y="${bar}" width="${inner - 130}" height="9" fill="url(#heat)" stroke="${colours.line}"/>`);
  fig.text(`<text x="${box.left + 34}" text-anchor="end" ${text}>0 K</text><text x="${box.left + inner - 84}" ${text}>${top.toFixed(1)} K</text>`);
  return fig.done("Cross-section of the ring, to scale, with the temperature rise");
}

let playing = 0;

/** Start or stop going through the cycle. */
export function play() {
  if (playing) {
    cancelAnimationFrame(playing);
    playing = 0;
    $("play").textContent = "Play";
    return;
  }
  $("play").textContent = "Pause";
  const begun = performance.now() - 4000 * shown.phase;
  const frame = (now) => {
    shown.phase = ((now - begun) / 4000) % 1;
    $("phase").value = String(shown.phase);
    drawSection();
    playing = requestAnimationFrame(frame);
  };
  playing = requestAnimationFrame(frame);
}
