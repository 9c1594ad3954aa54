// What is taken along: scripts, links, traces and figures; and a setting that is kept to compare with.

import { draw, dropNow, stretch } from "./paint.mjs";
import { DENSITY, FJ, NS, UW, absorbedPower, dropRate, systemOf } from "./ring.mjs";
import { commandOf, pythonOf } from "./script.mjs";
import { hashOf, modelOf, ringOf } from "./state.mjs";
import { $, page, shown } from "./view.mjs";

/** Buttons of the group "Take along", those that save figures, and the one that keeps a setting. */
export function watchButtons() {
  $("python").addEventListener("click", () => copy(pythonOf(page.state, page.data), "Python script"));
  $("command").addEventListener("click", () => copy(commandOf(page.state, page.data), "Command line"));
  $("link").addEventListener("click", () => copy(`${address()}#${hashOf(page.state)}`, "Link"));
  $("keep").addEventListener("click", keep);
  for (const { id } of document.querySelectorAll(".plot")) {
    const kinds = id === "traces" ? ["svg", "png", "csv"] : ["svg", "png"];
    const button = (kind) => `<button type="button" data-save="${id} ${kind}" aria-label="Save ${id} as ${kind.toUpperCase()}">${kind.toUpperCase()}</button>`;
    $(id).closest("figure").insertAdjacentHTML("beforeend", `<div class="save">${kinds.map(button).join("")}</div>`);
  }
  for (const button of document.querySelectorAll("button[data-save]")) {
    const [id, kind] = button.dataset.save.split(" ");
    button.addEventListener("click", () => (kind === "csv" ? download(traceTable(), "trace.csv", "text/csv") : saveFigure($(id).querySelector("svg"), `${id}.${kind}`, kind)));
  }
}

/** Keep what is shown, to compare it with other settings, or forget it. */
function keep() {
  const { state, data } = page;
  const kept = shown.kept ? null : { now: stretch(), points: shown.points, drop: dropNow(), model: modelOf(state, data), state };
  shown.kept = kept && kept.now ? kept : null;
  $("keep").textContent = shown.kept ? "Forget the kept setting" : "Keep to compare";
  $("kept").textContent = shown.kept ? `Kept (grey, dashed): ${$("numbers").textContent} ${$("summary").textContent}` : "";
  draw();
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
  const row = (time, i) => [time * NS, U[i] * FJ, N[i] * DENSITY, dT[i], 2 * dropRate(ring) * NS * U[i] * UW, absorbedPower(U[i], N[i], system) * UW].join(",");
  return `${["time_s,energy_J,carriers_per_m3,delta_T_K,drop_W,absorbed_W", ...Array.from(t, row)].join("\n")}\n`;
}

function download(content, name, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** An SVG as it stands, or as a PNG of twice its size. */
function saveFigure(svg, name, kind) {
  const text = new XMLSerializer().serializeToString(svg);
  if (kind === "svg") {
    download(text, name, "image/svg+xml");
    return;
  }
  const image = new Image();
  image.onload = () => {
    const canvas = Object.assign(document.createElement("canvas"), { width: 2 * image.width, height: 2 * image.height });
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.toBlob((blob) => download(blob, name, "image/png"), "image/png");
  };
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
}
