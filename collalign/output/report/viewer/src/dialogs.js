// A pair and a shape, looked at closely.

import { degrees, el, modal, number, select, table, button } from "./dom.js";
import { angleDeg, rotationMatrix } from "./data.js";
import { CONFIRMED } from "./corrections.js";
import { GREY, categorical } from "./colors.js";
import { isShownByOpen } from "./downloads.js";
import { after, before, percent, posed } from "./layers.js";
import { overlapInWords } from "./incomplete.js";
import { poseByHand } from "./by_hand.js";

const WORST = 8;

// Figures that live as long as the dialog is open.
function figures(stage) {
  const tiles = [];
  return {
    add(parent, caption, layers, options = {}) {
      const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": `${caption}; arrow keys rotate, plus and minus zoom` });
      const text = el("figcaption", null, caption);
      const figure = el("figure", null, canvas, text);
      parent.append(figure);
      const tile = stage.add(canvas, layers, { zoomable: true, ...options });
      tiles.push(tile);
      return { tile, figure, text };
    },
    clear() {
      tiles.splice(0).forEach((tile) => stage.remove(tile));
    },
  };
}

export function pairDialog(app) {
  const { stage, collection } = app;
  const drawn = figures(stage);
  const box = modal(() => drawn.clear());

  return (a, b) => {
    drawn.clear();
    const { pairs, shapes } = collection;
    const pair = collection.pairAt(a, b);
    const [i, j] = [pairs.i[pair], pairs.j[pair]];
    const common = rotationMatrix(shapes[i].R);
    const agreed = rotationMatrix(shapes[i].R).transpose().multiply(rotationMatrix(shapes[j].R));
    const poses = [...collection.poses(pair).map((pose, at) => ({ ...pose, text: at ? `alternative ${at}` : "found by matching" })),
      { R: agreed, energy: NaN, text: "agreed by the collection" }];
    let pose = poses[0];
    const map = collection.pairMap(pair);
    const colors = collection.pointColors;
    const matched = Array.from(map, (label) => (label < 0 ? null : colors[label]));
    const poseOfJ = () => common.clone().multiply(pose.R);
    const row = el("div", { class: "figures three" });
    drawn.add(row, shapes[i].name, () => [posed(app, i, common, { points: colors })]);
    const moving = [
      drawn.add(row, shapes[j].name, () => [posed(app, j, poseOfJ(), { points: matched })]),
      drawn.add(row, "both", () => [
        posed(app, i, common, { color: categorical(0), opacity: 0.55 }), posed(app, j, poseOfJ(), { color: categorical(1), opacity: 0.55 })]),
    ];
    const rows = poses.map((one, at) => {
      const { angle, mirrored } = angleDeg(agreed, one.R);
      const choose = () => { pose = one; moving.forEach(({ tile }) => stage.refresh(tile)); };
      const radio = el("input", { type: "radio", name: "pair-pose", checked: at === 0, onchange: choose });
      const ratio = number(one.energy / poses[0].energy);
      return [el("label", { class: "check" }, radio, one.text), number(one.energy), ratio, mirrored ? "reflected" : degrees(angle)];
    });
    const bound = pairs.bound[pair];
    const facts = [
      Number.isNaN(bound) ? "No lower bound was asked for." : `Lower bound ${number(bound)}: no pose has a smaller energy (gap ${number(100 * (1 - bound / pairs.energy[pair]))} %).`,
      pairs.chiralityProven[pair] ? "Every pose of the other handedness is proven to be worse." : "",
      `This pair is ${collection.use(pair)}.`,
      overlapInWords(collection, i, j),
      collection.statuses[pairs.status[pair]],
    ];
    box.body.replaceChildren(
      el("p", { class: "muted" }, "Matched points carry the same colour. Choose a pose to see it."), row,
      table("Poses of this pair", ["Pose", "Energy", "Energy / best", "Angle to the collection's"], rows),
      el("p", null, facts.filter(Boolean).join(" ")));
    box.show(`${shapes[i].name} – ${shapes[j].name}`);
  };
}

function pairRows(app, index, openPair) {
  const { pairs, shapes } = app.collection;
  const own = [...pairs.i.keys()].filter((pair) => pairs.i[pair] === index || pairs.j[pair] === index);
  own.sort((a, b) => (pairs.disagreement[b] || 0) - (pairs.disagreement[a] || 0));
  return own.slice(0, WORST).map((pair) => {
    const other = pairs.i[pair] === index ? pairs.j[pair] : pairs.i[pair];
    const open = button(shapes[other].name, () => openPair(index, other), { class: "link" });
    return [open, app.collection.disagreement(pair), number(pairs.energy[pair]), app.collection.use(pair)];
  });
}

function chanceInWords(chance) {
  return chance < 0.01 ? "chance below 1 %" : `chance about ${percent(chance)}`;
}

// Chances of a shape's other poses, NaN where no pair proposed one. A pose's log-odds compare it with the present pose.
function chances({ confidence, alternatives }) {
  return alternatives.map(({ score }) => (score === null ? NaN : Math.min(1 - confidence, confidence * Math.exp(score))));
}

function chancesInWords(shape) {
  if (shape.alone) return "There is no other shape of its kind to align it with. Grey and transparent: a shape of another kind.";
  if (shape.byHand) {
    const { evidence } = shape.byHand;
    const said = evidence === null ? "" : `; the evidence alone gives it ${percent(evidence)}`;
    return `This pose was set by hand${said}. Grey and transparent: a certain shape to compare with.`;
  }
  const others = chances(shape).reduce((sum, chance) => sum + (chance || 0), 0);
  const none = 1 - shape.confidence - others;
  const rest = none >= 0.01 ? `. There is a ${percent(none)} chance that none of the poses shown is right` : "";
  return `This pose is right with a chance of ${percent(shape.confidence)}${rest}. Grey and transparent: a certain shape to compare with.`;
}

export function shapeDialog(app) {
  const { stage, collection, corrections } = app;
  const drawn = figures(stage);
  const box = modal(() => drawn.clear());

  const poseFigures = (row, index, ghost) => {
    const shape = collection.shapes[index];
    const state = [];
    const add = (caption, layers, pose) => {
      const { figure } = drawn.add(row, caption, layers);
      const choose = button(pose === CONFIRMED ? "This pose is right" : "Use this pose", () => {
        const same = corrections.poseOf(index) === pose;
        corrections.decide(index, same ? null : pose);
        state.forEach((update) => update());
      });
      const update = () => choose.setAttribute("aria-pressed", String(corrections.poseOf(index) === pose));
      state.push(update);
      update();
      figure.append(choose);
    };
    const layers = (pose) => () => [corrections.layer(index, corrections.offered(index, pose)), ...ghost()];
    add(`present pose: ${shape.byHand ? "set by hand" : shape.alone ? "as in the file" : chanceInWords(shape.confidence)}`, layers(CONFIRMED), CONFIRMED);
    const chance = chances(shape);
    shape.alternatives.forEach(({ R, origin }, at) => {
      const { angle, mirrored } = angleDeg(rotationMatrix(shape.R), rotationMatrix(R));
      const turned = origin === "candidates" ? (mirrored ? "reflected" : `rotated by ${degrees(angle)}`) : origin;
      const words = Number.isNaN(chance[at]) ? "no pair proposes it" : chanceInWords(chance[at]);
      add(`pose ${at + 1}: ${turned}, ${words}`, layers(at), at);
    });
    state.push(poseByHand(app, drawn, row, index, ghost, () => state.forEach((update) => update())));
  };

  // `chosen` is the shape to compare with, by default the surest one.
  const open = (index, chosen) => {
    drawn.clear();
    const shape = collection.shapes[index];
    const certain = collection.certain(new Set([index]));
    const compare = chosen ?? certain.find((other) => !collection.isPlaced(other)) ?? certain[0];
    // A shape that is placed lies in the common frame; others are turned about their own middles.
    const beneath = collection.isPlaced(index) ? (other) => corrections.inPlace(other) : (other) => corrections.centred(other);
    const row = el("div", { class: "figures" });
    drawn.add(row, "as in the file", () => [before(app, index)]);
    const ghost = () => (compare === undefined ? [] : [corrections.layer(compare, beneath(compare), { color: GREY, opacity: 0.3 })]);
    if (compare !== undefined) drawn.add(row, `for comparison: ${collection.shapes[compare].name}`, () => [after(app, compare, { color: GREY })]);
    poseFigures(row, index, ghost);
    const labels = Object.entries(collection.labels).map(([column, values]) => `${column}: ${values[index] || "unknown"}`);
    const facts = [shape.byHand ? "Set by hand" : shape.alone ? "Alone of its kind" : `Confidence ${percent(shape.confidence)}${shape.limitedBy ? `, no more because ${shape.limitedBy}` : ""}`, shape.reflected && "reflected by the alignment", ...labels, `file ${shape.file}`];
    const rows = pairRows(app, index, (a, b) => { box.dialog.close(); app.openPair(a, b); });
    const others = certain.map((other) => [String(other), `${collection.shapes[other].name} (${percent(collection.shapes[other].confidence)})`]);
    box.body.replaceChildren(
      el("p", null, facts.filter(Boolean).join(" · ")),
      others.length > 1 ? select("Compare with", others, (other) => open(index, Number(other)), String(compare)) : "",
      el("p", { class: "muted" }, `${chancesInWords(shape)} Choose the pose that matches it, or ${collection.isPlaced(index) ? "place" : "rotate"} the shape by hand. Then ${isShownByOpen ? "apply the decision at the top of the window" : "download the decisions at the bottom of the page"}. Certain shapes will stay as they are; doubtful ones may follow.`),
      row,
      rows.length ? table("Its pairs that disagree most", ["With", "Disagreement", "Energy", "In the result"], rows) : "");
    box.show(shape.name);
  };
  return (index) => open(index);
}
