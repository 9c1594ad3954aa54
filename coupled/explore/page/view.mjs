// What the modules of the page share: its data and state, and what the figures show.

export const $ = (id) => document.getElementById(id);

/** data: what the file holds; state: what the fields hold; changed: asks for the answers to a new state. */
export const page = { data: null, state: null, changed: () => {} };

/** Everything the figures show; answers fill it as they come. */
export const shown = { trace: null, states: [], ring: null, map: null, curves: { folds: [], hopf: [] }, points: [], plane: null, phase: 0, section: null };


const widths = new Map();

/** The width that a figure has, in pixels; read once, because a figure just put has to be laid out for it. */
export function widthOf(id) {
  if (!widths.has(id)) widths.set(id, Math.max(280, Math.min(760, $(id).clientWidth || 400)));
  return widths.get(id);
}

/** Read the widths anew. */
export const resized = () => widths.clear();

export function put(id, svg) {
  $(id).innerHTML = svg;
}
