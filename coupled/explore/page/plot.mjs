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

/** Text as it may stand in markup. */
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

/** The path of samples (u, v) in scales. */
export const curve = (x, y, u, v, options = { sorted: false }) => pathOf(Float64Array.from(u, x), Float64Array.from(v, y), options);

/** A line as SVG text. */
export function stroke(path, colour, width = 1.6, dash = "") {
  return `<path d="${path}" fill="none" stroke="${colour}" stroke-width="${width}" stroke-dasharray="${dash}" stroke-linejoin="round"/>`;
}

/** A dot as SVG text. */
export function dot(x, y, r, fill, line) {
  return `<circle cx="${n1(x)}" cy="${n1(y)}" r="${r}" fill="${fill}" stroke="${line}" stroke-width="1.6"/>`;
}

/** A time with its unit: 10 ns, 1 us. */
export function timeLabel(seconds) {
  const units = [[1e-12, "ps"], [1e-9, "ns"], [1e-6, "µs"], [1e-3, "ms"], [1, "s"]]; // prettier-ignore
  const [size, unit] = units.reduce((best, u) => (seconds >= 0.999 * u[0] ? u : best));
  return `${Number((seconds / size).toPrecision(3))} ${unit}`;
}

/** Ticks of an axis over `size` pixels, [value, text]: of a logarithmic one powers of ten, or round numbers within a decade. */
function ticksOf({ scale, log, time }, size, per) {
  const count = Math.max(2, Math.floor(size / per));
  const [low, high] = [Math.min(...scale.domain()), Math.max(...scale.domain())];
  if (!log || high < 10 * low) return scale.ticks(count).map((v) => [v, time ? timeLabel(v) : log ? String(Number(v.toPrecision(3))) : scale.tickFormat(count)(v)]);
  const [first, last] = [Math.ceil(Math.log10(low) - 1e-9), Math.floor(Math.log10(high) + 1e-9)];
  const every = time ? Math.max(1, Math.ceil(((last - first + 1) * 48) / size)) : 1;
  const steps = time || last - first > 2 ? [1] : [1, 2, 5];
  const out = [];
  for (let k = first - 1; k <= last; k += every) for (const step of steps) out.push(Number((step * 10 ** k).toPrecision(1)));
  return out.filter((v) => v >= 0.999 * low && v <= 1.001 * high).map((v) => [v, time ? timeLabel(v) : String(v)]);
}

const SMALL = 11.5;
const words = (at, size, colour, text, anchor = "start") => `<text ${at} text-anchor="${anchor}" font-size="${size}" fill="${colour}">${escaped(text)}</text>`;

/** Axes around the content of a panel { box, x, y }, which is clipped to the box. */
function panelText({ box, x, y }, content, colours) {
  const { left, top, width, height } = box;
  const [bottom, right] = [top + height, left + width];
  let out = "";
  for (const [v, text] of ticksOf(x, width, 70)) {
    const at = n1(x.scale(v));
    out += `<path d="M${at} ${top}V${bottom}" stroke="${colours.line}"/>`;
    const cut = at > right - 12; // at the right edge of the figure
    if (!x.hidden) out += words(`x="${cut ? Math.min(at, right + 12) : at}" y="${bottom + 15}"`, SMALL, colours.soft, text, cut ? "end" : "middle");
  }
  for (const [v, text] of ticksOf(y, height, 27)) {
    const at = n1(y.scale(v));
    out += `<path d="M${left} ${at}H${right}" stroke="${colours.line}"/>${words(`x="${left - 6}" y="${n1(y.scale(v) + 4)}"`, SMALL, colours.soft, text, "end")}`;
  }
  out += `<svg x="${left}" y="${top}" width="${width}" height="${height}" viewBox="${left} ${top} ${width} ${height}">${content}</svg>`;
  out += `<path d="M${left} ${top}V${bottom}H${right}" fill="none" stroke="${colours.soft}"/>`;
  if (!x.hidden) out += words(`x="${left + width / 2}" y="${bottom + 33}"`, 12.5, colours.ink, x.label, "middle");
  return out + words(`transform="translate(${left - 44} ${top + height / 2}) rotate(-90)"`, 12.5, colours.ink, y.label, "middle");
}

/** Where the entries [{ name, colour, dash, mark }] of a legend stand in a width, [dx, row], and how many rows they take. */
export function legendPlaces(entries, width) {
  let [x, row] = [0, 0];
  const places = entries.map(({ name }) => {
    const size = 30 + 6.4 * name.length;
    if (x > 0 && x + size > width) [x, row] = [0, row + 1];
    x += size;
    return [x - size, row];
  });
  return { places, rows: row + 1 };
}

function legendText(entries, left, top, width, colours) {
  const { places } = legendPlaces(entries, width);
  const each = ({ name, colour, dash = "", mark = "line" }, k) => {
    const [x, y] = [left + places[k][0], top + 17 * places[k][1]];
    const box = `<rect x="${x + 2}" y="${y - 10}" width="14" height="11" fill="${colour}" stroke="${colours.line}"/>`;
    const sign = { dot: dot(x + 9, y - 4, 3.5, "none", colour), box, line: stroke(`M${x} ${y - 4}h18`, colour, 2.2, dash) }[mark];
    return sign + words(`x="${x + 23}" y="${y}"`, SMALL, colours.ink, name);
  };
  return entries.map(each).join("");
}

const LEFT = 58;
const RIGHT = 14;

/** Room for axes in a figure. */
export function boxOf(width, height, { top = 10, bottom = 42 } = {}) {
  return { left: LEFT, top, width: width - LEFT - RIGHT, height: height - top - bottom };
}

/**
 * A figure in the making. panel(box, x, y, draw) adds axes { domain, label, log, time, hidden, read } and what draw(x, y)
 * gives in their scales; legend and text add more; done(label) returns { svg, panels }. `zoom` { x, y, panel } replaces the
 * domains of the axes along x, and of that panel along y.
 */
export function figure(width, height, colours, zoom = null) {
  const panels = [];
  let out = "";
  const scaleOf = (axis, domain, range) => ({ ...axis, scale: (axis.log ? d3.scaleLog : d3.scaleLinear)(domain, range) });
  return {
    panel(box, across, up, draw) {
      const x = scaleOf(across, zoom ? zoom.x : across.domain, [box.left, box.left + box.width]);
      const y = scaleOf(up, zoom && zoom.panel === panels.length ? zoom.y : up.domain, [box.top + box.height, box.top]);
      panels.push({ box, x, y });
      out += panelText({ box, x, y }, draw(x.scale, y.scale), colours);
    },
    legend(entries, box, below = 52) {
      out += legendText(entries, box.left, box.top + box.height + below, box.width, colours);
    },
    text(svg) {
      out += svg;
    },
    done(label) {
      const svg =
        `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img" ` +
        `aria-label="${escaped(label)}" font-family="system-ui, -apple-system, 'Segoe UI', Roboto, Helvetica, Arial, sans-serif">` +
        `<rect width="${width}" height="${height}" fill="${colours.ground}"/>${out}</svg>`;
      return { svg, panels };
    },
  };
}
