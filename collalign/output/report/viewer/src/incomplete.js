// Shapes of which parts are missing: what of each has a counterpart on the others, and what they have of a complete one.

import { button, el, table } from "./dom.js";
import { VIRIDIS_CSS } from "./colors.js";
import { after, percent } from "./layers.js";

function share(value) {
  return value === null ? "unknown" : percent(value);
}

function figure(app, parent, caption, layers) {
  const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": `${caption}; arrow keys rotate, plus and minus zoom` });
  parent.append(el("figure", null, canvas, el("figcaption", null, caption)));
  const tile = app.stage.add(canvas, layers, { zoomable: true, fitted: true });
  app.corrections.onchange(() => app.stage.refresh(tile));
}

function overlapTable(app, { shape, partners, overlaps }) {
  const { shapes } = app.collection;
  const rows = partners.map((partner, at) => {
    const open = app.collection.pairAt(shape, partner) < 0 ? shapes[partner].name : button(shapes[partner].name, () => app.openPair(shape, partner), { class: "link" });
    return [open, share(overlaps[at][0]), share(overlaps[at][1])];
  });
  const head = ["Posed on", "Of it covered", `Of ${shapes[shape].name} found there`];
  return el("details", null, el("summary", null, `Overlap with ${partners.length} shapes`), table(`Overlaps of ${shapes[shape].name}`, head, rows));
}

function entry(app, one) {
  const { name } = app.collection.shapes[one.shape];
  const row = el("div", { class: "figures" });
  if (one.own) figure(app, row, `${name}, what the others have too`, () => [after(app, one.shape, { mesh: one.own })]);
  const words = `Covers ${share(one.coverage)} of the shapes that it was posed on; ${one.points[0]} of ${one.points[1]} corresponding points are there. Incomplete: ${one.reason}.`;
  return el("div", { class: "entry" }, el("h3", null, button(name, () => app.openShape(one.shape), { class: "link" })), el("p", null, words), row, overlapTable(app, one));
}

function legend() {
  return el("div", { class: "legend" }, "none", el("span", { class: "ramp", style: `background:${VIRIDIS_CSS}` }), "all", el("span", { class: "muted" }, "have a counterpart of the place"));
}

export function incompleteSection(app) {
  const { shapes, drawn } = app.collection.incomplete;
  const intro = "Colours say how many of the shapes that an incomplete one was posed on have a counterpart of each place.";
  const parts = [el("p", { class: "muted" }, intro), legend()];
  if (drawn < shapes.length) parts.push(el("p", null, `The ${drawn} that cover least are drawn.`));
  return [...parts, el("div", { class: "entries" }, ...shapes.map((one) => entry(app, one)))];
}

// How far two shapes overlap, in words; empty where neither is incomplete or they were not posed on each other.
export function overlapInWords({ incomplete, shapes }, i, j) {
  for (const [own, other] of [[i, j], [j, i]]) {
    const one = incomplete.shapes?.find(({ shape }) => shape === own);
    const at = one ? one.partners.indexOf(other) : -1;
    if (at >= 0) return `Of ${shapes[other].name}, ${share(one.overlaps[at][0])} has a counterpart on ${shapes[own].name}; the other way round ${share(one.overlaps[at][1])}.`;
  }
  return "";
}
