// Surfaces in correspondence: the mean, its components and every shape as offsets from it, and what can be drawn of them.

import { BufferAttribute, BufferGeometry, ConeGeometry, DoubleSide, InstancedMesh, Matrix4, Mesh, MeshLambertMaterial, Quaternion, Vector3 } from "three";
import { categorical, diverging, linear } from "./colors.js";
import { unpack } from "./data.js";

const MOST_ARROWS = 350;
const UP = new Vector3(0, 1, 0);

export async function loadVariation(content) {
  const arrays = await unpack("variation", content.fields);
  return new Variation(content, arrays);
}

class Variation {
  constructor(content, { mean, axes, shapes, faces, colors, symmetricMean, asymmetric, distances }) {
    Object.assign(this, content, { faces, size: mean.length });
    this.packed = { axes, shapes, asymmetric, distances };
    const radius = mean.reduce((most, value) => Math.max(most, Math.abs(value)), 1) * content.steps.mean;
    this.unit = 1 / radius;
    this.mean = Float32Array.from(mean, (value) => value * content.steps.mean);
    this.colors = Float32Array.from(colors, (value) => linear(value / 255));
    this.normals = this.geometry(this.mean).getAttribute("normal").array;
    if (symmetricMean) {
      this.symmetricMean = Float32Array.from(symmetricMean, (value) => value * content.steps.symmetricMean);
      this.symmetricNormals = this.geometry(this.symmetricMean).getAttribute("normal").array;
    }
  }

  // Row `at` of a packed array, times a factor, added to a surface.
  add(surface, name, at, factor) {
    const step = this.steps[name] * factor;
    const from = at * this.size;
    const packed = this.packed[name];
    for (let i = 0; i < this.size; i++) surface[i] += packed[from + i] * step;
    return surface;
  }

  shape(at) {
    return this.add(this.mean.slice(), "shapes", at, 1);
  }

  // The mean moved by so many standard deviations along every component.
  along(deviations) {
    return deviations.reduce((surface, factor, at) => (factor ? this.add(surface, "axes", at, factor) : surface), this.mean.slice());
  }

  // Distances of a fitted surface to its specimen at every vertex, in radii.
  distances(at) {
    const num = this.size / 3;
    return Float32Array.from(this.packed.distances.subarray(at * num, (at + 1) * num), (value) => value * this.steps.distances);
  }

  groupMean(members) {
    return members.reduce((surface, at) => this.add(surface, "shapes", at, 1 / members.length), this.mean.slice());
  }

  // The symmetric mean with the asymmetric component of all (0) or of a specimen (from 1), so many times over.
  asymmetricSurface(at, factor) {
    return this.add(this.symmetricMean.slice(), "asymmetric", at, factor);
  }

  // How far `other` is outside of `surface` at every vertex, along the normals of the mean.
  offsets(surface, other, normals = this.normals) {
    const out = new Float32Array(this.size / 3);
    for (let i = 0; i < this.size; i++) out[Math.floor(i / 3)] += (other[i] - surface[i]) * normals[i];
    return out;
  }

  geometry(positions) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    geometry.setIndex(new BufferAttribute(this.faces, 1));
    geometry.computeVertexNormals();
    return geometry;
  }

  // A mesh whose shape and colours can be changed: `show(positions, offsets, largest)`.
  surface(colors = null) {
    const geometry = this.geometry(this.mean.slice());
    geometry.setAttribute("color", new BufferAttribute(colors ?? new Float32Array(this.size).fill(0.7), 3));
    const mesh = new Mesh(geometry, new MeshLambertMaterial({ side: DoubleSide, vertexColors: true }));
    mesh.matrixAutoUpdate = false;
    mesh.matrix.makeScale(this.unit, this.unit, this.unit);
    mesh.show = (positions, offsets, largest) => {
      geometry.getAttribute("position").copyArray(positions).needsUpdate = true;
      geometry.computeVertexNormals();
      if (offsets) {
        const paint = geometry.getAttribute("color");
        offsets.forEach((value, at) => paint.setXYZ(at, ...diverging(0.5 + (0.5 * value) / (largest || 1)).toArray()));
        paint.needsUpdate = true;
      }
    };
    return mesh;
  }

  // Needles from one surface to where another is, at vertices spread over it, lengths times a factor.
  arrows(surface, other, factor) {
    const every = Math.max(1, Math.ceil(this.size / 3 / MOST_ARROWS));
    const chosen = Array.from({ length: Math.ceil(this.size / 3 / every) }, (_, at) => at * every);
    const needle = new ConeGeometry(0.012, 1, 6).translate(0, 0.5, 0);
    const mesh = new InstancedMesh(needle, new MeshLambertMaterial({ color: categorical(2) }), chosen.length);
    chosen.forEach((vertex, at) => {
      const from = new Vector3().fromArray(surface, 3 * vertex);
      const way = new Vector3().fromArray(other, 3 * vertex).sub(from).multiplyScalar(factor * this.unit);
      const turn = new Quaternion().setFromUnitVectors(UP, way.clone().normalize());
      mesh.setMatrixAt(at, new Matrix4().compose(from.multiplyScalar(this.unit), turn, new Vector3(1, way.length(), 1)));
    });
    mesh.frustumCulled = false;
    return mesh;
  }
}

export function largestOf(offsets) {
  return offsets.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
}
