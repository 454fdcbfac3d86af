// Any pose, set by hand: here dragging turns or moves the shape and leaves the view and the shape beneath it as they are.

import { Matrix4, Vector3 } from "three";
import { BY_HAND, CONFIRMED } from "./corrections.js";
import { angleDeg, turnOf } from "./data.js";
import { button, degrees, el } from "./dom.js";
import { turnOnScreen } from "./turning.js";

const ROLL = Math.PI / 12;
const GROWTH = 1.02;
// What a drag or an arrow key asks for, per pixel of a drag.
const PER_PIXEL = 0.01;

function numberField(label, step, onchange) {
  const box = el("input", { type: "number", step, onchange: () => Number.isFinite(box.valueAsNumber) && onchange(box.valueAsNumber) });
  return { box, field: el("label", { class: "field" }, el("span", null, label), box) };
}

// The pose of one shape on the display, and what changes it; `changed` is called after each change.
class Pose {
  constructor(app, index, changed) {
    Object.assign(this, { stage: app.stage, corrections: app.corrections, collection: app.collection, index, changed });
    this.centroid = new Vector3(...app.collection.shapes[index].centroid);
    this.matrix = app.corrections.shown(index);
  }

  get centre() {
    return this.centroid.clone().applyMatrix4(this.matrix);
  }

  set(matrix) {
    this.matrix = matrix;
    this.changed();
  }

  // Applies a linear map of the screen, or of the display, about the middle of the shape.
  about(linear, { onScreen = true } = {}) {
    const view = new Matrix4().makeRotationFromQuaternion(this.stage.orientation);
    const map = onScreen ? view.clone().transpose().multiply(linear).multiply(view) : linear;
    const centre = this.centre;
    const back = new Matrix4().makeTranslation(centre.clone().negate());
    this.set(new Matrix4().makeTranslation(centre).multiply(map).multiply(back).multiply(this.matrix));
  }

  turn(...angles) {
    this.about(new Matrix4().makeRotationFromQuaternion(turnOnScreen(...angles)));
  }

  mirror() {
    this.about(new Matrix4().makeScale(-1, 1, 1));
  }

  grow(factor) {
    this.about(new Matrix4().makeScale(factor, factor, factor), { onScreen: false });
  }

  move(right, down) {
    this.shift(new Vector3(right, -down, 0).applyQuaternion(this.stage.orientation.clone().invert()));
  }

  shift(by) {
    this.set(new Matrix4().makeTranslation(by).multiply(this.matrix));
  }

  // Takes the offered pose whose rotation is nearest, of the same handedness where there is one; returns what was taken.
  snap() {
    const poses = [CONFIRMED, ...this.collection.shapes[this.index].alternatives.keys()].map((pose) => {
      const matrix = this.corrections.offered(this.index, pose);
      return { pose, matrix, ...angleDeg(turnOf(this.matrix), turnOf(matrix)) };
    });
    const [best] = poses.sort((a, b) => a.mirrored - b.mirrored || a.angle - b.angle);
    this.set(best.matrix.clone());
    return `${best.pose === CONFIRMED ? "the present pose" : `pose ${best.pose + 1}`}, ${degrees(best.angle)} away`;
  }
}

// Numbers of the middle's place in the common frame, and of the size.
function placeFields(app, pose) {
  const { collection, corrections } = app;
  const { unit, middle } = collection.frame;
  const first = corrections.offered(pose.index, CONFIRMED);
  const sizeNow = () => Math.cbrt(Math.abs(pose.matrix.determinant() / first.determinant()));
  const step = 10 ** Math.floor(Math.log10(unit / 50));
  const axes = ["x", "y", "z"].map((axis, at) => numberField(axis, step, (value) => {
    const by = new Vector3();
    by.setComponent(at, (value - middle.getComponent(at)) / unit - pose.centre.getComponent(at));
    pose.shift(by);
  }));
  const size = numberField("size", 0.01, (value) => value > 0 && pose.grow(value / sizeNow()));
  const update = () => {
    axes.forEach(({ box }, at) => (box.value = (pose.centre.getComponent(at) * unit + middle.getComponent(at)).toFixed(Math.max(0, 1 - Math.log10(step)))));
    size.box.value = sizeNow().toFixed(4);
  };
  const sized = collection.options.scaling === "rigid" ? [] : [
    size.field,
    button("−", () => pose.grow(1 / GROWTH), { "aria-label": "Smaller by 2 %" }),
    button("+", () => pose.grow(GROWTH), { "aria-label": "Larger by 2 %" })];
  const words = "Centre of the shape in the common frame, and its size compared with now (1 is unchanged)";
  return { update, row: el("div", { class: "row numbers", role: "group", "aria-label": words, title: words }, el("span", { class: "muted" }, "Middle at"), ...axes.map(({ field }) => field), ...sized) };
}

// Adds the figure to `row`; returns what brings its button up to date. `decided` is called after every decision.
export function poseByHand(app, drawn, row, index, ghost, decided) {
  const { stage, corrections, collection } = app;
  const placed = collection.isPlaced(index);
  const said = el("span", { class: "muted", role: "status" });
  const pose = new Pose(app, index, () => {
    if (use.getAttribute("aria-pressed") === "true") corrections.decide(index, BY_HAND, pose.matrix);
    fields?.update();
    stage.refresh(tile);
  });
  const moves = el("input", { type: "checkbox" });
  const turn = (dx, dy, event) => {
    const pixel = stage.pixel(tile) / PER_PIXEL;
    if (placed && moves.checked !== Boolean(event?.shiftKey)) pose.move(dx * pixel, dy * pixel);
    else pose.turn(dx, dy);
  };
  const words = placed ? "place the shape by hand: drag it, or use the arrow keys, to rotate it; hold Shift to move it"
    : "rotate the shape by hand: drag it, or use the arrow keys";
  const { tile, figure } = drawn.add(row, words, () => [corrections.layer(index, pose.matrix), ...ghost()], { turn });
  const use = button("Use this pose", () => {
    const taken = corrections.poseOf(index) === BY_HAND;
    corrections.decide(index, taken ? null : BY_HAND, pose.matrix);
    decided();
  }, { class: "by-hand" });
  const fields = placed ? placeFields(app, pose) : null;
  fields?.update();
  figure.classList.add("placing");
  figure.append(el("div", { class: "row" }, use,
    button("↺", () => pose.turn(0, 0, ROLL), { "aria-label": "Rotate by 15° counterclockwise" }),
    button("↻", () => pose.turn(0, 0, -ROLL), { "aria-label": "Rotate by 15° clockwise" }),
    collection.options.decided?.group === "O" ? button("Reflect", () => pose.mirror()) : "",
    button("Snap to nearest", () => (said.textContent = `Snapped to ${pose.snap()}.`)),
    placed ? el("label", { class: "check" }, moves, "drag moves") : "", said), fields?.row ?? "");
  const update = () => use.setAttribute("aria-pressed", String(corrections.poseOf(index) === BY_HAND));
  update();
  return update;
}
