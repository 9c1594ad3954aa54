// The figures of heat: step response, time constants, period error.

import { boxOf, curve, dot, figure, legendPlaces, stroke } from "./plot.mjs";
import { periodError, stepResponse } from "./heat.mjs";

function geometric(low, high, n) {
  return Float64Array.from({ length: n }, (_, k) => low * (high / low) ** (k / (n - 1)));
}

export const sumOf = (values) => values.reduce((sum, x) => sum + x, 0);

/** From a tenth of the fastest to eight times the slowest time constant that matters, s. */
function timeSpan(models) {
  const seen = models.flatMap(({ R, tau }) => tau.filter((_, i) => R[i] >= 1e-3 * sumOf(R)));
  return [Math.min(...seen) / 10, Math.max(...seen) * 8];
}

const colourOf = (k, colours) => colours.series[k % colours.series.length];

/** A figure with one panel, and the names of all models below it. */
function withNames(width, height, { across, up, models, extra = [], zoom, label }, colours, draw) {
  const entries = [...models.map(({ name, place }) => ({ name, colour: colourOf(place, colours) })), ...extra];
  const box = boxOf(width, height, { bottom: 40 + 17 * legendPlaces(entries, boxOf(width, height).width).rows });
  const fig = figure(width, height, colours, zoom);
  fig.panel(box, { log: true, time: true, ...across }, up, (x, y) => draw(x, y, box));
  fig.legend(entries, box);
  return fig.done(label);
}

/** models: { name, R, tau, place } with the place that gives the colour; chosen: the place of the present one. */
export function stepFigure(width, height, { models, chosen, reference, kept, zoom }, colours) {
  const times = geometric(...timeSpan(models), 160);
  const extra = reference ? [{ name: reference.name, colour: colours.ink, mark: "dot" }] : [];
  const across = { domain: [times[0], times.at(-1)], label: "Time after the step" };
  const top = Math.max(...[...models, ...(kept ? [kept.model] : [])].map((m) => sumOf(m.R))) / 1e3;
  const present = models.find((m) => m.place === chosen);
  const up = { domain: [0, 1.06 * top], label: "Rise (K/mW)", read: (t) => stepResponse(present, [t])[0] / 1e3 };
  const label = "Step response of every compact model";
  return withNames(width, height, { across, up, models, extra, zoom, label }, colours, (x, y) => {
    const line = (model, ...look) => stroke(curve(x, y, times, stepResponse(model, times).map((v) => v / 1e3)), ...look); // prettier-ignore
    let content = kept ? line(kept.model, colours.soft, 1.4, "5 3") : "";
    for (const model of models) content += line(model, colourOf(model.place, colours), model.place === chosen ? 2.8 : 1.6);
    return content + (reference ? reference.times.map((t, k) => dot(x(t), y(reference.rise[k] / 1e3), 3, "none", colours.ink)).join("") : "");
  });
}

const nowLine = (period, x, box, colours) => (period > 0 ? `<path d="M${x(period)} ${box.top}v${box.height}" stroke="${colours.ink}" stroke-dasharray="4 4" stroke-opacity=".6"/>` : "");

export function spectrumFigure(width, height, { models, chosen, period, zoom }, colours) {
  const across = { domain: timeSpan(models), label: "Time constant τᵢ" };
  const up = { domain: [0, (1.08 * Math.max(...models.flatMap((m) => m.R))) / 1e3], label: "Rᵢ (K/mW)" };
  const label = "Time constants and thermal resistances of every compact model";
  return withNames(width, height, { across, up, models, zoom, label }, colours, (x, y, box) => {
    const onTop = [...models].sort((a, b) => (a.place === chosen) - (b.place === chosen));
    const poles = onTop.flatMap(({ R, tau, place }) => {
      const [colour, heavy] = [colourOf(place, colours), place === chosen];
      return tau.map((t, i) => stroke(`M${x(t)} ${y(0)}V${y(R[i] / 1e3)}`, colour, heavy ? 2.4 : 1.2) + dot(x(t), y(R[i] / 1e3), heavy ? 4 : 2.6, colour, "none"));
    });
    return poles.join("") + nowLine(period, x, box, colours);
  });
}

/** Period errors in percent of every model but the judge; the figure, and the errors at the present period. */
export function errorFigure(width, height, { models, judge, chosen, period, duty, zoom }, colours) {
  const others = models.filter((m) => m !== judge);
  const errors = (model, periods) => periodError(model, judge, periods, 2e-3, duty);
  const across = { domain: [1e-7, 1e-5], label: "Period" };
  const periods = geometric(...across.domain, 41);
  const up = { domain: [-60, 60], label: "Period error (%)" };
  const label = `Error of the period that each model gives, against ${judge.name}`;
  const made = withNames(width, height, { across, up, models: others, zoom, label }, colours, (x, y, box) => {
    const band = `<rect x="${box.left}" y="${y(10)}" width="${box.width}" height="${y(-10) - y(10)}" fill="${colours.stable}"/><path d="M${box.left} ${y(0)}h${box.width}" stroke="${colours.soft}"/>`;
    const lines = others.map((model) => {
      const percent = errors(model, periods).map((e) => Math.max(-500, Math.min(500, 100 * e)));
      return stroke(curve(x, y, periods, percent), colourOf(model.place, colours), model.place === chosen ? 2.8 : 1.6);
    });
    return band + lines.join("") + nowLine(period, x, box, colours);
  });
  return { ...made, now: period > 0 ? others.map((m) => ({ name: m.name, error: errors(m, [period])[0] })) : [] };
}
