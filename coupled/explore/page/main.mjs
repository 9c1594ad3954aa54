// The page: its parts put together, requests sent out and answers shown.

import { foldCurves, hopfCurves } from "./curves.mjs";
import { limitCycle } from "./cycle.mjs";
import { eigenvalues } from "./eigen.mjs";
import { channel, engineOf, serve } from "./engine.mjs";
import { steadyStates, survey } from "./equilibria.mjs";
import { build, fill, watchFigures, watchPlane } from "./fields.mjs";
import { integrate, loadKernel } from "./kernel.mjs";
import { draw, recolour, say, summary } from "./paint.mjs";
import { theme } from "./plot.mjs";
import { classify, columns } from "./pulsing.mjs";
import { cold, driveOf, heatedBy, setting, systemOf, turnOf } from "./ring.mjs";
import { decoded, drawSection, play } from "./section.mjs";
import { addFields, hashOf, inSight, modelOf, page, planeWindow, resized, ringOf, shown, stateOf, watchSight, watts, windowOf } from "./state.mjs";
import { watchButtons } from "./take.mjs";
import { fluctuation } from "./thermal.mjs";

let ask = {};
const LOOK_EVERY = 150; // ms between two traces from cold while a slider moves and the settled cycle is followed
let timer = 0;
let lookedAt = -Infinity;

function start() {
  if (!Array.prototype.at || !globalThis.structuredClone || !globalThis.ResizeObserver || !globalThis.WebAssembly) return; // older than 2023: the notice stays
  const data = JSON.parse($("data").textContent);
  data.section = data.section && decoded(data.section);
  addFields(data);
  page.data = data;
  page.changed = changed;
  const code = $("code").textContent;
  ask = {
    trace: channel(code, data.kernel, gotTrace),
    light: channel(code, data.kernel, gotLight),
    plane: channel(code, data.kernel, gotPlane, { preempt: true }),
  };
  $("notice").remove();
  $("page").hidden = false;
  $("title").textContent = document.title = data.title;
  $("section-figure").hidden = !data.section;
  $("error-figure").hidden = data.judge === null || data.models.length < 2;
  build();
  watchPlane();
  watchFigures();
  watchButtons();
  watchView();
  restore(location.hash);
  addEventListener("hashchange", (event) => restore(new URL(event.newURL).hash));
}

/** The state of a link, or of the file; what a link holds and cannot be taken is said until something is moved. */
function restore(hash) {
  const { state, refused } = stateOf(hash, page.data.start, page.data);
  page.state = state;
  fill();
  $("link-problem").textContent = refused.length ? `Not taken from the link: ${refused.join(" ")}` : "";
  changed({ ring: true });
}

/** What changes how the figures look, not what they show. */
function watchView() {
  const narrow = matchMedia("(max-width: 56rem)");
  $("more").open = !narrow.matches;
  narrow.addEventListener("change", () => ($("more").open = !narrow.matches));
  $("phase").addEventListener("input", () => {
    shown.phase = Number($("phase").value);
    drawSection();
  });
  $("play").addEventListener("click", play);
  $("theme").addEventListener("click", () => {
    document.documentElement.dataset.theme = theme().name === "dark" ? "light" : "dark";
    recolour();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => recolour());
  new ResizeObserver(() => {
    resized();
    draw();
  }).observe($("page"));
  watchSight(draw);
}

/** Ask for everything that depends on what has changed: rough at once, exact when the slider rests. */
function changed({ ring = false }) {
  const { data, state } = page;
  const light = { ring: ringOf(state, data), model: modelOf(state, data), power: watts(state.power), detuning: state.detuning * 1e9 };
  const trace = { ...light, kind: "trace", duration: state.duration * 1e-6, settled: state.view === "cycle" };
  if (ring) {
    if (shown.ring !== state.ring) Object.assign(shown, { ring: state.ring, map: null, curves: { folds: [], hopf: [] }, zoom: {} });
    const window = planeWindow(state, data);
    const sizes = [[24, 24], [60, 60], [140, 140]]; // prettier-ignore
    ask.plane({ ...light, kind: "plane", window, powers: window.power.map(watts), detunings: window.detuning.map((x) => x * 1e9), sizes });
  }
  shown.moving = true;
  const points = { ...light, kind: "light", detunings: windowOf(state, data, 2.5).detuning.map((x) => x * 1e9) };
  const curve = inSight("transmission");
  ask.trace({ ...trace, rtol: 1e-5, quick: true, follow: performance.now() - lookedAt < LOOK_EVERY });
  ask.light({ ...points, curve });
  clearTimeout(timer);
  timer = setTimeout(() => {
    if (!curve) ask.light(points);
    ask.trace({ ...trace, rtol: 1e-6, quick: false });
    try {
      history.replaceState(null, "", `#${hashOf(page.state)}`);
    } catch {
      // a page inside a notebook has no address of its own; its link is still copied
    }
  }, 180);
  draw();
}

function gotTrace(answer, request) {
  shown.moving = request.quick;
  if (answer.error) return say(`This setting cannot be integrated: ${answer.error}.`);
  shown.trace = { ...answer, request };
  shown.section = null;
  if (!answer.followed) lookedAt = performance.now();
  say(summary());
  draw();
  return undefined;
}

function gotLight(answer) {
  if (answer.error) return;
  shown.states = answer.states;
  shown.points = answer.points || shown.points;
  say(summary());
  draw();
}

function gotPlane(part, { window }) {
  if (!part || part.error) return;
  if (part.kind === "map") shown.map = { ...part, window, image: null };
  else shown.curves = part;
  draw();
}

// for tests, and for whoever wants to compute in the console
globalThis.ringPage = { classify, columns, eigenvalues, engineOf, fluctuation, foldCurves, hopfCurves, integrate, limitCycle, loadKernel, steadyStates, survey, systemOf, cold, setting, heatedBy, driveOf, turnOf, state: () => ({ ...page.state }), shown }; // prettier-ignore

if (typeof document === "undefined") serve(globalThis);
else if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
else start();

