// What the modules of the page share: its data and state, and what the figures show.

export const $ = (id) => document.getElementById(id);

/** data: what the file holds; state: what the fields hold; changed: asks for the answers to a new state. */
export const page = { data: null, state: null, changed: () => {} };

/**
 * Everything the figures show; answers fill it as they come. moving: whether the exact answer to the state is still to come.
 * kept: a setting to compare with. zoom: by figure, what is zoomed in to. panels: by figure, its axes.
 */
export const shown = { moving: false, trace: null, states: [], ring: null, map: null, curves: { folds: [], hopf: [] }, points: [], plane: null, phase: 0, section: null, kept: null, zoom: {}, panels: {} };

const widths = new Map();

/** The width that a figure has, in pixels; read once, because a figure just put has to be laid out for it. */
export function widthOf(id) {
  if (!widths.has(id)) widths.set(id, Math.max(280, Math.min(760, $(id).clientWidth || 400)));
  return widths.get(id);
}

/** Read the widths anew. */
export const resized = () => widths.clear();

const standing = new Map();

/** Show a figure { svg, panels }, unless it is there already. */
export function put(id, { svg, panels }) {
  shown.panels[id] = panels;
  if (standing.get(id) === svg) return;
  standing.set(id, svg);
  $(id).innerHTML = svg;
}

const inWindow = new Set();

/** Whether a figure lies within the window. */
export const inSight = (id) => inWindow.has(id);

/** Watch which figures lie within the window; `draw` is called when one comes or goes. */
export function watchSight(draw) {
  const sight = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) inWindow[isIntersecting ? "add" : "delete"](target.id);
    draw();
  });
  for (const plot of document.querySelectorAll(".plot")) sight.observe(plot);
}
