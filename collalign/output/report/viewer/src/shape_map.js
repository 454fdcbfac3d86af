// Scatter of the shapes by Procrustes distance, coloured by a label. One stop for the tab key; arrow keys walk from shape to shape.

import { categorical } from "./colors.js";
import { el, responsive, select, svg } from "./dom.js";
import { namesBeside } from "./names.js";

const MARGIN = 46;
const WIDE = [900, 560];
const NARROW = [380, 420];

export function labelColors(values) {
  const kinds = [...new Set(values)].filter(Boolean).sort();
  return { kinds, color: (value) => (value ? categorical(kinds.indexOf(value)) : "var(--muted)") };
}

function scaler(points, [width, height]) {
  const bounds = [0, 1].map((axis) => [Math.min(...points.map((p) => p[axis])), Math.max(...points.map((p) => p[axis]))]);
  const unit = Math.min(...bounds.map(([low, high], axis) => ([width, height][axis] - 2 * MARGIN) / (high - low || 1)));
  const middle = bounds.map(([low, high]) => (low + high) / 2);
  return ([x, y]) => [width / 2 + (x - middle[0]) * unit, height / 2 - (y - middle[1]) * unit];
}

// The closest point in the direction of the arrow, sideways distance counting double.
function neighbour(places, from, [dx, dy]) {
  let [best, nearest] = [from, Infinity];
  places.forEach(([x, y], at) => {
    const [ahead, aside] = [(x - places[from][0]) * dx + (y - places[from][1]) * dy, Math.abs((x - places[from][0]) * dy) + Math.abs((y - places[from][1]) * dx)];
    if (at !== from && ahead > 0 && ahead + 2 * aside < nearest) [best, nearest] = [at, ahead + 2 * aside];
  });
  return best;
}

function scatter(app, column, size) {
  const [width, height] = size;
  const { members, axes, points } = app.collection.map;
  const { shapes, labels } = app.collection;
  const values = members.map((index) => (column ? labels[column][index] : ""));
  const { color } = labelColors(values);
  const place = scaler(points, size);
  const places = points.map(place);
  const names = members.map((index) => (app.collection.mark(index) ? `${shapes[index].name} ?` : shapes[index].name));
  const beside = namesBeside(places, names, size);
  const dots = places.map(([x, y], at) => {
    const shape = shapes[members[at]];
    const name = [shape.name, values[at]].filter(Boolean).join(", ");
    const mark = app.collection.mark(members[at]);
    const fill = column ? color(values[at]) : "var(--accent)";
    return svg("g", { class: ["dot", mark && "doubtful", beside[at].crowded && "crowded"].filter(Boolean).join(" "), role: "button", tabindex: at ? -1 : 0, "aria-label": [name, mark].filter(Boolean).join(", "), transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})` },
      svg("title", null, [name, mark].filter(Boolean).join(", ")), svg("circle", { r: 6, fill }), svg("text", beside[at].text, names[at]));
  });
  const focus = (at) => {
    dots.forEach((dot, other) => dot.setAttribute("tabindex", other === at ? 0 : -1));
    dots[at].focus();
  };
  const keys = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  dots.forEach((dot, at) => {
    dot.addEventListener("click", () => app.openShape(members[at]));
    dot.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") app.openShape(members[at]);
      else if (keys[event.key]) focus(neighbour(places, at, keys[event.key]));
      else return;
      event.preventDefault();
    });
  });
  const titles = [svg("text", { x: width / 2, y: height - 8, "text-anchor": "middle", class: "axis" }, axes[0]),
    svg("text", { x: 14, y: height / 2, "text-anchor": "middle", class: "axis", transform: `rotate(-90 14 ${height / 2})` }, axes[1])];
  return svg("svg", { class: "map", viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": `Shape map, ${members.length} shapes` }, ...titles, ...dots);
}

function legend(app, column) {
  const { kinds, color } = labelColors(app.collection.map.members.map((index) => app.collection.labels[column][index]));
  const items = kinds.map((kind) => el("li", { class: "chip" }, el("span", { class: "dot", style: `background:${color(kind)}` }), kind));
  return el("ul", { class: "chips", "aria-label": `Colours of ${column}` }, ...items);
}

export function mapSection(app) {
  const { collection } = app;
  const { map, categories: columns } = collection;
  if (!map.members) return [el("p", null, map.problem), surfacesNote()];
  let column = columns[0] ?? "";
  const picture = el("div", { class: "picture" });
  const show = responsive(picture, (narrow) => [scatter(app, column, narrow ? NARROW : WIDE), column && legend(app, column)]);
  return [
    el("div", { class: "row tools" },
      columns.length ? select("Colour by", [...columns.map((key) => [key, key]), ["", "nothing"]], (key) => { column = key; show(); }, column) : "",
      el("span", { class: "muted" }, map.words)),
    picture,
    surfacesNote(),
  ];
}

// A file cannot see whether the page that another command writes is there: a link to it might lead nowhere.
function surfacesNote() {
  return el("p", null, "Run ", el("code", null, "collalign variation FOLDER"),
    " to write variation/variation.html next to this report; FOLDER is the folder of this page. It has whole surfaces in correspondence. It shows components that deform the mean surface, group means, each specimen compared with the mean, left and right, and numbered landmarks.");
}
