// Scatter of the specimens on any two components, with hulls or ellipses around groups.

import { categorical } from "./colors.js";
import { button, el, responsive, select, svg } from "./dom.js";
import { saveSvg } from "./downloads.js";

const MARGIN = 48;
const WIDE = [900, 560];
const NARROW = [380, 420];
//: Radius of an ellipse in standard deviations: 95 % of a normal distribution in the plane.
const ELLIPSE = Math.sqrt(5.991);

// Corners of the convex hull, by Andrew's monotone chain.
export function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const chain = (list) => {
    const out = [];
    for (const point of list) {
      while (out.length > 1 && cross(out.at(-2), out.at(-1), point) <= 0) out.pop();
      out.push(point);
    }
    return out.slice(0, -1);
  };
  return [...chain(sorted), ...chain(sorted.reverse())];
}

function cross([ax, ay], [bx, by], [cx, cy]) {
  return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
}

// Points of the ellipse that covers 95 % of a normal distribution like these.
export function ellipse(points) {
  const mean = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
  const moment = (a, b) => points.reduce((sum, point) => sum + (point[a] - mean[a]) * (point[b] - mean[b]), 0) / (points.length - 1);
  const [xx, xy, yy] = [moment(0, 0), moment(0, 1), moment(1, 1)];
  const turn = 0.5 * Math.atan2(2 * xy, xx - yy);
  const root = Math.hypot((xx - yy) / 2, xy);
  const [long, short] = [(xx + yy) / 2 + root, Math.max(0, (xx + yy) / 2 - root)].map((value) => ELLIPSE * Math.sqrt(value));
  return Array.from({ length: 48 }, (_, at) => {
    const [u, v] = [long * Math.cos((at * Math.PI) / 24), short * Math.sin((at * Math.PI) / 24)];
    return [mean[0] + u * Math.cos(turn) - v * Math.sin(turn), mean[1] + u * Math.sin(turn) + v * Math.cos(turn)];
  });
}

function scatter(app, { x, y, column, outline }, [width, height]) {
  const { variation } = app;
  const points = variation.scores.map((row) => [row[x], row[y]]);
  const values = column ? variation.columns[column] : variation.names.map(() => "");
  const kinds = [...new Set(values)].filter(Boolean).sort();
  const outlines = kinds.map((kind) => {
    const members = points.filter((_, at) => values[at] === kind);
    return outline === "none" || members.length < 3 ? [] : (outline === "hulls" ? hull : ellipse)(members);
  });
  const every = [...points, ...outlines.flat()];
  const bounds = [0, 1].map((axis) => [Math.min(...every.map((p) => p[axis])), Math.max(...every.map((p) => p[axis]))]);
  const unit = Math.min(...bounds.map(([low, high], axis) => ([width, height][axis] - 2 * MARGIN) / (high - low || 1)));
  const place = (point) => [0, 1].map((axis) => ([width, height][axis] / 2 + (axis ? -1 : 1) * (point[axis] - (bounds[axis][0] + bounds[axis][1]) / 2) * unit));
  const shapes = outlines.map((corners, at) => corners.length && svg("polygon", { points: corners.map((point) => place(point).map((v) => v.toFixed(1)).join(",")).join(" "), fill: categorical(at), "fill-opacity": 0.12, stroke: categorical(at) }));
  const dots = points.map((point, at) => {
    const [px, py] = place(point);
    const name = [variation.names[at], values[at]].filter(Boolean).join(", ");
    const go = () => app.showSpecimen(at);
    return svg("g", { class: "dot", role: "button", tabindex: 0, "aria-label": name, transform: `translate(${px.toFixed(1)} ${py.toFixed(1)})`, onclick: go, onkeydown: (event) => (event.key === "Enter" || event.key === " ") && (event.preventDefault(), go()) },
      svg("title", null, name), svg("circle", { r: 5, fill: values[at] ? categorical(kinds.indexOf(values[at])) : "var(--accent)" }), svg("text", { x: 8, y: 4 }, variation.names[at]));
  });
  const title = (at) => `principal component ${at + 1} (${(100 * variation.shares[at]).toFixed(0)} %)`;
  const titles = [svg("text", { x: width / 2, y: height - 8, "text-anchor": "middle", class: "axis" }, title(x)),
    svg("text", { x: 14, y: height / 2, "text-anchor": "middle", class: "axis", transform: `rotate(-90 14 ${height / 2})` }, title(y))];
  const legend = kinds.map((kind, at) => el("li", { class: "chip" }, el("span", { class: "dot", style: `background:${categorical(at)}` }), kind));
  return [
    svg("svg", { class: points.length > 60 || width < WIDE[0] ? "map crowded" : "map", viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": `Morphospace of ${points.length} specimens` }, ...shapes.filter(Boolean), ...titles, ...dots),
    el("ul", { class: "chips", "aria-label": "Colours of groups" }, ...legend),
  ];
}

export function morphospaceSection(app) {
  const { variation } = app;
  const columns = Object.keys(variation.columns);
  const chosen = { x: 0, y: Math.min(1, variation.shares.length - 1), column: columns[0] ?? "", outline: "hulls" };
  const picture = el("div", { class: "picture" });
  const show = responsive(picture, (narrow) => scatter(app, chosen, narrow ? NARROW : WIDE));
  const change = (key, read = String) => (value) => { chosen[key] = read(value); show(); };
  const axes = variation.shares.map((_, at) => [String(at), `PC${at + 1}`]);
  return [
    el("div", { class: "row tools" },
      select("Across", axes, change("x", Number), String(chosen.x)), select("Up", axes, change("y", Number), String(chosen.y)),
      columns.length ? select("Colour by", [...columns.map((key) => [key, key]), ["", "nothing"]], change("column"), chosen.column) : "",
      columns.length ? select("Around groups", [["hulls", "hulls"], ["ellipses", "ellipses (95 %)"], ["none", "nothing"]], change("outline"), chosen.outline) : "",
      button("Save chart (SVG)", () => saveSvg("morphospace", picture.querySelector("svg"))),
      el("span", { class: "muted" }, "A specimen's dot shows it against the mean.")),
    picture,
  ];
}
