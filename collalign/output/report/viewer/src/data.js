// Decodes what Python packed: JSON for the small, gzip + base64 of typed arrays for the large, each decoded when first asked for.

import { Color, Matrix3, Matrix4, Quaternion, SRGBColorSpace, Vector3 } from "three";
import { degrees } from "./dom.js";

const TYPES = { int8: Int8Array, uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array, float32: Float32Array };
const MISSING = -32768;

async function inflate(id) {
  const text = atob(document.getElementById(id).textContent);
  const bytes = Uint8Array.from(text, (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

export async function unpack(id, fields) {
  const buffer = await inflate(id);
  const arrays = {};
  let at = 0;
  for (const [name, type, length] of fields) {
    const end = at + length * TYPES[type].BYTES_PER_ELEMENT;
    arrays[name] = new TYPES[type](buffer.slice(at, end));
    at = end;
  }
  return arrays;
}

function dequantise(array, { centre, step }) {
  const out = new Float32Array(array.length);
  for (let at = 0; at < array.length; at++) {
    out[at] = array[at] === MISSING ? NaN : centre[at % 3] + array[at] * step;
  }
  return out;
}

export class Collection {
  constructor() {
    Object.assign(this, JSON.parse(document.getElementById("collalign-data").textContent));
    this.cache = new Map();
    this.meshStore = new Map();
  }

  // Vertices, faces and samples of a display mesh, in its own coordinates.
  mesh(id) {
    if (!this.meshStore.has(id)) {
      const info = this.meshes[id];
      const load = unpack(`mesh-${id}`, info.fields).then((arrays) => ({
        vertices: dequantise(arrays.vertices, info),
        faces: arrays.faces,
        samples: dequantise(arrays.samples, info),
        scalars: arrays.scalars,
      }));
      this.meshStore.set(id, load);
    }
    return this.meshStore.get(id);
  }

  // The pairs as arrays of equal length, and where each pair's poses begin.
  async loadPairs() {
    const arrays = await unpack("pairs", this.pairFields);
    const starts = new Uint32Array(arrays.i.length + 1);
    arrays.poseCount.forEach((count, pair) => (starts[pair + 1] = starts[pair] + count));
    const at = new Int32Array(this.shapes.length ** 2).fill(-1);
    arrays.i.forEach((i, pair) => {
      at[i * this.shapes.length + arrays.j[pair]] = pair;
      at[arrays.j[pair] * this.shapes.length + i] = pair;
    });
    this.pairs = { ...arrays, starts, at };
  }

  // One colour per corresponding point, by its mean place on the aligned shapes: the same on every shape.
  get pointColors() {
    this.pointColorCache ??= this.labelColors.map((rgb) => new Color().setRGB(...rgb, SRGBColorSpace));
    return this.pointColorCache;
  }

  // Shapes whose pose a person set for this result.
  get byHand() {
    return [...this.shapes.keys()].filter((index) => this.shapes[index].byHand);
  }

  // Whether a shape's pose is in doubt; one alone of its kind has no pose relative to others.
  isDoubtful(index) {
    const { alone, confidence } = this.shapes[index];
    return !alone && confidence < this.doubtThreshold;
  }

  // All shapes, the most doubtful first, and those alone of their kind last.
  get byDoubt() {
    const { shapes } = this;
    return [...shapes.keys()].sort((a, b) => shapes[a].alone - shapes[b].alone || shapes[a].confidence - shapes[b].confidence);
  }

  // Why a shape's pose is marked, in a word; empty where it is not.
  mark(index) {
    const { alone, part } = this.shapes[index];
    if (alone) return "alone of its kind";
    if (this.isDoubtful(index)) return "doubtful";
    return part === this.mainPart ? "" : "not surely joined";
  }

  // Shapes of the largest part, the most certain first, without those in `left`.
  certain(left) {
    const members = this.shapes.map((_, at) => at).filter((at) => this.shapes[at].part === this.mainPart && !left.has(at));
    return members.sort((a, b) => this.shapes[b].confidence - this.shapes[a].confidence);
  }

  // Whether a pose of a shape has a translation and a size of its own: it is incomplete.
  isPlaced(index) {
    const { coverage, transform } = this.shapes[index];
    return coverage !== null && Boolean(transform);
  }

  // The display in the common frame: its unit, and what lies in its middle.
  get frame() {
    const { transform, scale, centroid, offset } = this.shapes[0];
    const matrix = matrixOf(transform);
    const unit = sizeOf(matrix) / scale;
    return { unit, middle: new Vector3(...centroid).applyMatrix4(matrix).addScaledVector(new Vector3(...offset), -unit) };
  }

  // Takes the common frame to the display.
  get toDisplay() {
    const { unit, middle } = this.frame;
    return new Matrix4().makeScale(1 / unit, 1 / unit, 1 / unit).multiply(new Matrix4().makeTranslation(middle.negate()));
  }

  pairAt(a, b) {
    return this.pairs.at[a * this.shapes.length + b];
  }

  poses(pair) {
    const { starts, poseEnergy, poseRotation, poseMirrored } = this.pairs;
    const poses = [];
    for (let at = starts[pair]; at < starts[pair + 1]; at++) {
      const q = poseRotation.subarray(4 * at, 4 * at + 4);
      const R = new Matrix4().makeRotationFromQuaternion(new Quaternion(q[0], q[1], q[2], q[3]).normalize());
      if (poseMirrored[at]) R.multiply(new Matrix4().makeScale(-1, -1, -1));
      poses.push({ R, energy: poseEnergy[at] });
    }
    return poses;
  }

  // How far the pair's own best pose is from the collection's, in words.
  disagreement(pair) {
    return this.pairs.mirrored[pair] ? "reflected" : degrees(this.pairs.disagreement[pair]);
  }

  // What synchronization made of a pair, in words.
  use(pair) {
    const { inlier, choice } = this.pairs;
    if (!inlier[pair]) return "left out";
    return choice[pair] > 0 ? `used with its alternative ${choice[pair]}` : "used";
  }

  // Label on shape i of each sample of shape j by the pair's own matching; equal labels where it kept none.
  pairMap(pair) {
    const { map } = this.pairs;
    const k = this.numSamples;
    if (!map.length || map[pair * k] === -2) return Int16Array.from({ length: k }, (_, label) => label);
    return map.subarray(pair * k, (pair + 1) * k);
  }
}

export function matrixOf(rows) {
  return new Matrix4().set(...rows.flat());
}

// Factor by which a similarity enlarges, and its rotation.
export function sizeOf(matrix) {
  return Math.cbrt(Math.abs(matrix.determinant()));
}

export function turnOf(matrix) {
  const size = 1 / sizeOf(matrix);
  return matrix.clone().setPosition(0, 0, 0).multiply(new Matrix4().makeScale(size, size, size));
}

export function rowsOf({ elements: e }, size = 3) {
  return Array.from({ length: size }, (_, row) => Array.from({ length: size }, (_, column) => e[row + 4 * column]));
}

export function rotationMatrix(rows) {
  const m = new Matrix3().set(...rows.flat());
  return new Matrix4().setFromMatrix3(m);
}

// Takes file coordinates to the display: rotation R about the shape's centroid, common scale, then an offset.
export function poseMatrix(shape, R, offset = [0, 0, 0]) {
  const toOrigin = new Matrix4().makeTranslation(new Vector3(...shape.centroid).negate());
  const scale = new Matrix4().makeScale(shape.scale, shape.scale, shape.scale);
  return new Matrix4().makeTranslation(new Vector3(...offset)).multiply(R).multiply(scale).multiply(toOrigin);
}

export function angleDeg(A, B) {
  const relative = new Matrix4().copy(A).transpose().multiply(B);
  const sign = Math.sign(relative.determinant());
  const trace = sign * (relative.elements[0] + relative.elements[5] + relative.elements[10]);
  return { angle: (Math.acos(Math.min(1, Math.max(-1, (trace - 1) / 2))) * 180) / Math.PI, mirrored: sign < 0 };
}
