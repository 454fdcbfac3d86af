// A pair and a shape, looked at closely.

import { degrees, el, modal, number, table, button } from "./dom.js";
import { angleDeg, rotationMatrix } from "./data.js";
import { GREY, categorical, positionColors } from "./colors.js";
import { after, before, percent, posed } from "./layers.js";

const WORST = 8;

// Figures that live as long as the dialog is open.
function figures(stage) {
  const tiles = [];
  return {
    add(parent, caption, layers) {
      const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": `${caption}; arrow keys turn, plus and minus zoom` });
      const text = el("figcaption", null, caption);
      const figure = el("figure", null, canvas, text);
      parent.append(figure);
      const tile = stage.add(canvas, layers, { zoomable: true });
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
    const colors = async () => positionColors((await collection.mesh(shapes[i].mesh)).samples);
    const matched = async () => {
      const own = await colors();
      return Array.from(map, (label) => (label < 0 ? null : own[label]));
    };
    const poseOfJ = () => common.clone().multiply(pose.R);
    const row = el("div", { class: "figures three" });
    drawn.add(row, shapes[i].name, async () => [posed(app, i, common, { points: await colors() })]);
    const moving = [
      drawn.add(row, shapes[j].name, async () => [posed(app, j, poseOfJ(), { points: await matched() })]),
      drawn.add(row, "both", () => [
        posed(app, i, common, { color: categorical(0), opacity: 0.55 }), posed(app, j, poseOfJ(), { color: categorical(1), opacity: 0.55 })]),
    ];
    const rows = poses.map((one, at) => {
      const { angle, mirrored } = angleDeg(agreed, one.R);
      const choose = () => { pose = one; moving.forEach(({ tile }) => stage.refresh(tile)); };
      const radio = el("input", { type: "radio", name: "pair-pose", checked: at === 0, onchange: choose });
      const ratio = number(one.energy / poses[0].energy);
      return [el("label", { class: "check" }, radio, one.text), number(one.energy), ratio, mirrored ? "mirrored" : degrees(angle)];
    });
    const bound = pairs.bound[pair];
    const facts = [
      Number.isNaN(bound) ? "No lower bound was asked for." : `Lower bound ${number(bound)}: no pose has a smaller energy (gap ${number(100 * (1 - bound / pairs.energy[pair]))} %).`,
      pairs.chiralityProven[pair] ? "Every pose of the other handedness is proven to be worse." : "",
      `Synchronization: ${collection.use(pair)}.`,
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

// Log-odds against the present pose, in words first.
function plausibility(score) {
  const words = score > -1 ? "about as likely" : score > -5 ? "less likely" : "far less likely";
  return `${words} (log-odds ${number(score)})`;
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
      const choose = button(pose < 0 ? "This pose is right" : "Use this pose", () => {
        const same = corrections.chosen.has(index) && corrections.poseOf(index) === pose;
        corrections.decide(index, same ? null : pose);
        state.forEach((update) => update());
      });
      const update = () => choose.setAttribute("aria-pressed", String(corrections.chosen.get(index) === pose));
      state.push(update);
      update();
      figure.append(choose);
    };
    add("present pose", () => [posed(app, index, rotationMatrix(shape.R)), ...ghost()], -1);
    shape.alternatives.forEach(({ R, score, origin }, at) => {
      const { angle, mirrored } = angleDeg(rotationMatrix(shape.R), rotationMatrix(R));
      const turned = origin === "candidates" ? (mirrored ? "mirrored" : `turned by ${degrees(angle)}`) : origin;
      const words = [`pose ${at + 1}: ${turned}`, score !== null && plausibility(score)];
      add(words.filter(Boolean).join(", "), () => [posed(app, index, rotationMatrix(R)), ...ghost()], at);
    });
  };

  return (index) => {
    drawn.clear();
    const shape = collection.shapes[index];
    const [compare] = collection.certain(new Set([index]));
    const row = el("div", { class: "figures" });
    drawn.add(row, "as in the file", () => [before(app, index)]);
    const ghost = () => (compare === undefined ? [] : [posed(app, compare, corrections.rotation(compare), { color: GREY, opacity: 0.3 })]);
    if (compare !== undefined) drawn.add(row, `for comparison: ${collection.shapes[compare].name}`, () => [after(app, compare, { color: GREY })]);
    poseFigures(row, index, ghost);
    const labels = Object.entries(collection.labels).map(([column, values]) => `${column}: ${values[index] || "unknown"}`);
    const facts = [`Confidence ${percent(shape.confidence)}`, shape.reflected && "mirrored by the alignment", ...labels, `file ${shape.file}`];
    const rows = pairRows(app, index, (a, b) => { box.dialog.close(); app.openPair(a, b); });
    box.body.replaceChildren(
      el("p", null, facts.filter(Boolean).join(" · ")),
      el("p", { class: "muted" }, "Grey and clear: a certain shape to compare with. Which pose lies like it? Choose it, then download the decisions at the bottom of the page. Certain shapes will stay as they are, doubtful ones may follow."),
      row,
      rows.length ? table("Its pairs that disagree most", ["With", "Disagreement", "Energy", "Synchronization"], rows) : "");
    box.show(shape.name);
  };
}
