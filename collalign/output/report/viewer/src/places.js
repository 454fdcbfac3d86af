// Maps of all vertices: every shape in the colours of the reference's places, and in those of how sure they are.

import { VIRIDIS_CSS } from "./colors.js";
import { button, el } from "./dom.js";
import { after, percent } from "./layers.js";

function picture(app, at, label, look) {
  const canvas = el("canvas", { role: "img", "aria-label": `${app.collection.shapes[at].name}, coloured by ${label}` });
  const tile = app.stage.add(canvas, () => [after(app, at, look)], { fitted: true });
  app.corrections.onchange(() => app.stage.refresh(tile));
  return canvas;
}

export function placesSection(app) {
  const { places, shapes } = app.collection;
  const cards = [];
  places.forEach((place, at) => {
    if (place === null) return;
    const { name } = shapes[at];
    const { mesh, sure } = place;
    const pictures = [picture(app, at, "correspondence", { mesh })];
    const words = el("figcaption", null, button(name, () => app.openShape(at), { class: "link" }));
    if (sure !== null) {
      pictures.push(picture(app, at, "confidence", { mesh, values: true }));
      words.append(el("span", { class: "muted" }, ` ${percent(sure)}`));
    }
    cards.push(el("li", { class: "card" }, el("figure", null, ...pictures, words)));
  });
  const without = shapes.filter((_, at) => places[at] === null).map(({ name }) => name);
  const parts = [el("p", { class: "muted" }, "Equal colours are corresponding places. Grey has no counterpart. Check shapes on which the colours run differently.")];
  if (places.some((place) => place && place.sure !== null)) {
    const ramp = el("span", { class: "ramp", style: `background:${VIRIDIS_CSS}` });
    parts.push(el("div", { class: "legend" }, "0", ramp, "1", el("span", { class: "muted" }, "probability that a place is right, within 10 % of the square root of the area. The number is the expected share of such places")));
  }
  if (without.length) parts.push(el("p", null, `No maps: ${without.join(", ")}.`));
  return [...parts, el("ul", { class: "gallery small" }, ...cards)];
}
