// The matrix of pairs: a canvas with one cell per pair, usable by mouse and by arrow keys, next to a list of the worst pairs.

import { button, degrees, el, number, select, table } from "./dom.js";
import { viridis } from "./colors.js";

const WORST = 25;
const MODES = {
  disagreement: ["rotation disagreement", degrees],
  energy: ["energy", number],
};

function range(values) {
  const sorted = [...values].filter((value) => !Number.isNaN(value)).sort((a, b) => a - b);
  const at = (share) => sorted[Math.round(share * (sorted.length - 1))] ?? 0;
  return { low: at(0), high: at(0.98) };
}

export class PairMatrix {
  constructor(app) {
    this.app = app;
    this.mode = "disagreement";
    this.order = Object.values(app.collection.orders)[0];
    this.cursor = [0, Math.min(1, this.order.length - 1)];
    this.canvas = el("canvas", {
      class: "matrix", tabindex: 0, role: "application", "aria-label": "Matrix of pairs. Arrow keys move, Enter opens the pair.",
      onclick: (event) => this.pointed(event) && this.open(),
      onpointermove: (event) => this.pointed(event) && this.mark(),
      onkeydown: (event) => this.key(event),
      onfocus: () => this.mark(),
    });
    this.say = el("p", { role: "status", class: "cell-text" }, "Point at a cell, or focus the matrix and use the arrow keys.");
    this.legend = el("div", { class: "legend" });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  get count() {
    return this.order.length;
  }

  pair() {
    return this.app.collection.pairAt(this.order[this.cursor[0]], this.order[this.cursor[1]]);
  }

  pointed(event) {
    const box = this.canvas.getBoundingClientRect();
    const cell = [event.clientY - box.top, event.clientX - box.left].map((at) => Math.floor((at / box.width) * this.count));
    if (cell.some((at) => at < 0 || at >= this.count)) return false;
    this.cursor = cell;
    return true;
  }

  key(event) {
    const move = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (move) this.cursor = this.cursor.map((at, axis) => Math.min(this.count - 1, Math.max(0, at + move[axis])));
    else if (event.key === "Enter") this.open();
    else return;
    event.preventDefault();
    this.mark();
  }

  open() {
    if (this.pair() >= 0) this.app.openPair(this.order[this.cursor[0]], this.order[this.cursor[1]]);
  }

  mark() {
    const { shapes, pairs } = this.app.collection;
    const [a, b] = this.cursor.map((at) => shapes[this.order[at]].name);
    const pair = this.pair();
    if (a === b) this.say.textContent = a;
    else if (pair < 0) this.say.textContent = `${a} – ${b}: not compared`;
    else {
      const { collection } = this.app;
      this.say.textContent = `${a} – ${b}: energy ${number(pairs.energy[pair])}, disagreement ${collection.disagreement(pair)}, ${collection.use(pair)}`;
    }
    this.draw();
  }

  // One pixel per cell, enlarged without smoothing; the cursor is drawn on top.
  draw() {
    const size = Math.round(this.canvas.clientWidth * Math.min(2, devicePixelRatio || 1));
    if (!size) return;
    this.image ??= this.paint();
    Object.assign(this.canvas, { width: size, height: size });
    const context = this.canvas.getContext("2d");
    context.imageSmoothingEnabled = false;
    context.drawImage(this.image, 0, 0, size, size);
    const cell = size / this.count;
    context.strokeStyle = getComputedStyle(this.canvas).color;
    context.lineWidth = 2;
    context.strokeRect(this.cursor[1] * cell, this.cursor[0] * cell, cell, cell);
  }

  paint() {
    const { collection } = this.app;
    const { pairs } = collection;
    const values = pairs[this.mode];
    const { low, high } = this.mode === "disagreement" ? { low: 0, high: 180 } : range(values);
    const image = new ImageData(this.count, this.count);
    this.order.forEach((a, row) => this.order.forEach((b, column) => {
      const pair = collection.pairAt(a, b);
      if (a === b || pair < 0 || Number.isNaN(values[pair])) return;
      const color = viridis((values[pair] - low) / (high - low || 1));
      const bytes = Number.parseInt(color.getHexString(), 16);
      image.data.set([bytes >> 16, (bytes >> 8) & 255, bytes & 255, 255], 4 * (row * this.count + column));
    }));
    const canvas = new OffscreenCanvas(this.count, this.count);
    canvas.getContext("2d").putImageData(image, 0, 0);
    const [name, format] = MODES[this.mode];
    const stops = [0, 0.25, 0.5, 0.75, 1].map((share) => `#${viridis(share).getHexString()}`);
    this.legend.replaceChildren(
      format(low), el("span", { class: "ramp", style: `background:linear-gradient(90deg,${stops})` }), `${format(high)}${this.mode === "energy" ? " and more" : ""}`,
      el("span", { class: "muted" }, `${name}; empty: not compared`),
    );
    return canvas;
  }

  repaint(change) {
    Object.assign(this, change, { image: null });
    this.draw();
  }
}

function worstPairs(app) {
  const { pairs, shapes } = app.collection;
  const key = (pair) => (Number.isNaN(pairs.disagreement[pair]) ? Infinity : pairs.disagreement[pair]);
  const order = [...pairs.i.keys()].sort((a, b) => key(b) - key(a)).slice(0, WORST);
  const rows = order.map((pair) => {
    const [a, b] = [pairs.i[pair], pairs.j[pair]];
    const open = button(`${shapes[a].name} – ${shapes[b].name}`, () => app.openPair(a, b), { class: "link" });
    return [open, app.collection.disagreement(pair), number(pairs.energy[pair]), app.collection.use(pair)];
  });
  return table(`The ${rows.length} pairs that disagree most`, ["Pair", "Disagreement", "Energy", "In the result"], rows);
}

export function pairsSection(app) {
  const { collection } = app;
  if (!collection.pairs.i.length) return [el("p", null, "This result holds no pairs.")];
  const matrix = new PairMatrix(app);
  const modes = Object.entries(MODES).map(([key, [text]]) => [key, text]);
  const orders = Object.keys(collection.orders).map((key) => [key, key]);
  const names = collection.shapes.map(({ name }, index) => [String(index), name]);
  let [a, b] = [0, Math.min(1, names.length - 1)];
  const problem = el("span", { role: "status", class: "muted" });
  const openChosen = () => {
    const known = collection.pairAt(a, b) >= 0;
    problem.textContent = known ? "" : "These two were not compared.";
    if (known) app.openPair(a, b);
  };
  return [
    el("div", { class: "row tools" },
      select("Colour", modes, (mode) => matrix.repaint({ mode }), "disagreement"),
      select("Order by", orders, (key) => matrix.repaint({ order: collection.orders[key] }), orders[0][0]),
      select("Pair", names, (value) => (a = Number(value)), String(a)),
      select("and", names, (value) => (b = Number(value)), String(b)),
      button("Open pair", openChosen), problem),
    el("div", { class: "split" }, el("div", null, matrix.canvas, matrix.legend, matrix.say), worstPairs(app)),
  ];
}
