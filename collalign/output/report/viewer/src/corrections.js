// Decisions made by hand: which pose of a shape is right. They are kept until downloaded as a file for `--corrections`.

import { rotationMatrix } from "./data.js";
import { button, el } from "./dom.js";

export class Corrections {
  constructor(collection) {
    this.collection = collection;
    this.chosen = new Map();
    this.listeners = [];
    this.saved = true;
    addEventListener("beforeunload", (event) => !this.saved && event.preventDefault());
  }

  onchange(listener) {
    this.listeners.push(listener);
  }

  // `pose` counts the shape's alternatives; -1 says that the present pose is right; null takes the decision back.
  decide(index, pose) {
    if (pose === null) this.chosen.delete(index);
    else this.chosen.set(index, pose);
    this.saved = this.chosen.size === 0;
    this.listeners.forEach((listener) => listener(index));
  }

  poseOf(index) {
    return this.chosen.get(index) ?? -1;
  }

  rows(index) {
    const shape = this.collection.shapes[index];
    const pose = this.poseOf(index);
    return pose < 0 ? shape.R : shape.alternatives[pose].R;
  }

  rotation(index) {
    return rotationMatrix(this.rows(index));
  }

  words(index) {
    if (!this.chosen.has(index)) return "";
    const pose = this.chosen.get(index);
    return pose < 0 ? "pose confirmed" : `set to pose ${pose + 1}`;
  }

  text() {
    const { shapes, doubtThreshold } = this.collection;
    const made = [...this.chosen.keys()].sort((a, b) => a - b);
    const others = this.collection.certain(new Set(made));
    const anchors = others.filter((index, rank) => rank === 0 || shapes[index].confidence >= doubtThreshold);
    const decisions = made.map((index) => ({
      shape: shapes[index].name,
      decision: this.chosen.get(index) < 0 ? "confirmed" : "pose",
      rotation: this.rows(index),
    }));
    const frame = Object.fromEntries(anchors.map((index) => [shapes[index].name, shapes[index].R]));
    return JSON.stringify({ format: "collalign-corrections", version: 1, decisions, frame }, null, 1);
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
  const advice = el("span", { class: "muted" }, "Then run ", el("code", null, "collalign align … --corrections corrections.json"));
  const save = button("Download decisions", () => corrections.download(), { class: "primary", id: "download-decisions" });
  const bar = el("section", { class: "decisions", "aria-label": "Corrections", hidden: true }, count, list, save, advice);
  corrections.onchange(() => {
    const made = [...corrections.chosen.keys()];
    bar.hidden = made.length === 0;
    count.textContent = `${made.length} ${made.length === 1 ? "decision" : "decisions"}`;
    const chips = made.map((index) => {
      const { name } = collection.shapes[index];
      const undo = button("×", () => corrections.decide(index, null), { "aria-label": `Take back the decision on ${name}` });
      return el("li", { class: "chip" }, `${name}: ${corrections.words(index)} `, undo);
    });
    list.replaceChildren(...chips);
  });
  return bar;
}
