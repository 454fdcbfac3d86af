// Where on a drawn surface the pointer is.

import { Matrix4, Mesh, Points, Raycaster, Vector3 } from "three";

const NEAR = 0.03; // of the display: how far from the line of sight a point of a cloud may be

// The pixel of a canvas that a pointer event is over, and how many of them a pixel of the window has.
export function pixelOf(event, canvas) {
  const { left, top, width } = canvas.getBoundingClientRect();
  const ratio = canvas.width / width;
  return { x: (event.clientX - left) * ratio, y: (event.clientY - top) * ratio, ratio };
}

// The place in the coordinates of the mesh that `matrix` brings to the display; null outside it.
export function pointOnSurface(stage, tile, event, mesh, geometry, matrix) {
  const { width, height } = tile.canvas;
  const { x, y } = pixelOf(event, tile.canvas);
  stage.aim(width / height, tile);
  const { left, right, top, bottom } = stage.camera;
  const back = stage.orientation.clone().invert();
  const inverse = new Matrix4().copy(matrix).invert();
  const eye = new Vector3(left + (x / width) * (right - left), top - (y / height) * (top - bottom), 50).applyQuaternion(back).applyMatrix4(inverse);
  const way = new Vector3(0, 0, -1).applyQuaternion(back).transformDirection(inverse);
  const caster = new Raycaster(eye, way);
  caster.params.Points.threshold = NEAR / matrix.getMaxScaleOnAxis();
  const [hit] = caster.intersectObject(mesh.faces.length ? new Mesh(geometry, stage.assets.surfaceMaterial("white", 1)) : new Points(geometry));
  if (!hit) return null;
  return mesh.faces.length ? hit.point.toArray() : [...mesh.vertices.subarray(3 * hit.index, 3 * hit.index + 3)];
}
