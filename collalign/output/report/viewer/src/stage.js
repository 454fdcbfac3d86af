// Hidden WebGL renderers for any number of 2D canvases: a browser keeps only 16 WebGL contexts. A canvas is drawn when
// it is visible and something changed; the others follow when nothing moves, so that printing finds them drawn.

import { AmbientLight, DirectionalLight, Group, Matrix4, OrthographicCamera, Quaternion, Scene, WebGLRenderer } from "three";
import { Assets } from "./assets.js";
import { makeTurnable, turnOnScreen } from "./turning.js";

const SMALL = 512;
const MARGIN = 1.06;
const FRAME_BUDGET_MS = 40;
const SPIN_PER_S = 0.9;

function startRenderer() {
  try {
    const renderer = new WebGLRenderer({ antialias: true, alpha: true });
    renderer.setSize(1, 1, false);
    return renderer;
  } catch {
    return null;
  }
}

export class Stage {
  constructor(collection) {
    this.assets = new Assets(collection);
    this.tiles = new Set();
    const [x, y, z] = collection.camera.R;
    this.home = new Quaternion().setFromRotationMatrix(new Matrix4().set(...x, 0, ...y, 0, ...z, 0, 0, 0, 0, 1));
    this.extent = collection.camera.extent;
    this.orientation = this.home.clone();
    this.spinning = false;
    this.moving = false;
    this.camera = new OrthographicCamera(-1, 1, 1, -1, -50, 50);
    this.scene = new Scene();
    this.root = new Group();
    this.addLights();
    this.small = startRenderer();
    this.watcher = new IntersectionObserver((entries) => this.noticeVisible(entries));
    this.sizes = new ResizeObserver((entries) => entries.forEach(({ target }) => this.resize(target.tile)));
    addEventListener("beforeprint", () => this.tiles.forEach((tile) => tile.dirty && this.draw(tile)));
  }

  get works() {
    return this.small !== null;
  }

  addLights() {
    const sun = new DirectionalLight(0xffffff, 2.1);
    sun.position.set(-0.5, 0.9, 1.2);
    const fill = new DirectionalLight(0xffffff, 0.5);
    fill.position.set(1, -0.6, 0.6);
    this.scene.add(new AmbientLight(0xffffff, 0.75), sun, fill, this.root);
  }

  // Show on `canvas` what the (possibly asynchronous) `layers` returns; turning one canvas turns all, unless `turn` takes the turns.
  // `fitted` drawings hold shapes in the common frame, which fill them; `annotate` writes on the canvas afterwards, given its 2D context and where a point (Vector3) is on it.
  add(canvas, layers, { zoomable = false, handle = canvas, turn = null, annotate = null, fitted = false } = {}) {
    const tile = { canvas, layers, annotate, fitted, zoom: 1, dirty: true, visible: false, group: null, loading: null };
    canvas.tile = tile;
    canvas.width = 0;
    this.tiles.add(tile);
    if (handle) this.turnable(handle, tile, zoomable, turn);
    this.watcher.observe(canvas);
    this.sizes.observe(canvas);
    return tile;
  }

  // Dragging on `handle` turns; what listens before may take the pointer for itself.
  turnable(handle, tile, zoomable = true, turn = null) {
    makeTurnable(handle, {
      turn: turn ?? ((dx, dy) => this.turn(dx, dy)), // else as `turn` says, which learns of the event, too
      setMoving: (moving) => this.setMoving(moving),
      zoom: zoomable ? (factor) => this.zoom(tile, factor) : null,
    });
  }

  remove(tile) {
    this.tiles.delete(tile);
    this.watcher.unobserve(tile.canvas);
    this.sizes.unobserve(tile.canvas);
    this.forget(tile);
  }

  forget(tile) {
    tile.group?.traverse((node) => node.isInstancedMesh && node.dispose());
    tile.group = null;
    tile.loading = null;
  }

  // The layers of a tile changed.
  refresh(tile) {
    this.forget(tile);
    this.invalidate(tile);
  }

  invalidate(only) {
    for (const tile of only ? [only] : this.tiles) tile.dirty = true;
    this.request();
  }

  request() {
    if (!this.frame && this.works) this.frame = requestAnimationFrame((time) => this.tick(time));
  }

  tick(time) {
    this.frame = null;
    if (this.spinning) this.turn(Math.min(0.1, (time - (this.last ?? time)) / 1000) * SPIN_PER_S, 0);
    this.last = this.spinning ? time : null;
    const waiting = [...this.tiles].filter((tile) => tile.dirty && !tile.loading && tile.canvas.clientWidth);
    waiting.filter((tile) => tile.visible).forEach((tile) => this.draw(tile));
    const until = performance.now() + FRAME_BUDGET_MS;
    const hidden = this.spinning || this.moving ? [] : waiting.filter((tile) => !tile.visible);
    for (const tile of hidden) if (performance.now() < until) this.draw(tile);
    if (this.spinning || hidden.some((tile) => tile.dirty && !tile.loading)) this.request();
  }

  turn(dx, dy) {
    this.orientation.premultiply(turnOnScreen(dx, dy)).normalize();
    this.invalidate();
  }

  resetView() {
    this.orientation.copy(this.home);
    for (const tile of this.tiles) tile.zoom = 1;
    this.invalidate();
  }

  spin(on) {
    this.spinning = on;
    this.request();
  }

  setMoving(moving) {
    this.moving = moving;
    if (!moving) this.request();
  }

  zoom(tile, factor) {
    tile.zoom = Math.min(12, Math.max(0.3, tile.zoom * factor));
    this.invalidate(tile);
  }

  noticeVisible(entries) {
    for (const { target, isIntersecting } of entries) target.tile.visible = isIntersecting;
    this.request();
  }

  resize(tile) {
    const ratio = Math.min(2, devicePixelRatio || 1);
    const width = Math.round(tile.canvas.clientWidth * ratio);
    const height = Math.round(tile.canvas.clientHeight * ratio);
    if (!width || !height || (tile.canvas.width === width && tile.canvas.height === height)) return;
    Object.assign(tile.canvas, { width, height });
    this.invalidate(tile);
  }

  async load(tile) {
    const loading = Promise.resolve(tile.layers()).then((layers) => this.assets.group(layers));
    tile.loading = loading;
    const group = await loading;
    if (tile.loading !== loading) return;
    tile.loading = null;
    tile.group = group;
    this.invalidate(tile);
  }

  draw(tile) {
    const { width, height, clientWidth } = tile.canvas;
    if (!tile.group) {
      if (!tile.loading) this.load(tile);
      return;
    }
    if (!width || !clientWidth) return;
    const renderer = this.rendererFor(width, height);
    this.aim(width / height, tile);
    this.root.add(tile.group);
    renderer.setViewport(0, 0, width, height);
    renderer.setScissor(0, 0, width, height);
    renderer.setScissorTest(true);
    renderer.render(this.scene, this.camera);
    this.root.remove(tile.group);
    const context = tile.canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    context.drawImage(renderer.domElement, 0, renderer.domElement.height - height, width, height, 0, 0, width, height);
    tile.annotate?.(context, (point) => this.project(point, width, height), this.orientation);
    tile.dirty = false;
    tile.canvas.dataset.drawn = "yes";
  }

  // How far what is seen reaches to the side and upwards: as it lies in its box, turned or not, but no more than its radius.
  reach() {
    const { elements } = new Matrix4().makeRotationFromQuaternion(this.orientation.clone().multiply(this.home.clone().invert()));
    const along = (row) => this.extent.reduce((sum, size, axis) => sum + Math.abs(elements[row + 4 * axis]) * size, 0);
    return [0, 1].map((row) => Math.max(this.extent[row], Math.min(1, along(row))));
  }

  // Half the height of what a canvas shows.
  halfHeight(aspect, { zoom, fitted }) {
    const [wide, high] = fitted ? this.reach() : [1, 1];
    return (MARGIN * Math.max(wide / aspect, high)) / zoom;
  }

  // How far a pixel of the page is on what a canvas shows.
  pixel(tile) {
    const { clientWidth, clientHeight } = tile.canvas;
    return (2 * this.halfHeight(clientWidth / clientHeight, tile)) / clientHeight;
  }

  aim(aspect, tile) {
    const y = this.halfHeight(aspect, tile);
    const x = y * aspect;
    Object.assign(this.camera, { left: -x, right: x, top: y, bottom: -y });
    this.camera.updateProjectionMatrix();
    this.root.quaternion.copy(this.orientation);
  }

  // Where a point of the scene is on a canvas, as aimed last.
  project(point, width, height) {
    const { x, y } = point.clone().applyQuaternion(this.orientation);
    const { left, right, top, bottom } = this.camera;
    return [((x - left) / (right - left)) * width, ((top - y) / (top - bottom)) * height];
  }

  // Two renderers, because copying from a large one costs its whole size even for a small canvas.
  rendererFor(width, height) {
    if (Math.max(width, height) > SMALL) this.large ??= startRenderer();
    const renderer = (Math.max(width, height) > SMALL && this.large) || this.small;
    const { width: w, height: h } = renderer.domElement;
    if (width > w || height > h) renderer.setSize(Math.max(w, width), Math.max(h, height), false);
    return renderer;
  }
}
