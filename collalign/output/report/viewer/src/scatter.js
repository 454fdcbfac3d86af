// A scatter of specimens with ticks on both axes, a mark for each group, hulls or ellipses around groups, and a line.

import { categorical } from "./colors.js";
import { el, svg } from "./dom.js";
import { namesBeside } from "./names.js";

const ROOM = { left: 70, right: 18, top: 14, bottom: 50 };
const WIDE = [900, 560];
const NARROW = [380, 420];
//: Groups that the legend names.
const LISTED = 16;
//: How a legend is written, and how long a name in it may be.
const [ROW, CHARACTER, LONGEST] = [18, 7, 24];
//: Corners of the marks of groups, behind a circle for the first.
const MARKS = [[[-4.5, -4.5], [4.5, -4.5], [4.5, 4.5], [-4.5, 4.5]], [[0, -6], [5.5, 4.5], [-5.5, 4.5]], [[0, -6.5], [6.5, 0], [0, 6.5], [-6.5, 0]], [[0, 6], [5.5, -4.5], [-5.5, -4.5]]];
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

// Round numbers from `low` to `high`, about `most` of them, as text.
export function ticks(low, high, most) {
  const rough = (high - low) / most || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, at) => ((first + at) * step).toFixed(digits));
}

// Where points are on the chart, and what each axis runs over; one unit is as long on both if `equal`.
function scaler(every, [width, height], equal) {
  const size = [width - ROOM.left - ROOM.right, height - ROOM.top - ROOM.bottom];
  const ranges = [0, 1].map((axis) => {
    const values = every.map((point) => point[axis]);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    return [(low + high) / 2, 1.08 * (high - low) || 1];
  });
  const units = ranges.map(([, length], axis) => size[axis] / length);
  if (equal) units.fill(Math.min(...units));
  const bounds = ranges.map(([middle], axis) => [middle - size[axis] / units[axis] / 2, middle + size[axis] / units[axis] / 2]);
  const place = ([x, y]) => [ROOM.left + (x - bounds[0][0]) * units[0], ROOM.top + size[1] - (y - bounds[1][0]) * units[1]];
  return { place, bounds, size };
}

function axes({ place, bounds, size }, titles) {
  const [left, bottom] = [ROOM.left, ROOM.top + size[1]];
  const x = ticks(...bounds[0], size[0] / 90).flatMap((text) => {
    const [at] = place([Number(text), bounds[1][0]]);
    return [svg("line", { x1: at, x2: at, y1: bottom, y2: bottom + 5, class: "axis" }), svg("text", { x: at, y: bottom + 18, "text-anchor": "middle", class: "axis" }, text)];
  });
  const y = ticks(...bounds[1], size[1] / 70).flatMap((text) => {
    const [, at] = place([bounds[0][0], Number(text)]);
    return [svg("line", { x1: left - 5, x2: left, y1: at, y2: at, class: "axis" }), svg("text", { x: left - 8, y: at + 4, "text-anchor": "end", class: "axis" }, text)];
  });
  const middle = ROOM.top + size[1] / 2;
  return [
    svg("path", { d: `M${left} ${ROOM.top}V${bottom}H${left + size[0]}`, class: "axis" }), ...x, ...y,
    svg("text", { x: left + size[0] / 2, y: bottom + 40, "text-anchor": "middle", class: "title" }, titles[0]),
    svg("text", { x: 14, y: middle, "text-anchor": "middle", class: "title", transform: `rotate(-90 14 ${middle})` }, titles[1]),
  ];
}

// The mark of a group, by its number; -1 for none.
function mark(kind) {
  const fill = kind < 0 ? "var(--accent)" : categorical(kind);
  const corners = MARKS[(Math.max(kind, 0) % (MARKS.length + 1)) - 1];
  return corners ? svg("polygon", { points: corners.join(" "), fill }) : svg("circle", { r: 5, fill });
}

// Groups with their marks: at the right of a wide chart, below a narrow one; and the size of the chart with them.
function legendOf(kinds, [width, height], narrow) {
  const named = kinds.slice(0, LISTED).map((kind) => (kind.length > LONGEST ? `${kind.slice(0, LONGEST - 1)}…` : kind));
  const longest = Math.max(0, ...named.map((kind) => kind.length));
  const [left, top] = narrow ? [ROOM.left, height + 6] : [width + 8, ROOM.top + 8];
  const entries = named.map((kind, at) => svg("g", { transform: `translate(${left} ${top + ROW * at})` }, mark(at), svg("text", { x: 12, y: 4 }, kind)));
  if (!named.length) return [entries, [width, height]];
  return [entries, narrow ? [width, height + ROW * (named.length + 1)] : [width + 30 + CHARACTER * longest, height]];
}

// The ends of the least-squares line through points.
export function regression(points) {
  const [x, y] = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
  const slope = points.reduce((sum, point) => sum + (point[0] - x) * (point[1] - y), 0) / (points.reduce((sum, point) => sum + (point[0] - x) ** 2, 0) || 1);
  const ends = points.map((point) => point[0]);
  return [Math.min(...ends), Math.max(...ends)].map((at) => [at, y + slope * (at - x)]);
}

// `points` as they are, `values` their groups or empty texts, `outline` hulls, ellipses or none, `line` the ends of a
// line, `named` whether names are written; `open(at)` when a dot is chosen.
export function scatter({ points, names, values, outline = "none", line = [], named = true, titles, words, equal = false, narrow, open }) {
  const size = narrow ? NARROW : WIDE;
  const kinds = [...new Set(values)].filter(Boolean).sort();
  const outlines = kinds.map((kind) => {
    const members = points.filter((_, at) => values[at] === kind);
    return outline === "none" || members.length < 3 ? [] : (outline === "hulls" ? hull : ellipse)(members);
  });
  const scale = scaler([...points, ...line, ...outlines.flat()], size, equal);
  const text = (point) => scale.place(point).map((value) => value.toFixed(1));
  const areas = outlines.map((corners, at) => corners.length && svg("polygon", { class: "around", points: corners.map((point) => text(point).join(",")).join(" "), fill: categorical(at), "fill-opacity": 0.12, stroke: categorical(at) }));
  const [ends, [legend, whole]] = [line.map(scale.place), legendOf(kinds, size, narrow)];
  const fitted = line.length ? [svg("line", { class: "fitted", x1: ends[0][0], y1: ends[0][1], x2: ends[1][0], y2: ends[1][1] })] : [];
  const beside = namesBeside(points.map(scale.place), names, [...size, ROOM.left]);
  const dots = points.map((point, at) => {
    const name = [names[at], values[at]].filter(Boolean).join(", ");
    const keys = (event) => (event.key === "Enter" || event.key === " ") && (event.preventDefault(), open(at));
    return svg("g", { class: named && !beside[at].crowded ? "dot" : "dot crowded", role: "button", tabindex: 0, "aria-label": name, transform: `translate(${text(point).join(" ")})`, onclick: () => open(at), onkeydown: keys },
      svg("title", null, name), mark(values[at] ? kinds.indexOf(values[at]) : -1), svg("text", beside[at].text, names[at]));
  });
  return [
    svg("svg", { class: "map", viewBox: `0 0 ${whole.join(" ")}`, role: "group", "aria-label": words }, ...areas.filter(Boolean), ...fitted, ...axes(scale, titles), ...legend, ...dots),
    kinds.length > LISTED ? el("p", { class: "muted" }, `The first ${LISTED} of ${kinds.length} groups are named.`) : "",
  ];
}
