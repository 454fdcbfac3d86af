// Builds the page from the embedded data. Every part stands alone: one that fails says so and leaves the others.

import { Collection } from "./data.js";
import { Corrections, correctionBar } from "./corrections.js";
import { Overlay, overlaySection } from "./overlay.js";
import { Stage } from "./stage.js";
import { button, el } from "./dom.js";
import { cycleSection, treeSection } from "./charts.js";
import { doubtSection } from "./doubt.js";
import { excludedSection, runSection } from "./tables.js";
import { gallerySection } from "./gallery.js";
import { incompleteSection } from "./incomplete.js";
import { startLandmarks } from "./landmarks.js";
import { mapSection } from "./shape_map.js";
import { pairDialog, shapeDialog } from "./dialogs.js";
import { pairsSection } from "./matrix.js";
import { placesSection } from "./places.js";
import { VARIATION_SECTIONS } from "./variation.js";
import { loadVariation } from "./variation_data.js";

const SECTIONS = [
  ["excluded", "Left out", excludedSection],
  ["gallery", "Gallery", gallerySection],
  ["overlay", "Overlay", overlaySection],
  ["confidence", "Confidence", doubtSection],
  ["incomplete", "Incomplete shapes", incompleteSection],
  ["places", "Maps of vertices", placesSection],
  ["pairs", "Pairs", pairsSection],
  ["map", "Shape map", mapSection],
  ["tree", "Tree", treeSection],
  ["cycles", "Cycle consistency", cycleSection],
  ["run", "This run", runSection],
];
// Sections that are closed at first.
const FOLDED = new Set(["tree", "cycles", "run"]);

function themeButton() {
  const themes = ["auto", "light", "dark"];
  let at = 0;
  const change = () => {
    at = (at + 1) % themes.length;
    if (at) document.documentElement.dataset.theme = themes[at];
    else delete document.documentElement.dataset.theme;
    box.textContent = `Theme: ${themes[at]}`;
  };
  const box = button("Theme: auto", change, { id: "theme" });
  return box;
}

function spinButton(stage) {
  const box = button("Spin", () => {
    stage.spin(!stage.spinning);
    box.setAttribute("aria-pressed", String(stage.spinning));
  }, { id: "spin", "aria-pressed": "false" });
  return box;
}

function build(sections, app, main) {
  for (const [id, title, make] of sections) {
    const heading = el("h2", { id: `${id}-title` }, title);
    const body = FOLDED.has(id) ? el("details", null, el("summary", null, heading)) : el("div", null, heading);
    main.append(el("section", { id, "aria-labelledby": heading.id }, body));
    try {
      body.append(...make(app));
    } catch (error) {
      console.error(error);
      body.append(el("p", { class: "problem" }, `This part could not be shown (${error.message}). The other parts are complete.`));
    }
  }
}

// In a frame that has no address of its own a link to a part of the page would open the page around the frame.
function keepInFrame() {
  if (location.protocol !== "about:") return;
  addEventListener("click", (event) => {
    const to = event.target.closest?.("a[href^='#']")?.getAttribute("href").slice(1);
    if (!to) return;
    event.preventDefault();
    document.getElementById(to)?.scrollIntoView();
  });
}

async function start() {
  keepInFrame();
  const collection = new Collection();
  const main = document.querySelector("main");
  const nav = document.querySelector("nav");
  if (collection.kind === "variation") await startVariation(collection, main, nav);
  else if (collection.kind === "landmarks") startLandmarkPage(collection, main, nav);
  else await startReport(collection, main, nav);
  document.documentElement.dataset.ready = "yes";
}

async function startVariation(collection, main, nav) {
  const stage = new Stage(collection);
  const app = { collection, stage, variation: await loadVariation(collection) };
  furnish(VARIATION_SECTIONS, app, main, nav);
}

function startLandmarkPage(collection, main, nav) {
  const app = { collection, stage: new Stage(collection) };
  startLandmarks(app, main, (sections) => furnish(sections, app, main, nav));
  openByName(app);
}

// Names at the top of a page open their shape.
function openByName(app) {
  const opens = (box) => box.addEventListener("click", () => app.openShape(app.collection.shapes.findIndex(({ name }) => name === box.dataset.shape)));
  document.querySelectorAll("[data-shape]").forEach(opens);
}

async function startReport(collection, main, nav) {
  await collection.loadPairs();
  const stage = new Stage(collection);
  const app = { collection, stage, corrections: new Corrections(collection), overlay: new Overlay(collection), galleryTiles: [], showPoints: false };
  app.openPair = pairDialog(app);
  app.openShape = shapeDialog(app);
  const absent = { excluded: !collection.excluded.length, incomplete: !collection.incomplete.shapes, places: !collection.places.length };
  const sections = SECTIONS.filter(([id]) => !absent[id]);
  furnish(sections, app, main, nav);
  main.append(correctionBar(app.corrections, collection));
  openByName(app);
  app.overlay.set(app.overlay.presets()[0][2]);
}

// The line at the top and all sections.
function furnish(sections, app, main, nav) {
  const { stage } = app;
  const unfold = (id) => document.querySelector(`#${id} > details`)?.setAttribute("open", "");
  addEventListener("beforeprint", () => FOLDED.forEach(unfold));
  nav.append(...sections.map(([id, title]) => el("a", { href: `#${id}`, onclick: () => unfold(id) }, title)), el("span", { class: "push" }), button("Reset view", () => stage.resetView()), spinButton(stage), themeButton());
  if (!stage.works) {
    main.append(el("p", { class: "problem", role: "alert" }, "This browser offers no WebGL, so shapes cannot be drawn; tables and charts are complete. Another browser, or hardware acceleration in the settings, will show them."));
  }
  build(sections, app, main);
}

start().catch((error) => {
  console.error(error);
  const text = `The report could not be opened (${error.message}). It needs a browser of 2023 or later; if the file was sent, it may be cut short.`;
  document.querySelector("main").append(el("p", { class: "problem", role: "alert" }, text));
});
