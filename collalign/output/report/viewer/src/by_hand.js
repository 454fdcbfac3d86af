// Any pose, set by hand: here dragging turns the shape and leaves the view and the shape beneath it as they are.

import { Matrix4 } from "three";
import { BY_HAND } from "./corrections.js";
import { button, el } from "./dom.js";
import { posed } from "./layers.js";
import { turnOnScreen } from "./turning.js";

const ROLL = Math.PI / 12;

function rowsOf({ elements: e }) {
  return [0, 1, 2].map((row) => [e[row], e[row + 4], e[row + 8]]);
}

// Adds the figure to `row`; returns what brings its button up to date. `decided` is called after every decision.
export function turnByHand(app, drawn, row, index, ghost, decided) {
  const { stage, corrections, collection } = app;
  let R = corrections.rotation(index);
  const turn = (...angles) => {
    const view = new Matrix4().makeRotationFromQuaternion(stage.orientation);
    const screen = new Matrix4().makeRotationFromQuaternion(turnOnScreen(...angles));
    show(view.clone().transpose().multiply(screen).multiply(view).multiply(R));
  };
  const { tile, figure } = drawn.add(row, "turn the shape by hand: drag, or focus and use the arrow keys",
    () => [posed(app, index, R), ...ghost()], { turn });
  const show = (next) => {
    R = next;
    if (use.getAttribute("aria-pressed") === "true") corrections.decide(index, BY_HAND, rowsOf(R));
    stage.refresh(tile);
  };
  const use = button("Use this pose", () => {
    const taken = corrections.poseOf(index) === BY_HAND;
    corrections.decide(index, taken ? null : BY_HAND, rowsOf(R));
    decided();
  }, { class: "by-hand" });
  const mirror = () => {
    const view = new Matrix4().makeRotationFromQuaternion(stage.orientation);
    show(view.clone().transpose().multiply(new Matrix4().makeScale(-1, 1, 1)).multiply(view).multiply(R));
  };
  figure.append(el("div", { class: "row" }, use,
    button("↺", () => turn(0, 0, ROLL), { "aria-label": "Turn by 15° against the clock" }),
    button("↻", () => turn(0, 0, -ROLL), { "aria-label": "Turn by 15° with the clock" }),
    collection.options.decided?.group === "O" ? button("Mirror", mirror) : ""));
  const update = () => use.setAttribute("aria-pressed", String(corrections.poseOf(index) === BY_HAND));
  update();
  return update;
}
