// What is taken along: scripts, links, traces and figures.

import { stretch } from "./paint.mjs";
import { DENSITY, FJ, NS, UW, absorbedPower, dropRate, systemOf } from "./ring.mjs";
import { saveFigure, saveTrace } from "./save.mjs";
import { commandOf, pythonOf } from "./script.mjs";
import { hashOf, modelOf, ringOf } from "./state.mjs";
import { $, page } from "./view.mjs";

/** Buttons of the group "Take along", and those that save figures. */
export function watchButtons() {
  $("python").addEventListener("click", () => copy(pythonOf(page.state, page.data), "Python script"));
  $("command").addEventListener("click", () => copy(commandOf(page.state, page.data), "Command line"));
  $("link").addEventListener("click", () => copy(`${address()}#${hashOf(page.state)}`, "Link"));
  for (const button of document.querySelectorAll("button[data-save]")) {
    button.addEventListener("click", () => {
      const [id, kind] = button.dataset.save.split(" ");
      if (kind === "csv") saveTrace(traceTable());
      else saveFigure($(id).querySelector("svg"), `${id}.${kind}`, kind);
    });
  }
}

/** Where the page lies; inside a report or a notebook it has no address of its own. */
function address() {
  return ["file:", "http:", "https:"].includes(location.protocol) ? location.href.split("#")[0] : "ring.html";
}

async function copy(text, what) {
  $("copied-text").value = text;
  $("copied").hidden = false;
  try {
    await navigator.clipboard.writeText(text);
    $("copied-note").textContent = `${what} copied. It stands below as well.`;
  } catch {
    $("copied-note").textContent = `${what}: select and copy it below.`;
    $("copied-text").focus();
    $("copied-text").select();
  }
}

/** The trace that is shown, SI, with the fields of coupled.simulate. */
function traceTable() {
  const { t, U, N, dT } = stretch();
  const ring = ringOf(page.state, page.data);
  const system = systemOf(ring, modelOf(page.state, page.data));
  const rows = ["time_s,energy_J,carriers_per_m3,delta_T_K,drop_W,absorbed_W"];
  for (let i = 0; i < t.length; i++) {
    const drop = 2 * dropRate(ring) * NS * U[i] * UW;
    rows.push([t[i] * NS, U[i] * FJ, N[i] * DENSITY, dT[i], drop, absorbedPower(U[i], N[i], system) * UW].join(","));
  }
  return `${rows.join("\n")}\n`;
}
