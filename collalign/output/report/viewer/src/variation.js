// The page of shape variation: components, morphospace, group means, specimens against the mean, correspondence, landmarks.

import { Vector3 } from "three";
import { DIVERGING_CSS, RISING_CSS, categorical } from "./colors.js";
import { button, checkbox, el, number, select, table } from "./dom.js";
import { savePly, savePng } from "./downloads.js";
import { morphospaceSection } from "./morphospace.js";
import { shownTable, statisticsSection } from "./statistics.js";
import { largestOf } from "./variation_data.js";

const LARGEST_DEVIATION = 3;

export const VARIATION_SECTIONS = [
  ["components", "Principal components", componentsSection],
  ["morphospace", "Morphospace", morphospaceSection],
  ["statistics", "Statistics", statisticsSection],
  ["groups", "Group means", groupsSection],
  ["specimens", "Each specimen compared with the mean", specimensSection],
  ["quality", "How well each specimen is represented", qualitySection],
  ["symmetry", "Symmetry", symmetrySection],
  ["correspondence", "Correspondence", correspondenceSection],
  ["landmarks", "Landmarks", landmarksSection],
];

function slider(label, low, high, step, value, oninput) {
  const text = el("output", null, String(value));
  const box = el("input", { type: "range", min: low, max: high, step, value, oninput: () => { text.textContent = box.value; oninput(Number(box.value)); } });
  const set = (to) => { box.value = to; text.textContent = String(to); };
  return { field: el("label", { class: "field slider" }, el("span", null, label), box, text), set };
}

const AGAINST = { low: (value) => `${number(-value)} (inside)`, high: (value) => `${number(value)} (outside)` };

function scale(largest, { words = AGAINST, ramp = DIVERGING_CSS } = {}) {
  const low = el("span");
  const high = el("span");
  const set = (value) => { [low.textContent, high.textContent] = [words.low(value), words.high(value)]; };
  set(largest);
  return { box: el("div", { class: "legend" }, low, el("span", { class: "ramp", style: `background:${ramp}` }), high, el("span", { class: "muted" }, "in root mean square radii")), set };
}

// A large canvas with one surface that changes, and buttons that save it.
function display(app, name, extra = () => []) {
  const { variation, stage } = app;
  const canvas = el("canvas", { class: "large", role: "img", tabindex: 0, "aria-label": name });
  const surface = variation.surface();
  const shown = { positions: variation.mean, offsets: new Float32Array(variation.size / 3) };
  const tile = stage.add(canvas, () => [{ object: surface }, ...extra().map((object) => ({ object }))], { zoomable: true, fitted: true });
  return {
    canvas,
    buttons: [button("Save picture (PNG)", () => savePng(name, canvas)), button("Save surface (PLY)", () => savePly(name, shown.positions, variation.faces, shown.offsets))],
    show(positions, offsets, largest, refresh = false) {
      Object.assign(shown, { positions, offsets });
      surface.show(positions, offsets, largest);
      if (refresh) stage.refresh(tile);
      else stage.invalidate(tile);
    },
  };
}

function componentsSection(app) {
  const { variation } = app;
  const deviations = variation.shares.map(() => 0);
  const view = display(app, "Principal components");
  const ends = variation.shares.map((_, at) => variation.along(variation.shares.map((_, other) => (other === at ? LARGEST_DEVIATION : 0))));
  const largest = Math.max(...ends.map((surface) => largestOf(variation.offsets(variation.mean, surface))));
  const draw = () => {
    const surface = variation.along(deviations);
    view.show(surface, variation.offsets(variation.mean, surface), largest);
  };
  const sliders = variation.shares.map((share, at) =>
    slider(`PC${at + 1} (${(100 * share).toFixed(0)} %)`, -LARGEST_DEVIATION, LARGEST_DEVIATION, 0.1, 0, (value) => { deviations[at] = value; draw(); }));
  const reset = () => { deviations.fill(0); sliders.forEach((one) => one.set(0)); draw(); };
  draw();
  return [
    el("p", { class: "muted" }, "The mean surface, moved along the components by so many standard deviations. Colours: how far outside or inside of the mean it then is."),
    el("div", { class: "row tools" }, ...sliders.map((one) => one.field), button("Back to the mean", reset)),
    view.canvas, scale(largest).box, el("div", { class: "row tools" }, ...view.buttons),
  ];
}

function groupsSection(app) {
  const { variation } = app;
  const columns = variation.factors.filter((column) => kindsOf(variation, column).length > 1);
  if (!columns.length) return [el("p", null, "No labels tell groups apart. Give a table with --labels.")];
  let [column, one, other, factor, arrows] = [columns[0], "", "", 1, true];
  let needles = [];
  const view = display(app, "Group means", () => needles);
  const bar = scale(0);
  const words = el("p", { class: "muted", "aria-live": "polite" });
  const choices = el("div", { class: "row tools" });
  const draw = () => {
    const [a, b] = [one, other].map((kind) => variation.groupMean(membersOf(variation, column, kind)));
    const offsets = variation.offsets(a, b);
    const largest = largestOf(offsets);
    needles = arrows ? [variation.arrows(a, b, factor)] : [];
    bar.set(largest);
    const distance = Math.sqrt(a.reduce((sum, value, at) => sum + (b[at] - value) ** 2, 0) / (variation.size / 3));
    words.textContent = `The mean of ${one} (${membersOf(variation, column, one).length}). Colours show where the mean of ${other} (${membersOf(variation, column, other).length}) is outside or inside of it. Arrows point towards it. The means are ${number(distance)} root mean square radii apart.`;
    view.show(a, offsets, largest, true);
  };
  const choose = (kinds) => {
    const options = kinds.map((kind) => [kind, kind]);
    choices.replaceChildren(
      select("Labels", columns.map((key) => [key, key]), (key) => { column = key; start(); }, column),
      select("From", options, (kind) => { one = kind; draw(); }, one), select("to", options, (kind) => { other = kind; draw(); }, other),
      slider("Arrows times", 1, 10, 1, factor, (value) => { factor = value; draw(); }).field,
      checkbox("Arrows", (on) => { arrows = on; draw(); }, arrows));
  };
  const start = () => {
    const kinds = kindsOf(variation, column);
    [one, other] = kinds;
    choose(kinds);
    draw();
  };
  start();
  return [choices, words, view.canvas, bar.box, el("div", { class: "row tools" }, ...view.buttons)];
}

export function kindsOf(variation, column) {
  return [...new Set(variation.columns[column])].filter(Boolean).sort();
}

export function membersOf(variation, column, kind) {
  return variation.columns[column].flatMap((value, at) => (value === kind ? [at] : []));
}

function specimensSection(app) {
  const { variation } = app;
  const view = display(app, "Specimen");
  const bar = scale(0);
  const words = el("p", { class: "muted", "aria-live": "polite" });
  const draw = (at) => {
    const surface = variation.shape(at);
    const offsets = variation.offsets(variation.mean, surface);
    bar.set(largestOf(offsets));
    const labels = Object.entries(variation.columns).map(([key, values]) => `${key} ${values[at] || "unknown"}`).join(", ");
    words.textContent = [`${variation.names[at]}: centroid size ${number(variation.centroidSizes[at])}`, labels].filter(Boolean).join("; ");
    view.show(surface, offsets, largestOf(offsets));
  };
  const box = select("Specimen", variation.names.map((name, at) => [String(at), name]), (at) => draw(Number(at)), "0");
  app.showSpecimen = (at) => {
    box.querySelector("select").value = String(at);
    draw(at);
    document.getElementById("specimens").scrollIntoView({ block: "start" });
  };
  draw(0);
  return [el("div", { class: "row tools" }, box), words, view.canvas, bar.box, el("div", { class: "row tools" }, ...view.buttons)];
}

// Distances of each specimen to the mean surface fitted to it, and back, the worst first.
function qualitySection(app) {
  const { variation } = app;
  if (!variation.quality) return [el("p", null, "Not measured.")];
  const [head, ...rows] = variation.quality;
  const view = display(app, "Represented");
  const words = el("p", { class: "muted", "aria-live": "polite" });
  const bar = scale(0, { words: { low: () => "0", high: number }, ramp: RISING_CSS });
  const draw = (row) => {
    const at = variation.names.indexOf(row[1]);
    const distances = variation.distances(at);
    const largest = largestOf(distances);
    bar.set(largest);
    words.textContent = `${row[1]}, number ${row[0]} of ${rows.length}: 95 % of its surface is within ${number(row[2])} % of its radius.`;
    view.show(variation.shape(at), distances, largest, true);
  };
  const cells = rows.map((row) => row.map((value, column) => (column === 1 ? button(value, () => draw(row), { class: "link" }) : number(value))));
  draw(rows[0]);
  return [
    el("p", { class: "muted" }, "Distances between the surface of the specimen and the mean surface fitted to it, both ways, in the unit of its file: median, 95th and 99th percentile. The worst come first, by the larger 95th percentile in percent of the radius. Click a name to see where it does not fit."),
    words, view.canvas, bar.box, el("div", { class: "row tools" }, ...view.buttons),
    table("Specimens by how well they are represented", head.map((word) => word.replaceAll("_", " ")), cells, { class: "numbers" }),
  ];
}

function symmetrySection(app) {
  const { variation } = app;
  const { symmetry } = variation;
  if (!symmetry) return [el("p", null, "Not computed. For bilateral shapes, give --symmetry auto, or a table of landmark pairs.")];
  let [at, factor] = [0, 5];
  const view = display(app, "Asymmetry");
  const bar = scale(0);
  const words = el("p", { class: "muted", "aria-live": "polite" });
  const draw = () => {
    const offsets = variation.offsets(variation.symmetricMean, variation.asymmetricSurface(at, 1), variation.symmetricNormals);
    bar.set(largestOf(offsets));
    words.textContent = at === 0 ? "Directional asymmetry: what all have in common." : `${variation.names[at - 1]}: asymmetry ${number(symmetry.asymmetry[at - 1])}, without the directional part ${number(symmetry.fluctuating[at - 1])} (root mean square, in radii)`;
    view.show(variation.asymmetricSurface(at, factor), offsets, largestOf(offsets));
  };
  const order = variation.names.map((_, shape) => shape).sort((a, b) => symmetry.asymmetry[b] - symmetry.asymmetry[a]);
  draw();
  return [
    el("p", { class: "muted" }, "The symmetric mean, changed by the asymmetric component so many times over. Colours: how far outside or inside of the symmetric place the surface is, before that."),
    el("div", { class: "row tools" },
      select("Asymmetry of", [["0", "all (directional)"], ...variation.names.map((name, shape) => [String(shape + 1), name])], (value) => { at = Number(value); draw(); }, "0"),
      slider("Times", 0, 20, 1, factor, (value) => { factor = value; draw(); }).field),
    words, view.canvas, bar.box, el("div", { class: "row tools" }, ...view.buttons),
    el("p", { class: "muted" }, "Registration errors that all specimens share look like directional asymmetry. If the first lines of this page warn of it, do not report it."),
    shownTable("Procrustes ANOVA of asymmetry", symmetry.anova),
    table("Asymmetry of every specimen, in radii", ["specimen", "asymmetry", "without the directional part"], order.map((shape) => [variation.names[shape], number(symmetry.asymmetry[shape]), number(symmetry.fluctuating[shape])])),
  ];
}

function correspondenceSection(app) {
  const { variation, stage } = app;
  const cards = variation.names.map((name, at) => {
    const canvas = el("canvas", { role: "img", "aria-label": `${name}, coloured by correspondence` });
    let surface = null;
    stage.add(canvas, () => {
      surface ??= variation.surface(variation.colors);
      surface.show(variation.shape(at));
      return [{ object: surface }];
    }, { fitted: true });
    return el("li", { class: "card" }, el("figure", null, canvas, el("figcaption", null, button(name, () => app.showSpecimen(at), { class: "link" }))));
  });
  return [el("p", { class: "muted" }, "Equal colours are corresponding places: where colours run in another way than on the other shapes, look twice."), el("ul", { class: "gallery small" }, ...cards)];
}

function landmarksSection(app) {
  const { variation, stage } = app;
  const { names, points, normals } = variation.landmarks;
  if (!names.length) return [el("p", null, "No landmarks were given. Name files with --landmarks.")];
  const canvas = el("canvas", { class: "large", role: "img", tabindex: 0, "aria-label": "Landmarks on the mean" });
  const places = points.map((point) => new Vector3(...point).multiplyScalar(variation.unit));
  const outward = normals.map((normal) => new Vector3(...normal));
  const annotate = (context, project, orientation) => {
    const size = Math.max(11, Math.min(16, canvas.width / 60)) * Math.min(2, devicePixelRatio || 1);
    context.font = `${size}px system-ui, sans-serif`;
    [context.textAlign, context.textBaseline] = ["center", "middle"];
    places.forEach((place, at) => {
      const behind = outward[at].clone().applyQuaternion(orientation).z < -0.05;
      const [x, y] = project(place);
      context.globalAlpha = behind ? 0.15 : 1;
      context.fillStyle = categorical(0);
      context.beginPath();
      context.arc(x, y, size * 0.75, 0, 2 * Math.PI);
      context.fill();
      context.fillStyle = "#fff";
      context.fillText(String(at + 1), x, y);
    });
    context.globalAlpha = 1;
  };
  const surface = variation.surface();
  stage.add(canvas, () => [{ object: surface }], { zoomable: true, annotate, fitted: true });
  return [
    el("p", { class: "muted" }, "On the mean, numbered; those on the far side are faint."), canvas,
    el("div", { class: "row tools" }, button("Save picture (PNG)", () => savePng("Landmarks", canvas))),
    table("Landmarks", ["number", "name"], names.map((name, at) => [String(at + 1), name])),
  ];
}
