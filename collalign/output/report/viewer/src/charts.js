// The cophenetic tree and the cycle histogram.

import { el, number, responsive, select, svg, table } from "./dom.js";
import { labelColors } from "./shape_map.js";

const ROW = 15;
const WIDE_TREE = { width: 900, names: 230 };
const NARROW_TREE = { width: 380, names: 190 };

// Linkage rows (left, right, height) over n leaves in drawing order.
function branches(linkage, order, length) {
  const high = Math.max(...linkage.map(([, , height]) => height)) || 1;
  const nodes = new Map(order.map((leaf, row) => [leaf, { x: 0, y: (row + 0.5) * ROW }]));
  const place = (height) => 4 + (1 - height / high) * (length - 8);
  return linkage.map(([left, right, height], at) => {
    const [a, b] = [nodes.get(left), nodes.get(right)];
    nodes.set(order.length + at, { x: height, y: (a.y + b.y) / 2 });
    return `M${place(a.x).toFixed(1)} ${a.y.toFixed(1)}H${place(height).toFixed(1)}V${b.y.toFixed(1)}H${place(b.x).toFixed(1)}`;
  });
}

export function treeSection(app) {
  const { map, shapes, labels, categories: columns } = app.collection;
  if (!map.tree) return [el("p", null, map.problem ?? "A tree needs at least two shapes.")];
  const { linkage, order, correlation } = map.tree;
  const picture = el("div", { class: "picture scroll", tabindex: 0, role: "region", "aria-label": "Tree of shapes" });
  let column = columns[0] ?? "";
  const draw = ({ width, names: room }) => {
    const values = map.members.map((index) => (column ? labels[column][index] : ""));
    const { color } = labelColors(values);
    const names = order.flatMap((leaf, row) => {
      const [x, y] = [width - room, (row + 0.5) * ROW];
      const mark = app.collection.mark(map.members[leaf]);
      const text = [shapes[map.members[leaf]].name, values[leaf], mark].filter(Boolean).join(" · ");
      const tip = values[leaf] ? [svg("circle", { cx: x + 2, cy: y, r: 5, fill: color(values[leaf]) })] : [];
      return [...tip, svg("text", { x: x + 11, y: y + 4, class: mark && "doubtful" }, text)];
    });
    return [svg("svg", { class: "tree", viewBox: `0 0 ${width} ${order.length * ROW}`, role: "img", "aria-label": `Tree of ${order.length} shapes` },
      svg("path", { d: branches(linkage, order, width - room).join("") }), ...names)];
  };
  const show = responsive(picture, (narrow) => draw(narrow ? NARROW_TREE : WIDE_TREE));
  return [
    el("p", { class: "muted" }, `Average linkage (UPGMA) of the Procrustes distances; cophenetic correlation ${number(correlation)}.`),
    columns.length ? el("div", { class: "row tools" }, select("Colour by", [...columns.map((key) => [key, key]), ["", "nothing"]], (key) => { column = key; show(); }, column)) : "",
    picture,
  ];
}

function histogram({ edges, counts, words }, [width, height, most]) {
  const top = Math.max(...counts);
  const step = width / counts.length;
  const bars = counts.map((count, at) => {
    const tall = (count / top) * (height - 12);
    return svg("g", null, svg("title", null, `${edges[at]}° to ${edges[at + 1]}°: ${count}`),
      svg("rect", { x: at * step + 1, y: height - tall, width: step - 2, height: tall }));
  });
  const every = Math.ceil(counts.length / most);
  const ticks = edges.map((edge, at) => (at % every ? null : svg("text", { x: Math.min(width - 14, Math.max(8, at * step)), y: height + 18, "text-anchor": "middle" }, `${edge}°`)));
  return svg("svg", { class: "histogram", viewBox: `0 0 ${width} ${height + 34}`, role: "img", "aria-label": `Histogram of cycle errors. ${words}` }, ...bars, ...ticks.filter(Boolean));
}

export function cycleSection(app) {
  const { edges, counts, words } = app.collection.cycles;
  if (!counts.length) return [el("p", null, words)];
  const picture = el("div");
  responsive(picture, (narrow) => [histogram(app.collection.cycles, narrow ? [380, 220, 6] : [900, 240, 12])]);
  const rows = counts.map((count, at) => [`${edges[at]}° to ${edges[at + 1]}°`, String(count)]);
  return [
    el("p", null, words),
    picture,
    el("details", null, el("summary", null, "As a table"), table("Cycle errors", ["Angle", "Cycles"], rows)),
  ];
}
