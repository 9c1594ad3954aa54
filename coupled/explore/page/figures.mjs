// The figures of light: plane of power and detuning, traces, phase portrait, transmission.

import { boxOf, curve, dot, figure, stroke } from "./plot.mjs";
import { extent, firstAt } from "./pulsing.mjs";
import { UW, throughPower, toPicometres } from "./ring.mjs";

function padded(values, share = 0.06) {
  const [low, high] = extent(values);
  if (!(low <= high)) return [0, 1];
  const gap = (high - low || Math.abs(high) || 1) * share;
  return [low - gap, high + gap];
}

const dBm = (power) => 10 * Math.log10(power / 1e-3);

/** The axis of detunings in GHz, marked in the units of the page; along it lie the same places. */
export function detuningAxis(domain, units, ring) {
  if (units !== "pm") return { domain, label: "Detuning (GHz)" };
  return { domain: domain.map((x) => -toPicometres(x, ring)), label: "Wavelength from the cold resonance (pm)" };
}

/** The axis of powers in dBm, marked in the units of the page. */
export function powerAxis(domain, units) {
  if (units !== "pm") return { domain, label: "Power (dBm)" };
  return { domain: domain.map((x) => 10 ** (x / 10)), label: "Power (mW)", log: true };
}

/** The image of a map: one pixel for each point, as a data URL. */
export function mapImage({ n, m, stable }, colours) {
  const canvas = Object.assign(document.createElement("canvas"), { width: m, height: n });
  const context = canvas.getContext("2d");
  [colours.pulsing, colours.stable, colours.bistable].forEach((colour, kind) => {
    context.fillStyle = colour;
    for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) if (Math.min(stable[i * m + j], 2) === kind) context.fillRect(j, n - 1 - i, 1, 1);
  });
  return canvas.toDataURL("image/png");
}

/** Stretches of a curve within which `kind` stays the same, each up to the first point of the next, unless that is `cut` off. */
function stretches(points, kind) {
  const out = [];
  points.forEach((p, k) => {
    if (k && !p.cut) out.at(-1).push(p);
    if (!k || p.cut || kind(p) !== kind(points[k - 1])) out.push([p]);
  });
  return out;
}

/** The plane of power and detuning, with the laser at the origin, and its scales in GHz and dBm, for the pointer. */
export function planeFigure(width, height, { window, map, curves, cycles, kept, units, ring }, colours) {
  const box = boxOf(width, height, { bottom: 78 });
  const whole = figure(width, height, colours);
  const x = d3.scaleLinear(window.detuning, [box.left, box.left + box.width]);
  const y = d3.scaleLinear(window.power, [box.top + box.height, box.top]);
  const line = (points, ...look) => stroke(curve(x, y, points.map((p) => p.detuning / 1e9), points.map((p) => dBm(p.power))), ...look); // prettier-ignore
  whole.panel(box, detuningAxis(window.detuning, units, ring), powerAxis(window.power, units), () => {
    const smooth = map && map.n >= 100 ? "auto" : "pixelated";
    let content = map ? `<image href="${map.image}" x="${box.left}" y="${box.top}" width="${box.width}" height="${box.height}" preserveAspectRatio="none" style="image-rendering:${smooth}"/>` : "";
    for (const fold of curves.folds) content += line(fold, colours.fold, 1.8, "6 3");
    for (const piece of curves.hopf.flatMap((hopf) => stretches(hopf, (p) => p.leading))) {
      content += line(piece, colours.hopf, ...(piece[0].leading ? [2.2, ""] : [1.4, "1 4"]));
    }
    for (const part of cycles) content += line(part, colours.folds, 2, "2 3");
    if (kept) content += dot(x(kept.state.detuning), y(kept.state.power), 6, "none", colours.ink);
    const cross = `<path d="M0 ${-2 * height}V${2 * height}M${-2 * width} 0H${2 * width}" stroke="${colours.ink}" stroke-opacity=".35"/>`;
    return `${content}<g class="laser">${cross}${dot(0, 0, 8, colours.ground, colours.ink)}<circle r="3" fill="${colours.ink}"/></g>`;
  });
  const entries = [["stable", "box"], ["bistable", "box"], ["self-pulsing", "box"]].map(([name, mark], k) => ({ name, mark, colour: [colours.stable, colours.bistable, colours.pulsing][k] })); // prettier-ignore
  entries.push({ name: "Hopf", colour: colours.hopf }, { name: "fold", colour: colours.fold, dash: "6 3" });
  if (cycles.length) entries.push({ name: "fold of cycles", colour: colours.folds, dash: "2 3" });
  whole.legend(entries, box, 56);
  return { ...whole.done("Plane of power and detuning with regimes and bifurcation curves"), x, y, box };
}

/** Power in mW at the drop port, of a ring on one bus at the through port: of a fixed point, and along a trace. */
const steadyOutput = (p, { drop }) => 1e3 * (drop > 0 ? p.drop : p.through);
const output = ({ U, re, im }, { drop, bus, power }) => U.map((u, i) => 1e3 * (drop > 0 ? 2 * drop * u * UW : throughPower(re[i], im[i], power, bus)));
const outputLabel = ({ drop }) => (drop > 0 ? "Drop (mW)" : "Through (mW)");

/** Traces of drop power (through power for a ring on one bus), temperature and carriers over a common time, over those that were kept. */
export function tracesFigure(width, height, { now, kept, light, zoom }, colours) {
  const length = ({ t }) => t[t.length - 1] - t[0];
  const span = Math.max(length(now), kept ? length(kept.now) : 0);
  const [unit, scale] = span < 3000 ? ["ns", 1] : ["µs", 1e-3];
  const gap = 10;
  const whole = boxOf(width, height);
  const each = (whole.height - 2 * gap) / 3;
  const rowsOf = (run, its) => [output(run, its), run.dT, run.N];
  const [mine, theirs] = [rowsOf(now, light), kept && rowsOf(kept.now, kept.light)];
  const fig = figure(width, height, colours, zoom);
  [outputLabel(light), "ΔT (K)", "N (10²³ m⁻³)"].forEach((label, k) => {
    const time = { domain: [now.t[0] * scale, (now.t[0] + span) * scale], label: `Time (${unit})`, hidden: k < 2 };
    const read = (t) => mine[k][Math.min(firstAt(now.t, t / scale), now.t.length - 1)];
    fig.panel({ ...whole, top: whole.top + k * (each + gap), height: each }, time, { domain: padded(kept ? [...mine[k], ...theirs[k]] : mine[k]), label, read }, (x, y) => {
      const before = kept ? stroke(curve(x, y, kept.now.t.map((t) => (t - kept.now.t[0]) * scale + time.domain[0]), theirs[k]), colours.soft, 1.4, "5 3") : "";
      return before + stroke(curve(x, y, now.t.map((t) => t * scale), mine[k], { sorted: true }), colours.series[k]); // prettier-ignore
    });
  });
  return fig.done("Traces over time of optical power, temperature rise and carrier density");
}

/** Orbit in the plane of temperature and carriers, with every fixed point. */
export function phaseFigure(width, height, { now, states, kept, zoom }, colours) {
  const box = boxOf(width, height, { bottom: 64 });
  const fig = figure(width, height, colours, zoom);
  const [xs, ys] = [states.map((p) => p.delta_T), states.map((p) => p.carriers / 1e23)];
  const others = kept ? kept.now : { dT: [], N: [] };
  const across = { domain: padded([...now.dT, ...xs, ...others.dT]), label: "Temperature rise ΔT (K)" };
  fig.panel(box, across, { domain: padded([...now.N, ...ys, ...others.N]), label: "Carriers N (10²³ m⁻³)" }, (x, y) => {
    const orbits = stroke(curve(x, y, others.dT, others.N), colours.soft, 1.4, "5 3") + stroke(curve(x, y, now.dT, now.N), colours.accent);
    return orbits + states.map((p, k) => dot(x(xs[k]), y(ys[k]), 5, p.regime === "stable" ? colours.ink : colours.ground, colours.ink)).join("");
  });
  fig.legend([{ name: "orbit", colour: colours.accent }, { name: "fixed point (filled: stable)", colour: colours.ink, mark: "dot" }], box, 58); // prettier-ignore
  return fig.done("Phase portrait: carriers against temperature rise, with fixed points");
}

/** All fixed points against detuning at the present power; a slow sweep jumps at the folds. */
export function transmissionFigure(width, height, { points, states, state, light, window, kept, ring, zoom }, colours) {
  const box = boxOf(width, height, { bottom: 64 });
  const fig = figure(width, height, colours, zoom);
  const value = (p) => steadyOutput(p, light);
  const [unit] = detuningAxis([1], state.units, ring).domain;
  const place = (p) => (p.detuning / 1e9) * unit;
  const inside = points.filter((p) => p.detuning / 1e9 >= window[0] && p.detuning / 1e9 <= window[1]);
  fig.panel(box, detuningAxis(window, state.units, ring), { domain: [0, padded(inside.map(value))[1]], label: outputLabel(light) }, (x, y) => {
    const looks = { stable: [colours.accent, 2.1, ""], saddle: [colours.soft, 2.1, "2 4"], pulses: [colours.hopf, 2.1, "7 3"] };
    const line = (piece, look, height = value) => stroke(curve(x, y, piece.map(place), piece.map(height)), ...look);
    let content = "";
    if (kept) content += line(kept.points.map((p) => (p.cut ? { ...p, detuning: NaN } : p)), [colours.soft, 1.4, "5 3"], (p) => steadyOutput(p, kept.light)); // prettier-ignore
    for (const piece of stretches(points, (p) => p.regime)) content += line(piece, looks[piece[0].regime] || looks.pulses);
    for (const [from, to] of jumps(points)) content += stroke(`M${x(place(from))} ${y(value(from))}V${y(value(to))}`, colours.ink, 1.2, "1 3");
    content += `<path d="M${x(state.detuning * unit)} ${box.top}v${box.height}" stroke="${colours.ink}" stroke-opacity=".35"/>`;
    return content + states.map((p) => dot(x(state.detuning * unit), y(value(p)), 4.5, p.regime === "stable" ? colours.ink : colours.ground, colours.ink)).join("");
  });
  fig.legend([{ name: "stable", colour: colours.accent }, { name: "pulses", colour: colours.hopf, dash: "7 3" }, { name: "saddle", colour: colours.soft, dash: "2 4" }], box, 58); // prettier-ignore
  return fig.done("Fixed points against detuning at the present power, with the jumps of a slow sweep");
}

/** Where a slow sweep leaves a branch, [from, to]: the turning points of the detuning along the curve. */
function jumps(points) {
  const out = [];
  for (let k = 1; k + 1 < points.length; k++) {
    const here = points[k];
    const [before, after] = [here.detuning - points[k - 1].detuning, points[k + 1].detuning - here.detuning];
    if (before * after >= 0 || here.cut || points[k + 1].cut) continue;
    const lands = (p, j) => j > 0 && Math.abs(j - k) >= 3 && !p.cut && p.regime !== "saddle" && (points[j - 1].detuning - here.detuning) * (p.detuning - here.detuning) <= 0;
    const target = points.findLast(lands);
    if (target) out.push([here, target]);
  }
  return out;
}
