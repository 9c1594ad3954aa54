// The figures of heat: step response, time constants, period error, cross-section with the field.

import { legend, legendRows, panel, pathOf, svgOf } from "./plot.mjs";
import { boxOf, linear, logarithmic } from "./figures.mjs";
import { periodError, stepResponse } from "./heat.mjs";

function geometric(low, high, n) {
  return Float64Array.from({ length: n }, (_, k) => low * (high / low) ** (k / (n - 1)));
}

/** From a tenth of the fastest to ten times the slowest time constant that matters, s. */
export function timeSpan(models) {
  let low = Infinity;
  let high = 0;
  for (const { R, tau } of models) {
    const total = R.reduce((a, b) => a + b, 0);
    tau.forEach((t, i) => {
      if (R[i] < 1e-3 * total) return;
      low = Math.min(low, t);
      high = Math.max(high, t);
    });
  }
  return [low / 10, high * 8];
}

/** The box of a figure with the names of all models below. */
function below(width, height, models) {
  const rows = legendRows(models.map((m) => m.name), boxOf(width, height).width);
  return boxOf(width, height, { bottom: 40 + 17 * rows });
}

export function stepFigure(width, height, { models, chosen, reference }, colours) {
  const box = below(width, height, [...models, ...(reference ? [reference] : [])]);
  const times = geometric(...timeSpan(models), 160);
  const x = logarithmic([times[0], times[times.length - 1]], [box.left, box.left + box.width]);
  const top = Math.max(...models.map((m) => m.R.reduce((a, b) => a + b, 0))) / 1e3;
  const y = linear([0, 1.06 * top], [box.top + box.height, box.top]);
  const entries = [];
  let content = "";
  models.forEach((model, k) => {
    const colour = colours.series[k % colours.series.length];
    const path = pathOf(times.map((t) => x(t)), stepResponse(model, times).map((v) => y(v / 1e3)), { sorted: false });
    content += `<path d="${path}" fill="none" stroke="${colour}" stroke-width="${k === chosen ? 2.8 : 1.6}"/>`;
    entries.push({ name: model.name, colour });
  });
  if (reference) {
    reference.times.forEach((t, k) => {
      content += `<circle cx="${x(t).toFixed(1)}" cy="${y(reference.rise[k] / 1e3).toFixed(1)}" r="3" fill="none" stroke="${colours.ink}" stroke-width="1.2"/>`;
    });
    entries.push({ name: reference.name, colour: colours.ink, mark: "dot" });
  }
  let text = panel(box, { scale: x, label: "Time after the step", log: true }, { scale: y, label: "Rise (K/mW)" }, content, colours);
  text += legend(entries, box.left, box.top + box.height + 52, box.width, colours).text;
  return svgOf(width, height, text, colours, "Step response of every compact model");
}

export function spectrumFigure(width, height, { models, chosen, period }, colours) {
  const box = below(width, height, models);
  const [low, high] = timeSpan(models);
  const x = logarithmic([low, high], [box.left, box.left + box.width]);
  const y = linear([0, 1.08 * Math.max(...models.flatMap((m) => m.R)) / 1e3], [box.top + box.height, box.top]);
  let content = "";
  const order = models.map((_, k) => k).sort((a, b) => (a === chosen) - (b === chosen));
  for (const k of order) {
    const colour = colours.series[k % colours.series.length];
    const heavy = k === chosen;
    models[k].tau.forEach((tau, i) => {
      const at = x(tau).toFixed(1);
      const top = y(models[k].R[i] / 1e3).toFixed(1);
      content += `<path d="M${at} ${y(0)}V${top}" stroke="${colour}" stroke-width="${heavy ? 2.4 : 1.2}"/><circle cx="${at}" cy="${top}" r="${heavy ? 4 : 2.6}" fill="${colour}"/>`;
    });
  }
  if (period > 0) content += `<path d="M${x(period).toFixed(1)} ${box.top}V${box.top + box.height}" stroke="${colours.ink}" stroke-dasharray="4 4" stroke-opacity=".6"/>`;
  let text = panel(box, { scale: x, label: "Time constant τᵢ", log: true }, { scale: y, label: "Rᵢ (K/mW)" }, content, colours);
  text += legend(models.map((m, k) => ({ name: m.name, colour: colours.series[k % colours.series.length] })), box.left, box.top + box.height + 52, box.width, colours).text;
  return svgOf(width, height, text, colours, "Time constants and thermal resistances of every compact model");
}

/** Period errors in percent of every model but the reference; returns the SVG, and the errors at the present period. */
export function errorFigure(width, height, { models, judge, chosen, period, duty }, colours) {
  const others = models.map((m, k) => ({ ...m, k })).filter((m) => m.k !== judge);
  const box = below(width, height, others);
  const periods = geometric(1e-7, 1e-5, 41);
  const x = logarithmic([1e-7, 1e-5], [box.left, box.left + box.width]);
  const y = linear([-60, 60], [box.top + box.height, box.top]);
  let content = `<rect x="${box.left}" y="${y(10)}" width="${box.width}" height="${y(-10) - y(10)}" fill="${colours.stable}"/><path d="M${box.left} ${y(0)}h${box.width}" stroke="${colours.soft}"/>`;
  for (const model of others) {
    const errors = periodError(model, models[judge], periods, 2e-3, duty);
    const path = pathOf(periods.map((t) => x(t)), errors.map((e) => y(Math.max(-500, Math.min(500, 100 * e)))), { sorted: false });
    content += `<path d="${path}" fill="none" stroke="${colours.series[model.k % colours.series.length]}" stroke-width="${model.k === chosen ? 2.8 : 1.6}"/>`;
  }
  if (period > 0) content += `<path d="M${x(period).toFixed(1)} ${box.top}V${box.top + box.height}" stroke="${colours.ink}" stroke-dasharray="4 4" stroke-opacity=".6"/>`;
  let text = panel(box, { scale: x, label: "Period", log: true }, { scale: y, label: "Period error (%)" }, content, colours);
  text += legend(others.map((m) => ({ name: m.name, colour: colours.series[m.k % colours.series.length] })), box.left, box.top + box.height + 52, box.width, colours).text;
  const now = period > 0 ? others.map((m) => ({ name: m.name, error: periodError(m, models[judge], [period], 2e-3, duty)[0] })) : [];
  return { svg: svgOf(width, height, text, colours, `Error of the period that each model gives, against ${models[judge].name}`), now };
}

// from cool to hot: lightness falls (light theme) or rises (dark theme) throughout
const RAMPS = { light: ["#ffffff", "#fee8c8", "#fdbb84", "#e34a33", "#7f0000"], dark: ["#171b20", "#4a1c1c", "#a33c1c", "#f08a3c", "#fff0c0"] };

/** The image of a field on the grid of the section, as a data URL; `top` is the rise of the hottest colour. */
export function fieldImage(section, field, top, colours) {
  const canvas = document.createElement("canvas");
  canvas.width = section.width;
  canvas.height = section.height;
  const context = canvas.getContext("2d");
  const image = context.createImageData(section.width, section.height);
  const ramp = d3.scaleLinear([0, 0.25, 0.5, 0.75, 1], RAMPS[colours.name]).clamp(true);
  const table = Array.from({ length: 256 }, (_, k) => ramp(k / 255).match(/\d+/g).map(Number));
  for (let i = 0; i < section.height; i++) {
    for (let j = 0; j < section.width; j++) {
      const value = field[(section.height - 1 - i) * section.width + j];
      const [r, g, b] = table[Math.max(0, Math.min(255, Math.round((255 * value) / top)))];
      image.data.set([r, g, b, 255], 4 * (i * section.width + j));
    }
  }
  context.putImageData(image, 0, 0);
  return canvas.toDataURL("image/png");
}

export function sectionFigure(width, { section, image, top }, colours) {
  const { r, z } = section;
  const inner = width - 72;
  const high = (inner * (z[1] - z[0])) / (r[1] - r[0]);
  const box = { left: 58, top: 10, width: inner, height: high };
  const x = linear([r[0] * 1e6, r[1] * 1e6], [box.left, box.left + inner]);
  const y = linear([z[0] * 1e6, z[1] * 1e6], [box.top + high, box.top]);
  let content = image ? `<image href="${image}" x="${box.left}" y="${box.top}" width="${inner}" height="${high}" preserveAspectRatio="none"/>` : "";
  for (const outline of section.outlines) {
    const path = outline.map(([u, v], k) => `${k ? "L" : "M"}${x(u * 1e6).toFixed(1)} ${y(v * 1e6).toFixed(1)}`).join("");
    content += `<path d="${path}Z" fill="none" stroke="${colours.ink}" stroke-opacity=".7"/>`;
  }
  let text = panel(box, { scale: x, label: "Radius (µm)" }, { scale: y, label: "Height (µm)" }, content, colours);
  const bar = box.top + high + 46;
  const ramp = RAMPS[colours.name].map((c, k) => `<stop offset="${25 * k}%" stop-color="${c}"/>`).join("");
  text += `<defs><linearGradient id="heat">${ramp}</linearGradient></defs><rect x="${box.left + 40}" y="${bar}" width="${inner - 130}" height="9" fill="url(#heat)" stroke="${colours.line}"/>`;
  text += `<text x="${box.left + 34}" y="${bar + 9}" text-anchor="end" font-size="11.5" fill="${colours.soft}">0 K</text><text x="${box.left + inner - 84}" y="${bar + 9}" font-size="11.5" fill="${colours.soft}">${top.toFixed(1)} K</text>`;
  return svgOf(width, bar + 18, text, colours, "Cross-section of the ring, to scale, with the temperature rise");
}
