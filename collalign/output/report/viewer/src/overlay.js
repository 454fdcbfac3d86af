// Chosen shapes laid over each other in the common frame.

import { button, el, select } from "./dom.js";
import { categorical } from "./colors.js";
import { after } from "./layers.js";

const FIRST = 8;

export class Overlay {
  constructor(collection) {
    this.collection = collection;
    this.chosen = new Set();
    this.listeners = [];
  }

  onchange(listener) {
    this.listeners.push(listener);
  }

  set(indices) {
    this.chosen = new Set(indices);
    this.listeners.forEach((listener) => listener(this.chosen));
  }

  toggle(index, on) {
    const next = new Set(this.chosen);
    if (on) next.add(index);
    else next.delete(index);
    this.set(next);
  }

  presets() {
    const { shapes, labels, categories } = this.collection;
    const every = shapes.map((_, index) => index);
    const { byDoubt } = this.collection;
    // Those of other parts lie in frames of their own.
    const sure = this.collection.certain(new Set()).slice(0, FIRST);
    const presets = [
      ["sure", `the ${sure.length} most certain`, sure],
      ["doubt", `the ${Math.min(FIRST, every.length)} most doubtful`, byDoubt.slice(0, FIRST)],
      ["all", "all shapes", every],
      ["none", "none", []],
    ];
    for (const column of categories) {
      const values = labels[column];
      for (const value of [...new Set(values)].filter(Boolean).sort()) {
        presets.push([`${column}=${value}`, `${column}: ${value}`, every.filter((index) => values[index] === value)]);
      }
    }
    return presets;
  }
}

export function overlaySection(app) {
  const { stage, overlay, collection } = app;
  let [opacity, points] = [0.35, false];
  const canvas = el("canvas", { class: "large", tabindex: 0, role: "img" });
  const colorOf = (index) => categorical([...overlay.chosen].indexOf(index));
  const layers = () => [...overlay.chosen].map((index) => after(app, index, {
    color: colorOf(index),
    opacity: overlay.chosen.size > 1 ? opacity : 1,
    points: points && collection.pointColors,
  }));
  const tile = stage.add(canvas, layers, { zoomable: true, fitted: true });
  const chips = el("ul", { class: "chips", "aria-label": "Shapes in the overlay" });
  const say = el("p", { class: "muted", role: "status" });
  overlay.onchange((chosen) => {
    canvas.setAttribute("aria-label", `Overlay of ${chosen.size} aligned shapes; arrow keys rotate, plus and minus zoom`);
    say.textContent = chosen.size ? `${chosen.size} shapes` : "Nothing chosen: tick shapes in the gallery, or choose a set.";
    chips.replaceChildren(...[...chosen].map((index) => {
      const { name } = collection.shapes[index];
      const remove = button("×", () => overlay.toggle(index, false), { "aria-label": `Remove ${name} from the overlay` });
      return el("li", { class: "chip" }, el("span", { class: "dot", style: `background:${colorOf(index)}` }), button(name, () => app.openShape(index), { class: "link" }), remove);
    }));
    stage.refresh(tile);
  });
  app.corrections.onchange(() => stage.refresh(tile));
  const presets = overlay.presets();
  const choose = (key) => overlay.set(presets.find(([name]) => name === key)[2]);
  const range = el("input", {
    type: "range", min: 0.1, max: 1, step: 0.05, value: opacity,
    oninput: (event) => { opacity = Number(event.target.value); stage.refresh(tile); },
  });
  const dots = el("input", { type: "checkbox", onchange: (event) => { points = event.target.checked; stage.refresh(tile); } });
  return [
    el("div", { class: "row tools" },
      select("Show", presets.map(([key, text]) => [key, text]), choose, "sure"),
      el("label", { class: "field" }, el("span", null, "Opacity"), range),
      el("label", { class: "check" }, dots, "corresponding points"), say),
    canvas,
    chips,
  ];
}
