// The laser on the plane: dragged with the pointer, moved with the arrow keys.

import { takeAll } from "./fields.mjs";
import { toPicometres } from "./ring.mjs";
import { ringOf, watts, windowOf } from "./state.mjs";
import { $, page, shown } from "./view.mjs";

export function watchPlane() {
  const target = $("plane");
  const under = (event) => {
    const rect = target.querySelector("svg").getBoundingClientRect();
    const { x, y, box } = shown.plane;
    const clamp = (v, low, size) => Math.min(Math.max(v, low), low + size);
    const nu = x.invert(clamp(event.clientX - rect.left, box.left, box.width));
    const level = y.invert(clamp(event.clientY - rect.top, box.top, box.height));
    return { detuning: Number(nu.toFixed(2)), power: Number(level.toFixed(3)) };
  };
  const move = (event) => takeAll(under(event));
  const point = ({ detuning, power }) => {
    const picometres = -toPicometres(detuning, ringOf(page.state, page.data));
    $("pointed").textContent = `Under the pointer: ${power.toFixed(2)} dBm = ${(1e3 * watts(power)).toPrecision(3)} mW, ${detuning.toFixed(1)} GHz = ${picometres.toFixed(0)} pm from the cold resonance.`;
  };
  target.addEventListener("pointerdown", (event) => {
    target.setPointerCapture(event.pointerId);
    move(event);
    target.focus({ preventScroll: true });
    event.preventDefault();
  });
  target.addEventListener("pointermove", (event) => shown.plane && point(under(event)));
  target.addEventListener("pointermove", (event) => event.buttons && target.hasPointerCapture(event.pointerId) && move(event));
  target.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!steps) return;
    event.preventDefault();
    const window = windowOf(page.state, page.data);
    const fine = event.shiftKey ? 500 : 100;
    const moved = (name, k) => Number((page.state[name] + (steps[k] * (window[name][1] - window[name][0])) / fine).toPrecision(8));
    takeAll({ detuning: moved("detuning", 0), power: moved("power", 1) });
  });
}
