// Figures as SVG text: axes from d3-scale, lines thinned to what pixels show, colours of the present theme.

const CATEGORICAL = { light: ["#0072b2", "#d55e00", "#007a5a", "#a2557f", "#8a6d00", "#4a4f57"], dark: ["#56b4e9", "#ee8a4a", "#2fbf95", "#d99bbd", "#d9b84a", "#b3bac4"] };
const THEMES = {
  light: { ink: "#1d2329", soft: "#59626d", line: "#d9dee4", ground: "#ffffff", stable: "#dbe7f0", bistable: "#b9cfe0", pulsing: "#f6c9a0", accent: "#0072b2", warm: "#b04a00", hopf: "#a33c00", fold: "#005a8c", folds: "#7a3e9d" },
  dark: { ink: "#e8ecf0", soft: "#a5afba", line: "#39424c", ground: "#171b20", stable: "#22303c", bistable: "#36506a", pulsing: "#7a4a1e", accent: "#56b4e9", warm: "#f0a060", hopf: "#ffb27d", fold: "#8cc8f0", folds: "#d0a5ea" },
};

/** Colours of the theme that is in force. */
export function theme() {
  const chosen = document.documentElement.dataset.theme;
  const dark = chosen ? chosen === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
  const name = dark ? "dark" : "light";
  return { ...THEMES[name], name, series: CATEGORICAL[name] };
}

export function escaped(text) {
  return String(text).replace(/[&<>"']/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#39;" })[c]);
}

const n1 = (x) => (Math.round(x * 10) / 10).toString();

/** The path of a line, at most four points for each column of pixels where x increases. */
export function pathOf(xs, ys, { sorted = true } = {}) {
  let out = "";
  let pen = "M";
  const put = (x, y) => {
    out += `${pen}${n1(x)} ${n1(y)}`;
    pen = "L";
  };
  if (!sorted || xs.length < 1500) {
    for (let i = 0; i < xs.length; i++) {
      if (Number.isFinite(xs[i]) && Number.isFinite(ys[i])) put(xs[i], ys[i]);
      else pen = "M";
    }
    return out;
  }
  for (let i = 0; i < xs.length; ) {
    const column = Math.floor(xs[i]);
    let low = i;
    let high = i;
    let j = i;
    for (; j < xs.length && Math.floor(xs[j]) === column; j++) {
      if (ys[j] < ys[low]) low = j;
      if (ys[j] > ys[high]) high = j;
    }
    for (const k of [...new Set([i, Math.min(low, high), Math.max(low, high), j - 1])]) put(xs[k], ys[k]);
    i = j;
  }
  return out;
}

/** Label of a tick of a logarithmic time axis: 10 ns, 1 us. */
export function timeLabel(seconds) {
  const units = [[1e-12, "ps"], [1e-9, "ns"], [1e-6, "µs"], [1e-3, "ms"], [1, "s"]]; // prettier-ignore
  const [size, unit] = units.reduce((best, u) => (seconds >= 0.999 * u[0] ? u : best));
  return `${Number((seconds / size).toPrecision(3))} ${unit}`;
}

/** Powers of ten within the domain of a logarithmic scale, with fewer where they would crowd. */
function decades([low, high], width) {
  const out = [];
  const first = Math.ceil(Math.log10(low) - 1e-9);
  const last = Math.floor(Math.log10(high) + 1e-9);
  const every = Math.max(1, Math.ceil(((last - first + 1) * 48) / width));
  for (let k = first; k <= last; k += every) out.push(10 ** k);
  return out;
}

/**
 * One set of axes. box: { left, top, width, height }; x and y: { scale, label, log, format, ticks, hidden }.
 * content is SVG text in the coordinates of the figure, clipped to the box.
 */
export function panel(box, x, y, content, colours) {
  const { left, top, width, height } = box;
  const wanted = (size, per) => Math.max(2, Math.floor(size / per));
  const ticksOf = (axis, size, per) => (axis.log ? decades(axis.scale.domain(), size) : axis.scale.ticks(wanted(size, per)));
  const format = (axis, size, per) => (axis.log ? timeLabel : axis.scale.tickFormat(wanted(size, per)));
  let out = "";
  const bottom = top + height;
  const text = `font-size="11.5" fill="${colours.soft}"`;
  const fx = format(x, width, 70);
  for (const v of ticksOf(x, width, 70)) {
    const at = n1(x.scale(v));
    out += `<path d="M${at} ${top}V${bottom}" stroke="${colours.line}"/>`;
    const anchor = x.scale(v) > left + width - 12 ? "end" : "middle"; // what would be cut off at the right
    if (!x.hidden) out += `<text x="${anchor === "end" ? Math.min(at, left + width + 12) : at}" y="${bottom + 15}" text-anchor="${anchor}" ${text}>${escaped(fx(v))}</text>`;
  }
  const fy = format(y, height, 27);
  for (const v of ticksOf(y, height, 27)) {
    const at = n1(y.scale(v));
    out += `<path d="M${left} ${at}H${left + width}" stroke="${colours.line}"/>`;
    out += `<text x="${left - 6}" y="${n1(y.scale(v) + 4)}" text-anchor="end" ${text}>${escaped(fy(v))}</text>`;
  }
  out += `<svg x="${left}" y="${top}" width="${width}" height="${height}" viewBox="${left} ${top} ${width} ${height}">${content}</svg>`;
  out += `<path d="M${left} ${top}V${bottom}H${left + width}" fill="none" stroke="${colours.soft}"/>`;
  if (x.label && !x.hidden) out += `<text x="${left + width / 2}" y="${bottom + 33}" text-anchor="middle" font-size="12.5" fill="${colours.ink}">${escaped(x.label)}</text>`;
  if (y.label) out += `<text transform="translate(${left - 44} ${top + height / 2}) rotate(-90)" text-anchor="middle" font-size="12.5" fill="${colours.ink}">${escaped(y.label)}</text>`;
  return out;
}

/** A whole figure as SVG text. */
export function svgOf(width, height, content, colours, label) {
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img" ` +
    `aria-label="${escaped(label)}" font-family="system-ui, -apple-system, 'Segoe UI', Roboto, Helvetica, Arial, sans-serif">` +
    `<rect width="${width}" height="${height}" fill="${colours.ground}"/>${content}</svg>`
  );
}

/** How many rows a legend takes in a width. */
export function legendRows(names, width) {
  let [rows, x] = [1, 0];
  for (const name of names) {
    const size = 30 + 6.4 * name.length;
    if (x > 0 && x + size > width) [rows, x] = [rows + 1, 0];
    x += size;
  }
  return rows;
}

/** A line with a legend below the axes is named here: [{ name, colour, dash }] as SVG text, wrapped. */
export function legend(entries, left, top, width, colours) {
  let x = left;
  let y = top;
  let out = "";
  for (const { name, colour, dash = "", mark = "line" } of entries) {
    const size = 30 + 6.4 * name.length;
    if (x > left && x + size > left + width) {
      x = left;
      y += 17;
    }
    out += mark === "dot" ? `<circle cx="${x + 9}" cy="${y - 4}" r="3.5" fill="none" stroke="${colour}" stroke-width="1.5"/>` : mark === "box" ? `<rect x="${x + 2}" y="${y - 10}" width="14" height="11" fill="${colour}" stroke="${colours.line}"/>` : `<path d="M${x} ${y - 4}h18" stroke="${colour}" stroke-width="2.2" stroke-dasharray="${dash}"/>`;
    out += `<text x="${x + 23}" y="${y}" font-size="11.5" fill="${colours.ink}">${escaped(name)}</text>`;
    x += size;
  }
  return { text: out, bottom: y };
}
