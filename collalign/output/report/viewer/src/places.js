// Maps of all vertices: every shape in the colours of the reference's places.

import { button, el } from "./dom.js";
import { after } from "./layers.js";

export function placesSection(app) {
  const { places, shapes } = app.collection;
  const cards = [];
  places.forEach((mesh, at) => {
    if (mesh === null) return;
    const { name } = shapes[at];
    const canvas = el("canvas", { role: "img", "aria-label": `${name}, coloured by correspondence` });
    const tile = app.stage.add(canvas, () => [after(app, at, { mesh })], { fitted: true });
    app.corrections.onchange(() => app.stage.refresh(tile));
    cards.push(el("li", { class: "card" }, el("figure", null, canvas, el("figcaption", null, button(name, () => app.openShape(at), { class: "link" })))));
  });
  const without = shapes.filter((_, at) => places[at] === null).map(({ name }) => name);
  const parts = [el("p", { class: "muted" }, "Equal colours are corresponding places, grey has no counterpart: where colours run in another way than on the other shapes, look twice.")];
  if (without.length) parts.push(el("p", null, `No maps: ${without.join(", ")}.`));
  return [...parts, el("ul", { class: "gallery small" }, ...cards)];
}
