// What is drawn of a shape: before, after (with decisions made by hand), in any other pose.

import { Matrix4 } from "three";
import { poseMatrix } from "./data.js";
import { BONE, GREY } from "./colors.js";

export function before(app, index) {
  const shape = app.collection.shapes[index];
  return { mesh: shape.mesh, matrix: poseMatrix(shape, new Matrix4()), color: GREY };
}

export function after(app, index, look = {}) {
  return app.corrections.layer(index, app.corrections.inPlace(index), look);
}

export function posed(app, index, R, look = {}) {
  const shape = app.collection.shapes[index];
  return { mesh: shape.mesh, matrix: poseMatrix(shape, R), color: BONE, ...look };
}

export function percent(confidence) {
  return `${Math.floor(100 * confidence + 1e-9)} %`;
}
