// Decisions made by hand: which pose of a shape is right. The browser keeps them for this result, until they are downloaded as a
// file for `--corrections`.

import { Matrix4, Vector3 } from "three";
import { BONE } from "./colors.js";
import { commandBox, wholeCommand } from "./command.js";
import { angleDeg, matrixOf, poseMatrix, rotationMatrix, rowsOf, sizeOf, turnOf } from "./data.js";
import { button, degrees, el, number } from "./dom.js";
import { isShownByOpen, tell } from "./downloads.js";
import { keep, kept } from "./kept.js";

// What a decision says: the present pose is right, or this pose of those offered, or one turned by hand.
export const CONFIRMED = -1;
export const BY_HAND = -2;
// The present pose was set by hand before this result was made.
const BEFORE = -3;

export class Corrections {
  constructor(collection) {
    this.collection = collection;
    this.chosen = new Map();
    this.listeners = [];
    this.saved = true;
    this.leftOut = new Set((kept(`${collection.run} left out`) ?? []).filter((name) => collection.shapes.some((shape) => shape.name === name)));
    // Poses set by hand before stay decisions until they are taken back.
    collection.byHand.forEach((index) => this.chosen.set(index, { pose: BEFORE, ...this.present(index) }));
    const remembered = kept(collection.run);
    if (remembered) this.chosen.clear();
    for (const [name, decision] of Object.entries(remembered ?? {})) {
      const index = collection.shapes.findIndex((shape) => shape.name === name);
      if (index >= 0 && (decision.transform || !collection.isPlaced(index))) this.chosen.set(index, decision);
    }
    addEventListener("beforeunload", (event) => !this.saved && event.preventDefault());
  }

  onchange(listener) {
    this.listeners.push(listener);
  }

  // `pose` counts the shape's alternatives, or is CONFIRMED, or BY_HAND at a matrix of the display; null takes the decision back.
  decide(index, pose, matrix = null) {
    if (pose === null) this.chosen.delete(index);
    else this.chosen.set(index, { pose, ...this.decision(index, matrix ?? this.offered(index, pose)), ...(matrix ? {} : { R: this.of(index, pose).R }) });
    const decisions = [...this.chosen].map(([at, decision]) => [this.collection.shapes[at].name, decision]);
    this.remembered = keep(this.collection.run, Object.fromEntries(decisions));
    this.saved = this.chosen.size === 0 || this.remembered;
    this.listeners.forEach((listener) => listener(index));
  }

  // Whether a shape takes part when the alignment runs again.
  leaveOut(index, out) {
    const { name } = this.collection.shapes[index];
    if (out) this.leftOut.add(name);
    else this.leftOut.delete(name);
    this.remembered = keep(`${this.collection.run} left out`, [...this.leftOut]);
    this.listeners.forEach((listener) => listener(index));
  }

  // The present pose as a decision; of a shape that is placed with its place and size.
  present(index) {
    const { R, transform } = this.collection.shapes[index];
    return this.collection.isPlaced(index) ? { R, transform } : { R };
  }

  // How many decisions differ from those with which this result was made.
  get changes() {
    const made = [...this.chosen.values()].filter(({ pose }) => pose !== BEFORE).length;
    return made + this.leftOut.size + this.collection.byHand.filter((index) => !this.chosen.has(index)).length;
  }

  // What is kept of a pose on the display: the rows of its rotation and, of a shape that is placed, of its transform.
  decision(index, matrix) {
    const R = rowsOf(turnOf(matrix));
    return this.collection.isPlaced(index) ? { R, transform: rowsOf(this.collection.toDisplay.invert().multiply(matrix), 4) } : { R };
  }

  of(index, pose) {
    const shape = this.collection.shapes[index];
    return pose < 0 ? shape : shape.alternatives[pose];
  }

  // An offered pose, or the present one, as a matrix of the display.
  offered(index, pose) {
    const shape = this.collection.shapes[index];
    const { R, transform } = this.of(index, pose);
    if (!this.collection.isPlaced(index)) return poseMatrix(shape, rotationMatrix(R));
    if (transform) return this.collection.toDisplay.multiply(matrixOf(transform));
    const turn = rotationMatrix(R).multiply(rotationMatrix(shape.R).transpose());
    return turn.multiply(this.collection.toDisplay).multiply(matrixOf(shape.transform));
  }

  // The pose decided on, or the present one, as it is offered.
  shown(index) {
    const chosen = this.chosen.get(index);
    if (!chosen) return this.offered(index, CONFIRMED);
    if (chosen.transform) return this.collection.toDisplay.multiply(matrixOf(chosen.transform));
    return this.centred(index);
  }

  // About its own middle.
  centred(index) {
    return poseMatrix(this.collection.shapes[index], this.rotation(index));
  }

  // The same among all shapes, where complete ones do not lie about their own middles.
  inPlace(index) {
    if (this.collection.isPlaced(index)) return this.shown(index);
    return new Matrix4().makeTranslation(new Vector3(...this.collection.shapes[index].offset)).multiply(this.shown(index));
  }

  layer(index, matrix, look = {}) {
    return { mesh: this.collection.shapes[index].mesh, matrix, color: BONE, ...look };
  }

  poseOf(index) {
    return this.chosen.get(index)?.pose ?? null;
  }

  rows(index) {
    return this.chosen.get(index)?.R ?? this.collection.shapes[index].R;
  }

  rotation(index) {
    return rotationMatrix(this.rows(index));
  }

  words(index) {
    const pose = this.poseOf(index);
    if (pose === null) return "";
    if (pose === CONFIRMED) return "pose confirmed";
    if (pose === BEFORE) return "set by hand";
    if (pose === BY_HAND) return this.wordsByHand(index);
    return `set to pose ${pose + 1}`;
  }

  wordsByHand(index) {
    const { angle } = angleDeg(rotationMatrix(this.collection.shapes[index].R), this.rotation(index));
    const turned = `rotated by hand by ${degrees(angle)}`;
    if (!this.collection.isPlaced(index)) return turned;
    const [old, now] = [this.offered(index, CONFIRMED), this.shown(index)];
    const [from, to] = [old, now].map((matrix) => new Vector3(...this.collection.shapes[index].centroid).applyMatrix4(matrix));
    return `${turned}, moved by ${number(from.distanceTo(to) * this.collection.frame.unit)}, size × ${number(sizeOf(now) / sizeOf(old))}`;
  }

  // A pose as it is written to the file.
  record({ R, transform }) {
    if (!transform) return { rotation: R };
    const matrix = matrixOf(transform);
    return { rotation: rowsOf(turnOf(matrix)), translation: transform.slice(0, 3).map((row) => row[3]), scale: sizeOf(matrix) };
  }

  text() {
    const { shapes, doubtThreshold } = this.collection;
    const incomplete = shapes.filter((_, index) => this.collection.isPlaced(index)).map(({ name }) => name);
    const made = [...this.chosen.keys()].sort((a, b) => a - b);
    // A decision that was taken back frees its shape.
    const others = this.collection.certain(new Set([...made, ...this.collection.byHand]));
    const anchors = others.filter((index, rank) => rank === 0 || shapes[index].confidence >= doubtThreshold);
    const decisions = made.map((index) => ({
      shape: shapes[index].name,
      decision: [CONFIRMED, BEFORE].includes(this.poseOf(index)) ? "confirmed" : "pose",
      ...this.record(this.chosen.get(index)),
    }));
    // Whole poses: a shape that stays keeps its place and size as well.
    const frame = Object.fromEntries(anchors.map((index) => [shapes[index].name, this.record(shapes[index])]));
    return JSON.stringify({ format: "collalign-corrections", version: 2, decisions, frame, incomplete }, null, 1);
  }

  download() {
    const link = el("a", { href: URL.createObjectURL(new Blob([this.text()], { type: "application/json" })), download: "corrections.json" });
    link.click();
    URL.revokeObjectURL(link.href);
    this.saved = true;
  }
}

// The bar at the bottom of the window; hidden while there is nothing to save.
export function correctionBar(corrections, collection) {
  const list = el("ul", { class: "chips", "aria-label": "Decisions so far" });
  const count = el("strong", { role: "status" });
  const where = el("span", { class: "muted" });
  const command = commandBox(collection);
  const advice = el("span", { class: "muted" }, "Then run ", el("code", null, "collalign align … --corrections corrections.json"));
  const again = isShownByOpen ? null : collection.again;
  advice.hidden = Boolean(again) || isShownByOpen;
  const save = button("Download decisions", () => corrections.download(), { class: "primary", id: "download-decisions" });
  const bar = el("section", { class: "decisions", "aria-label": "Corrections", hidden: true }, count, list, save, advice, where, command.box);
  const show = () => {
    const made = [...corrections.chosen.keys()];
    const { changes } = corrections;
    bar.hidden = made.length === 0 && changes === 0;
    const all = made.length + corrections.leftOut.size;
    count.textContent = all ? `${all} ${all === 1 ? "decision" : "decisions"}` : "All decisions taken back";
    const text = made.length || collection.byHand.length ? corrections.text() : "";
    save.hidden = !text || isShownByOpen;
    if (isShownByOpen) where.textContent = changes ? "The first button at the top of the window applies them." : "They are applied. × takes one back.";
    else where.textContent = corrections.remembered === false ? "This browser keeps nothing for files: download before you close the page." : "Kept in this browser when the page is closed.";
    const chips = made.map((index) => {
      const { name } = collection.shapes[index];
      const undo = button("×", () => corrections.decide(index, null), { "aria-label": `Take back the decision on ${name}` });
      return el("li", { class: "chip" }, `${name}: ${corrections.words(index)} `, undo);
    });
    const others = [...corrections.leftOut].map((name) => {
      const undo = button("×", () => corrections.leaveOut(collection.shapes.findIndex((shape) => shape.name === name), false), { "aria-label": `Keep ${name}` });
      return el("li", { class: "chip" }, `${name}: left out `, undo);
    });
    list.replaceChildren(...chips, ...others);
    command.show(again && changes ? wholeCommand(collection, text, [...corrections.leftOut]) : "");
    tell("decisions.json", text);
    tell("exclude.json", JSON.stringify([...corrections.leftOut]));
  };
  corrections.onchange(show);
  show();
  return bar;
}
