// Decisions made by hand: which pose of a shape is right. The browser keeps them for this result, until they are downloaded as a
// file for `--corrections`.

import { angleDeg, rotationMatrix } from "./data.js";
import { button, degrees, el } from "./dom.js";
import { tell } from "./downloads.js";
import { keep, kept } from "./kept.js";

// What a decision says: the present pose is right, or this pose of those offered, or one turned by hand.
export const CONFIRMED = -1;
export const BY_HAND = -2;

export class Corrections {
  constructor(collection) {
    this.collection = collection;
    this.chosen = new Map();
    this.listeners = [];
    this.saved = true;
    for (const [name, decision] of Object.entries(kept(collection.run) ?? {})) {
      const index = collection.shapes.findIndex((shape) => shape.name === name);
      if (index >= 0) this.chosen.set(index, decision);
    }
    addEventListener("beforeunload", (event) => !this.saved && event.preventDefault());
  }

  onchange(listener) {
    this.listeners.push(listener);
  }

  // `pose` counts the shape's alternatives, or is CONFIRMED, or BY_HAND with the rows of R; null takes the decision back.
  decide(index, pose, R = null) {
    if (pose === null) this.chosen.delete(index);
    else this.chosen.set(index, { pose, R: R ?? this.offered(index, pose) });
    const decisions = [...this.chosen].map(([at, decision]) => [this.collection.shapes[at].name, decision]);
    this.remembered = keep(this.collection.run, Object.fromEntries(decisions));
    this.saved = this.chosen.size === 0 || this.remembered;
    this.listeners.forEach((listener) => listener(index));
  }

  offered(index, pose) {
    const shape = this.collection.shapes[index];
    return pose < 0 ? shape.R : shape.alternatives[pose].R;
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
    if (pose === BY_HAND) {
      const { angle } = angleDeg(rotationMatrix(this.collection.shapes[index].R), this.rotation(index));
      return `turned by hand by ${degrees(angle)}`;
    }
    return `set to pose ${pose + 1}`;
  }

  text() {
    const { shapes, doubtThreshold } = this.collection;
    const made = [...this.chosen.keys()].sort((a, b) => a - b);
    const others = this.collection.certain(new Set(made));
    const anchors = others.filter((index, rank) => rank === 0 || shapes[index].confidence >= doubtThreshold);
    const decisions = made.map((index) => ({
      shape: shapes[index].name,
      decision: this.poseOf(index) === CONFIRMED ? "confirmed" : "pose",
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
  const where = el("span", { class: "muted" });
  const advice = el("span", { class: "muted" }, "Then run ", el("code", null, "collalign align … --corrections corrections.json"));
  const save = button("Download decisions", () => corrections.download(), { class: "primary", id: "download-decisions" });
  const bar = el("section", { class: "decisions", "aria-label": "Corrections", hidden: true }, count, list, save, advice, where);
  const show = () => {
    const made = [...corrections.chosen.keys()];
    bar.hidden = made.length === 0;
    count.textContent = `${made.length} ${made.length === 1 ? "decision" : "decisions"}`;
    where.textContent = corrections.remembered === false ? "This browser keeps nothing for files: download before you close the page." : "Kept in this browser when the page is closed.";
    const chips = made.map((index) => {
      const { name } = collection.shapes[index];
      const undo = button("×", () => corrections.decide(index, null), { "aria-label": `Take back the decision on ${name}` });
      return el("li", { class: "chip" }, `${name}: ${corrections.words(index)} `, undo);
    });
    list.replaceChildren(...chips);
    tell("decisions.json", made.length ? corrections.text() : "");
  };
  corrections.onchange(show);
  show();
  return bar;
}
