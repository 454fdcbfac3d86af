// Turns layers (which mesh, where, in which colour) into three.js objects, sharing geometries and materials.

import {
  BufferAttribute, BufferGeometry, Color, DoubleSide, Group, InstancedMesh, MathUtils, Matrix4, Mesh, MeshLambertMaterial, Points, PointsMaterial,
  SphereGeometry, Vector3,
} from "three";
import { linear, viridis } from "./colors.js";

// One colour, or without one that of each vertex.
function paintOf(color) {
  return color ? { color: new Color(color) } : { vertexColors: true };
}

export class Assets {
  constructor(collection) {
    this.collection = collection;
    this.geometries = new Map();
    this.materials = new Map();
    this.dot = new SphereGeometry(0.03, 10, 8);
  }

  async group(layers) {
    const group = new Group();
    for (const layer of layers) group.add(...(await this.objects(layer)));
    return group;
  }

  // A layer: { object }, made already, or { mesh, matrix, color, opacity, points (a colour or null per sample), surface,
  // values (whether vertices that have both, a colour and a value, are coloured by this) }.
  async objects({ object, mesh: id, matrix, color, opacity = 1, points, surface = true, values = false }) {
    if (object) return [object];
    const mesh = await this.collection.mesh(id);
    const out = [];
    if (surface) {
      const geometry = this.geometry(id, mesh, values);
      const paint = mesh.scalars.length ? null : color;
      const object = mesh.faces.length
        ? new Mesh(geometry, this.surfaceMaterial(paint, opacity))
        : new Points(geometry, this.pointMaterial(paint, mesh.vertices.length / 3));
      object.matrixAutoUpdate = false;
      object.matrix.copy(matrix);
      out.push(object);
    }
    if (points) out.push(this.dots(mesh.samples, points, matrix));
    return out;
  }

  geometry(id, mesh, values) {
    const key = `${id} ${values}`;
    if (!this.geometries.has(key)) {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(mesh.vertices, 3));
      if (mesh.scalars.length) {
        // Of each vertex a share, or red, green and blue, or these and a share.
        const width = (3 * mesh.scalars.length) / mesh.vertices.length;
        const byShare = width === 1 || (values && width === 4);
        const colors = [];
        for (let at = 0; at < mesh.scalars.length; at += width) {
          const own = [...mesh.scalars.subarray(at, at + width)].map((value) => value / 255);
          colors.push(...(byShare ? viridis(own[width - 1]).toArray() : own.slice(0, 3).map(linear)));
        }
        geometry.setAttribute("color", new BufferAttribute(new Float32Array(colors), 3));
      }
      if (mesh.faces.length) {
        geometry.setIndex(new BufferAttribute(mesh.faces, 1));
        geometry.computeVertexNormals();
      }
      this.geometries.set(key, geometry);
    }
    return this.geometries.get(key);
  }

  surfaceMaterial(color, opacity) {
    return this.shared(`surface ${color} ${opacity}`, () => {
      const clear = opacity < 1 ? { transparent: true, opacity, depthWrite: false } : {};
      return new MeshLambertMaterial({ side: DoubleSide, ...paintOf(color), ...clear });
    });
  }

  // Few points are drawn large enough to be seen, in pixels.
  pointMaterial(color, number) {
    const size = MathUtils.clamp(40 / Math.sqrt(number), 2.5, 6);
    return this.shared(`points ${color} ${size}`, () => new PointsMaterial({ ...paintOf(color), size, sizeAttenuation: false }));
  }

  shared(key, make) {
    if (!this.materials.has(key)) this.materials.set(key, make());
    return this.materials.get(key);
  }

  // Small spheres of fixed size on the display, whatever the scale of the shape.
  dots(samples, colors, matrix) {
    const shown = colors.map((color, label) => [color, label]).filter(([color, label]) => color && !Number.isNaN(samples[3 * label]));
    const material = this.shared("dots", () => new MeshLambertMaterial());
    const dots = new InstancedMesh(this.dot, material, shown.length);
    shown.forEach(([color, label], at) => {
      const place = new Vector3(...samples.subarray(3 * label, 3 * label + 3)).applyMatrix4(matrix);
      dots.setMatrixAt(at, new Matrix4().makeTranslation(place));
      dots.setColorAt(at, color);
    });
    dots.frustumCulled = false;
    return dots;
  }
}
