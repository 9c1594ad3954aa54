// The sentence above the figures.

import { $, page, shown } from "./view.mjs";

let spoken = "";
let speaking = 0;

/** The sentence above the figures; read aloud when it has stood for half a second. */
export function say(text) {
  $("summary").textContent = text;
  clearTimeout(speaking);
  speaking = setTimeout(() => {
    if (text === spoken) return;
    spoken = text;
    $("spoken").textContent = text;
  }, 500);
}

/** What the ring does, in words. */
export function summary() {
  const { trace, states } = shown;
  if (!trace) return "Computing…";
  const stable = states.filter((p) => p.regime === "stable").length;
  const found = trace.pulsing;
  const cycle = trace.request.settled && trace.cycle;
  const points = `${states.length} fixed point${states.length === 1 ? "" : "s"}, ${stable} stable`;
  if (found.regime === "self-pulsing") {
    const now = cycle || found;
    const what = cycle ? "Self-pulsing, settled cycle" : `Self-pulsing, last cycle of ${page.state.duration} µs`;
    const memory = cycle ? ` A deviation shrinks to ${(100 * cycle.slowest).toPrecision(3)} % in one cycle.` : "";
    const none = trace.request.settled && !cycle ? " No stable cycle was found near it: the pulses may not repeat." : "";
    return `${what}: period ${now.period.toPrecision(5)} ns, duty ${now.duty.toFixed(3)}, temperature swing ${now.swing.toPrecision(4)} K. ${points}.${memory}${none}`;
  }
  const rest = states.find((p) => p.regime === "stable");
  const at = (rise) => ` at ΔT = ${rise.toPrecision(4)} K`;
  if (found.regime === "stable") return `The ring comes to rest${at(found.rest)}. ${points}.`;
  if (found.heat) return `${warmingUp(found)} ${points}.`;
  if (found.leaves !== undefined) return `After ${page.state.duration} µs the nearest fixed point,${at(found.leaves)}, is not stable: run longer to see where the ring goes. ${points}.`;
  const where = stable === 1 ? at(rest.delta_T) : "";
  return `Still moving after ${page.state.duration} µs: run longer to see whether it ${rest ? "comes to rest" : "pulses"}. ${points}${where}.`;
}

/** How far slow heat still has to go, and how long that takes. */
function warmingUp({ heat, wanted }) {
  const [now, end, missing] = [heat.now, heat.end, Math.abs(heat.end - heat.now)].map((rise) => `${rise.toPrecision(3)} K`);
  const microseconds = Number((wanted * 1e-3).toPrecision(2));
  return `After ${page.state.duration} µs slow heat still moves the ring: ΔT = ${now}, ${missing} from the fixed point at ΔT = ${end}. It rests there after some ${microseconds} µs.`;
}
