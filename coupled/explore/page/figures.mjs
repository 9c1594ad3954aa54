// The figures of light: plane of power and detuning, traces, phase portrait, transmission.

import { legend, panel, pathOf, svgOf } from "./plot.mjs";
import { UW, FJ } from "./ring.mjs";

const MARGIN = { left: 58, right: 14, top: 10, bottom: 42 };

export function boxOf(width, height, { top = MARGIN.top, bottom = MARGIN.bottom } = {}) {
  return { left: MARGIN.left, top, width: width - MARGIN.left - MARGIN.right, height: height - top - bottom };
}

export function linear(domain, range) {
  return d3.scaleLinear(domain, range);
}

export function logarithmic(domain, range) {
  return d3.scaleLog(domain, range);
}

function padded(values, share = 0.06) {
  let low = Infinity;
  let high = -Infinity;
  for (const v of values) {
    if (v < low) low = v;
    if (v > high) high = v;
  }
  if (!(low <= high)) return [0, 1];
  const gap = (high - low || Math.abs(high) || 1) * share;
  return [low - gap, high + gap];
}

const dBm = (power) => 10 * Math.log10(power / 1e-3);

/** The image of a map: one pixel for each point, as a data URL. */
export function mapImage({ n, m, stable }, colours) {
  const canvas = document.createElement("canvas");
  canvas.width = m;
  canvas.height = n;
  const context = canvas.getContext("2d");
  [colours.pulsing, colours.stable, colours.bistable].forEach((colour, kind) => {
    context.fillStyle = colour;
    for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) if (Math.min(stable[i * m + j], 2) === kind) context.fillRect(j, n - 1 - i, 1, 1);
  });
  return canvas.toDataURL("image/png");
}

/** The plane of power and detuning. Returns its SVG, with the laser at the origin, and the scales, for the pointer. */
export function planeFigure(width, height, { window, map, curves, cycles }, colours) {
  const box = boxOf(width, height, { bottom: 78 });
  const x = linear(window.detuning, [box.left, box.left + box.width]);
  const y = linear(window.power, [box.top + box.height, box.top]);
  let content = "";
  if (map) {
    const smooth = map.n >= 100 ? "auto" : "pixelated";
    content += `<image href="${map.image}" x="${box.left}" y="${box.top}" width="${box.width}" height="${box.height}" preserveAspectRatio="none" style="image-rendering:${smooth}"/>`;
  }
  const line = (points, colour, dash, w = 1.8) => {
    const xs = points.map((p) => x(p.detuning / 1e9));
    const ys = points.map((p) => y(dBm(p.power)));
    return `<path d="${pathOf(xs, ys, { sorted: false })}" fill="none" stroke="${colour}" stroke-width="${w}" stroke-dasharray="${dash}"/>`;
  };
  for (const fold of curves.folds) content += line(fold, colours.fold, "6 3");
  for (const hopf of curves.hopf) {
    let piece = [];
    hopf.forEach((p, k) => {
      piece.push(p);
      if (k === hopf.length - 1 || hopf[k + 1].leading !== p.leading) {
        content += line(piece, colours.hopf, p.leading ? "" : "1 4", p.leading ? 2.2 : 1.4);
        piece = [p];
      }
    });
  }
  for (const part of cycles || []) content += line(part, colours.folds, "2 3", 2);
  content += `<g class="laser"><path d="M0 ${-2 * height}V${2 * height}M${-2 * width} 0H${2 * width}" stroke="${colours.ink}" stroke-opacity=".35"/>`;
  content += `<circle r="8" fill="${colours.ground}" stroke="${colours.ink}" stroke-width="2"/><circle r="3" fill="${colours.ink}"/></g>`;
  let text = panel(box, { scale: x, label: "Detuning (GHz)" }, { scale: y, label: "Power (dBm)" }, content, colours);
  const entries = [
    { name: "stable", colour: colours.stable, mark: "box" },
    { name: "bistable", colour: colours.bistable, mark: "box" },
    { name: "self-pulsing", colour: colours.pulsing, mark: "box" },
    { name: "Hopf", colour: colours.hopf },
    { name: "fold", colour: colours.fold, dash: "6 3" },
  ];
  if (cycles && cycles.length) entries.push({ name: "fold of cycles", colour: colours.folds, dash: "2 3" });
  text += legend(entries, box.left, box.top + box.height + 56, box.width, colours).text;
  return { svg: svgOf(width, height, text, colours, "Plane of power and detuning with regimes and bifurcation curves"), x, y, box };
}

/** Traces of drop power (energy for a ring on one bus), temperature and carriers over a common time. */
export function tracesFigure(width, height, { t, U, N, dT, drop }, colours) {
  const [low, high] = [t[0], t[t.length - 1]];
  const nano = high - low < 3000;
  const scale = nano ? 1 : 1e-3;
  const gap = 10;
  const each = (height - MARGIN.top - MARGIN.bottom - 2 * gap) / 3;
  const rows = [
    { label: drop > 0 ? "Drop (mW)" : "Energy (fJ)", values: U.map((u) => (drop > 0 ? 2 * drop * u * UW * 1e3 : u)), colour: colours.series[0] },
    { label: "ΔT (K)", values: dT, colour: colours.series[1] },
    { label: "N (10²³ m⁻³)", values: N, colour: colours.series[2] },
  ];
  let text = "";
  rows.forEach((row, k) => {
    const box = { left: MARGIN.left, top: MARGIN.top + k * (each + gap), width: width - MARGIN.left - MARGIN.right, height: each };
    const x = linear([low * scale, high * scale], [box.left, box.left + box.width]);
    const y = linear(padded(row.values), [box.top + box.height, box.top]);
    const path = pathOf(t.map((v) => x(v * scale)), Float64Array.from(row.values, y));
    const content = `<path d="${path}" fill="none" stroke="${row.colour}" stroke-width="1.6" stroke-linejoin="round"/>`;
    text += panel(box, { scale: x, label: nano ? "Time (ns)" : "Time (µs)", hidden: k < 2 }, { scale: y, label: row.label }, content, colours);
  });
  return svgOf(width, height, text, colours, "Traces over time of drop power, temperature rise and carrier density");
}

/** Orbit in the plane of temperature and carriers, with every fixed point. */
export function phaseFigure(width, height, { N, dT, states }, colours) {
  const box = boxOf(width, height, { bottom: 64 });
  const xs = [...states.map((p) => p.delta_T)];
  const ys = [...states.map((p) => p.carriers / 1e23)];
  const reachX = padded([...dT, ...xs]);
  const reachY = padded([...N, ...ys]);
  const x = linear(reachX, [box.left, box.left + box.width]);
  const y = linear(reachY, [box.top + box.height, box.top]);
  let content = `<path d="${pathOf(dT.map((v) => x(v)), N.map((v) => y(v)), { sorted: false })}" fill="none" stroke="${colours.accent}" stroke-width="1.6" stroke-linejoin="round"/>`;
  states.forEach((p, k) => {
    const stable = p.regime === "stable";
    content += `<circle cx="${x(xs[k]).toFixed(1)}" cy="${y(ys[k]).toFixed(1)}" r="5" fill="${stable ? colours.ink : colours.ground}" stroke="${colours.ink}" stroke-width="1.8"/>`;
  });
  let text = panel(box, { scale: x, label: "Temperature rise ΔT (K)" }, { scale: y, label: "Carriers N (10²³ m⁻³)" }, content, colours);
  text += legend([{ name: "orbit", colour: colours.accent }, { name: "fixed point (filled: stable)", colour: colours.ink, mark: "dot" }], box.left, height - 6, box.width, colours).text;
  return svgOf(width, height, text, colours, "Phase portrait: carriers against temperature rise, with fixed points");
}

/** All fixed points against detuning at the present power; a slow sweep jumps at the folds. */
export function transmissionFigure(width, height, { points, states, state, drop, window }, colours) {
  const box = boxOf(width, height, { bottom: 64 });
  const value = (p) => (drop > 0 ? p.drop * 1e3 : p.energy / FJ);
  const inside = points.filter((p) => p.detuning / 1e9 >= window[0] && p.detuning / 1e9 <= window[1]);
  const x = linear(window, [box.left, box.left + box.width]);
  const y = linear([0, padded(inside.map(value))[1]], [box.top + box.height, box.top]);
  let content = "";
  let piece = [];
  const colourOf = (regime) => (regime === "stable" ? colours.accent : regime === "saddle" ? colours.soft : colours.hopf);
  points.forEach((p, k) => {
    piece.push(p);
    const next = points[k + 1];
    if (!next || next.cut || next.regime !== p.regime) {
      if (next && !next.cut) piece.push(next);
      const path = pathOf(piece.map((q) => x(q.detuning / 1e9)), piece.map((q) => y(value(q))), { sorted: false });
      const dash = p.regime === "stable" ? "" : p.regime === "saddle" ? "2 4" : "7 3";
      content += `<path d="${path}" fill="none" stroke="${colourOf(p.regime)}" stroke-width="2.1" stroke-dasharray="${dash}"/>`;
      piece = [];
    }
  });
  content += jumps(points, x, y, value, colours);
  content += `<path d="M${x(state.detuning)} ${box.top}V${box.top + box.height}" stroke="${colours.ink}" stroke-opacity=".35"/>`;
  for (const p of states) content += `<circle cx="${x(state.detuning)}" cy="${y(value(p)).toFixed(1)}" r="4.5" fill="${p.regime === "stable" ? colours.ink : colours.ground}" stroke="${colours.ink}" stroke-width="1.6"/>`;
  let text = panel(box, { scale: x, label: "Detuning (GHz)" }, { scale: y, label: drop > 0 ? "Drop (mW)" : "Energy (fJ)" }, content, colours);
  const entries = [{ name: "stable", colour: colours.accent }, { name: "pulses", colour: colours.hopf, dash: "7 3" }, { name: "saddle", colour: colours.soft, dash: "2 4" }];
  text += legend(entries, box.left, height - 6, box.width, colours).text;
  return svgOf(width, height, text, colours, "Fixed points against detuning at the present power, with the jumps of a slow sweep");
}

/** Vertical lines where a slow sweep leaves a branch: the turning points of the detuning along the curve. */
function jumps(points, x, y, value, colours) {
  let out = "";
  for (let k = 1; k + 1 < points.length; k++) {
    const before = points[k].detuning - points[k - 1].detuning;
    const after = points[k + 1].detuning - points[k].detuning;
    if (before * after >= 0 || points[k].cut || points[k + 1].cut) continue;
    const here = points[k];
    let target = null;
    for (let j = 1; j < points.length; j++) {
      if (Math.abs(j - k) < 3) continue;
      const [a, b] = [points[j - 1], points[j]];
      if ((a.detuning - here.detuning) * (b.detuning - here.detuning) <= 0 && a.regime !== "saddle" && !b.cut) target = b;
    }
    if (target) out += `<path d="M${x(here.detuning / 1e9).toFixed(1)} ${y(value(here)).toFixed(1)}V${y(value(target)).toFixed(1)}" stroke="${colours.ink}" stroke-width="1.2" stroke-dasharray="1 3"/>`;
  }
  return out;
}
