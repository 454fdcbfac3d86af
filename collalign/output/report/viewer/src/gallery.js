// All shapes, before and after, turning together.

import { button, el, select } from "./dom.js";
import { after, before, percent } from "./layers.js";

export function meter(app, index) {
  const shape = app.collection.shapes[index];
  if (shape.alone) return el("span", { class: "meter-text" }, "–");
  const doubtful = app.collection.isDoubtful(index);
  return el(
    "span",
    { class: doubtful ? "meter doubtful" : "meter" },
    el("span", { class: "bar", "aria-hidden": "true" }, el("span", { style: `width:${(100 * shape.confidence).toFixed(1)}%` })),
    el("span", { class: "meter-text" }, percent(shape.confidence)),
  );
}

export function confidenceInWords(shape) {
  return shape.alone ? "alone of its kind" : `confidence ${percent(shape.confidence)}`;
}

export function tags(app, index) {
  const shape = app.collection.shapes[index];
  const words = [];
  if (shape.alone) words.push(["alone of its kind", ""]);
  if (app.collection.isDoubtful(index)) words.push(["doubtful", "warn"]);
  if (shape.reflected) words.push(["reflected", ""]);
  if (shape.coverage !== null) words.push([`incomplete, covers ${percent(shape.coverage)}`, ""]);
  if (shape.extra) words.push([`extra material towards ${shape.extra.side}, ${percent(shape.extra.share)}`, ""]);
  if (app.collection.mark(index) === "not surely joined") words.push(["not surely joined", "warn"]);
  if (app.collection.numParts > 1) words.push([`part ${shape.part + 1}`, ""]);
  const { evidence } = shape.byHand ?? {};
  if (evidence !== undefined && evidence !== null && evidence < app.collection.doubtThreshold) {
    words.push([`the evidence alone gives ${percent(evidence)}`, "warn"]);
  }
  if (shape.byHand && app.corrections.poseOf(index) === null) words.push(["decision taken back", "warn"]);
  const decided = app.corrections.words(index);
  if (decided) words.push([decided, "good"]);
  return words.map(([text, kind]) => el("span", { class: `tag ${kind}` }, text));
}

function card(app, index) {
  const { stage, corrections, collection } = app;
  const shape = collection.shapes[index];
  const canvases = [el("canvas", { "aria-hidden": "true" }), el("canvas", { "aria-hidden": "true" })];
  const label = `${shape.name}, ${confidenceInWords(shape)}, before and after; open the shape`;
  const tile = button("", () => app.openShape(index), { class: "tile", "aria-label": label });
  tile.append(...canvases);
  stage.add(canvases[0], () => [before(app, index)], { handle: tile });
  const right = stage.add(canvases[1], () => [after(app, index, { points: app.showPoints && collection.pointColors, ...(shape.extra && { mesh: shape.extra.mesh }) })], { handle: null, fitted: true });
  app.galleryTiles.push(right);
  const box = el("input", { type: "checkbox", onchange: (event) => app.overlay.toggle(index, event.target.checked) });
  app.overlay.onchange((chosen) => (box.checked = chosen.has(index)));
  const out = el("input", { type: "checkbox", checked: corrections.leftOut.has(shape.name), onchange: () => corrections.leaveOut(index, out.checked) });
  const marks = el("span", { class: "tags" }, ...tags(app, index));
  corrections.onchange((changed) => {
    if (changed !== index) return;
    out.checked = corrections.leftOut.has(shape.name);
    marks.replaceChildren(...tags(app, index));
    stage.refresh(right);
  });
  const name = button(shape.name, () => app.openShape(index), { class: "link name", title: shape.file });
  const foot = el("div", { class: "row" }, meter(app, index), el("label", { class: "check" }, box, "overlay"), el("label", { class: "check" }, out, "leave out"));
  return el("li", { class: "card", "data-name": shape.name.toLowerCase(), "data-index": index }, tile, name, foot, marks);
}

export function gallerySection(app) {
  const { shapes, labels, categories } = app.collection;
  const [wide, high] = app.stage.extent;
  const list = el("ul", { class: "gallery", style: `--aspect:${Math.min(2, wide / high).toFixed(2)}` });
  const shown = el("span", { role: "status", class: "muted" });
  const cards = shapes.map((_, index) => card(app, index));
  const ranks = [];
  app.collection.byDoubt.forEach((index, rank) => { ranks[index] = rank; });
  const orders = {
    doubt: (a, b) => ranks[a] - ranks[b],
    name: (a, b) => shapes[a].name.localeCompare(shapes[b].name, "en", { numeric: true }),
  };
  for (const column of categories) orders[`label ${column}`] = (a, b) => labels[column][a].localeCompare(labels[column][b]);
  const order = (key) => list.append(...[...cards].sort((a, b) => orders[key](+a.dataset.index, +b.dataset.index)));
  const filter = (text) => {
    cards.forEach((one) => (one.hidden = !one.dataset.name.includes(text.trim().toLowerCase())));
    const visible = cards.filter((one) => !one.hidden).length;
    shown.textContent = visible === cards.length ? `${visible} shapes` : `${visible} of ${cards.length} shapes`;
  };
  const search = el("input", { type: "search", oninput: (event) => filter(event.target.value), placeholder: "part of a name" });
  const choices = [["doubt", "most doubtful first"], ["name", "name"], ...categories.map((column) => [`label ${column}`, column])];
  const points = el("input", { type: "checkbox", onchange: (event) => {
    app.showPoints = event.target.checked;
    app.galleryTiles.forEach((tile) => app.stage.refresh(tile));
  } });
  order("doubt");
  filter("");
  return [
    el("p", { class: "muted" }, "Grey: as in the file. Bone: aligned. Drag a shape, or use the arrow keys, to rotate all of them. Click it, or press Enter, to open it. Corresponding points carry the same colour on every shape."),
    el("div", { class: "row tools" }, el("label", { class: "field" }, el("span", null, "Find"), search), select("Order by", choices, order, "doubt"), el("label", { class: "check" }, points, "corresponding points"), shown),
    list,
  ];
}
