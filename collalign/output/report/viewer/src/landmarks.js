// The page of a transfer: every specimen with its landmarks, which can be flagged, confirmed, dragged and placed; what was decided is
// downloaded as templates of the next transfer.

import { Group, Mesh, MeshLambertMaterial, SphereGeometry, Vector3 } from "three";
import { categorical } from "./colors.js";
import { rotationMatrix, poseMatrix } from "./data.js";
import { button, el, modal, number, select, table } from "./dom.js";
import { isShownByOpen, saveText, tell } from "./downloads.js";
import { keep, kept } from "./kept.js";
import { csvText, fcsvText, slicerText, tpsText } from "./landmark_files.js";
import { pixelOf, pointOnSurface } from "./surface_point.js";

const BALL = new SphereGeometry(1, 14, 10);
const SIZE = 0.022;
const PICK = 12; // pixels of the window around a landmark
const CLICK = 4; // pixels that a click may move
const COLORS = { given: categorical(0), carried: categorical(1), moved: categorical(2), confirmed: categorical(2), flagged: "#d0312d" };
const WORDS = { given: "placed by an expert", moved: "placed here", confirmed: "confirmed", flagged: "flagged" };
const PLACED = WORDS.given;

// What was decided about landmarks; the browser keeps it for this transfer.
class Marks {
  constructor(collection) {
    Object.assign(this, collection.landmarks);
    this.run = collection.run;
    this.names = collection.shapes.map(({ name }) => name);
    this.decisions = new Map(Object.entries(kept(this.run) ?? {}));
    this.listeners = [];
    this.saved = true;
    addEventListener("beforeunload", (event) => !this.saved && event.preventDefault());
  }

  key(index, label) {
    return JSON.stringify([this.names[index], this.labels[label]]);
  }

  decision(index, label) {
    return this.decisions.get(this.key(index, label)) ?? {};
  }

  place(index, label) {
    const given = this.points[index][label];
    return this.decision(index, label).place ?? (given[0] === null ? null : given);
  }

  state(index, label) {
    const { place, flagged, confirmed } = this.decision(index, label);
    if (flagged) return "flagged";
    if (place) return "moved";
    if (confirmed) return "confirmed";
    if (this.status[index][label] === PLACED) return "given";
    return this.place(index, label) ? "carried" : "missing";
  }

  words(index, label) {
    return WORDS[this.state(index, label)] ?? this.status[index][label];
  }

  // `decision` is { place }, { flagged }, { confirmed } or null, which takes back.
  decide(index, label, decision) {
    if (decision) this.decisions.set(this.key(index, label), decision);
    else this.decisions.delete(this.key(index, label));
    this.remembered = keep(this.run, Object.fromEntries(this.decisions));
    this.saved = this.decisions.size === 0 || this.remembered;
    this.listeners.forEach((listener) => listener(index));
  }

  // What people placed or confirmed, specimen by specimen: never what was only carried over.
  templates() {
    const sure = new Set(["given", "moved", "confirmed"]);
    return this.names.map((name, index) => ({ name, marks: this.marks(index, (label) => sure.has(this.state(index, label))) })).filter(({ marks }) => marks.length);
  }

  marks(index, wanted = (label) => this.state(index, label) !== "flagged") {
    return this.labels.flatMap((name, label) => (wanted(label) && this.place(index, label) ? [[name, this.place(index, label)]] : []));
  }

  worst(index) {
    return Math.max(0, ...this.radii[index].map((radius) => radius ?? 0));
  }

  missing(index) {
    return this.labels.filter((_, label) => !this.place(index, label)).length;
  }

  changed(index) {
    return this.labels.filter((_, label) => this.decisions.has(this.key(index, label))).length;
  }
}

const poseOf = (app, index) => poseMatrix(app.collection.shapes[index], rotationMatrix(app.collection.shapes[index].R));

// A ball at every landmark, and around it, clear, how far off it may be.
function balls(app, index) {
  const { marks, collection } = app;
  const matrix = poseOf(app, index);
  const group = new Group();
  const add = (place, size, color, opacity) => {
    const clear = opacity < 1 ? { transparent: true, opacity, depthWrite: false } : {};
    const ball = new Mesh(BALL, app.stage.assets.shared(`ball ${color} ${opacity}`, () => new MeshLambertMaterial({ color, ...clear })));
    ball.position.copy(place);
    ball.scale.setScalar(size);
    group.add(ball);
  };
  marks.labels.forEach((_, label) => {
    const at = marks.place(index, label);
    if (!at) return;
    const [place, state] = [new Vector3(...at).applyMatrix4(matrix), marks.state(index, label)];
    add(place, SIZE, COLORS[state], 1);
    const radius = marks.radii[index][label] * collection.shapes[index].scale;
    if (state === "carried" && radius > SIZE) add(place, radius, COLORS.carried, 0.25);
  });
  return group;
}

function layers(app, index) {
  return [{ mesh: app.collection.shapes[index].mesh, matrix: poseOf(app, index), color: "#d9c8a5" }, { object: balls(app, index) }];
}

function facts(app, index) {
  const { marks } = app;
  const said = [[marks.missing(index), "missing"], [marks.changed(index), "decided"]].filter(([count]) => count).map(([count, word]) => `${count} ${word}`);
  const worst = marks.worst(index);
  return [worst ? `largest radius ${number(worst)}` : "", ...said].filter(Boolean).join(", ");
}

function gallery(app) {
  const { marks, stage } = app;
  const [wide, high] = stage.extent;
  const list = el("ul", { class: "gallery", style: `--aspect:${Math.min(2, wide / high).toFixed(2)}` });
  const cards = marks.names.map((name, index) => {
    const canvas = el("canvas", { "aria-hidden": "true" });
    const open = button("", () => app.openShape(index), { class: "tile", "aria-label": `${name}, open the landmarks` });
    open.append(canvas);
    const tile = stage.add(canvas, () => layers(app, index), { handle: open });
    const said = el("span", { class: "muted" }, facts(app, index));
    marks.listeners.push((changed) => {
      if (changed !== index) return;
      said.textContent = facts(app, index);
      stage.refresh(tile);
    });
    return el("li", { class: "card", "data-index": index }, open, button(name, () => app.openShape(index), { class: "link name" }), said);
  });
  const orders = {
    doubt: (a, b) => marks.missing(b) - marks.missing(a) || marks.worst(b) - marks.worst(a),
    name: (a, b) => marks.names[a].localeCompare(marks.names[b], "en", { numeric: true }),
  };
  const order = (key) => list.append(...[...cards].sort((a, b) => orders[key](+a.dataset.index, +b.dataset.index)));
  order("doubt");
  const legend = [["given", "placed by an expert"], ["carried", "carried over, with its radius in the unit of the file: nine of ten lie within"], ["moved", "placed or confirmed here"], ["flagged", "flagged"]];
  return [
    el("p", { class: "muted" }, "Click a specimen to open it. Then click a landmark to flag it as wrong, or drag it to the right place. Drag elsewhere to rotate."),
    el("ul", { class: "chips" }, ...legend.map(([state, words]) => el("li", { class: "chip" }, el("span", { class: "dot", style: `background:${COLORS[state]}` }), words))),
    el("div", { class: "row tools" }, select("Order by", [["doubt", "missing and largest radius first"], ["name", "name"]], order, "doubt"),
      button("All landmarks (TPS)", () => saveText("landmarks.tps", tpsText(marks.names, marks.labels, (index, label) => (marks.state(index, label) === "flagged" ? null : marks.place(index, label)))))),
    list,
  ];
}

// Lets landmarks be clicked, dragged and placed on a canvas; `placing` holds the label that the next click places.
function handle(app, canvas, tile, index, geometry, mesh, view) {
  const { marks, stage } = app;
  const matrix = poseOf(app, index);
  const onSurface = (event) => pointOnSurface(stage, tile, event, mesh, geometry, matrix);
  const nearest = (event) => {
    const { x, y, ratio } = pixelOf(event, canvas);
    stage.aim(canvas.width / canvas.height, tile);
    let [best, front] = [null, -Infinity];
    marks.labels.forEach((_, label) => {
      const at = marks.place(index, label);
      if (!at) return;
      const place = new Vector3(...at).applyMatrix4(matrix);
      const [px, py] = stage.project(place, canvas.width, canvas.height);
      const { z } = place.clone().applyQuaternion(stage.orientation);
      if (Math.hypot(px - x, py - y) <= PICK * ratio && z > front) [best, front] = [label, z];
    });
    return best;
  };
  const drag = (down, label) => {
    let moved = false;
    const move = (event) => {
      if (!moved && Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) < CLICK) return;
      moved = true;
      const place = onSurface(event);
      if (place) marks.decide(index, label, { place });
    };
    const end = () => {
      removeEventListener("pointermove", move);
      removeEventListener("pointerup", end);
      removeEventListener("pointercancel", end);
      if (!moved) marks.decide(index, label, marks.state(index, label) === "flagged" ? null : { flagged: true });
    };
    addEventListener("pointermove", move);
    addEventListener("pointerup", end);
    addEventListener("pointercancel", end);
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    const place = view.placing === null ? null : onSurface(event);
    const label = place ? view.placing : nearest(event);
    if (label === null) return;
    event.stopImmediatePropagation();
    if (place) {
      view.placing = null;
      marks.decide(index, label, { place });
    } else drag(event, label);
  }, { capture: true });
}

function rows(app, index, view) {
  const { marks } = app;
  return marks.labels.map((name, label) => {
    const state = marks.state(index, label);
    const radius = marks.radii[index][label];
    const act = (words, decision) => button(words, () => {
      marks.decide(index, label, decision);
      document.querySelectorAll("dialog[open] tbody tr")[label].querySelector("button")?.focus();
    });
    const actions = [];
    if (marks.decisions.has(marks.key(index, label))) actions.push(act("Take back", null));
    else if (state === "missing") actions.push(button("Place", () => { view.placing = label; view.show(); }, { "aria-pressed": String(view.placing === label) }));
    else actions.push(act("Flag", { flagged: true }), state === "carried" ? act("Is right", { confirmed: true }) : "");
    return [`${label + 1} ${name}`, marks.words(index, label), radius ? number(radius) : "–", el("span", { class: "row" }, ...actions)];
  });
}

export function landmarkDialog(app) {
  const { stage, marks, collection } = app;
  let tile = null;
  const view = { placing: null, show: () => {}, index: -1 };
  const box = modal(() => { stage.remove(tile); view.index = -1; });
  marks.listeners.push((index) => index === view.index && (stage.refresh(tile), view.show()));
  return async (index) => {
    const mesh = await collection.mesh(collection.shapes[index].mesh);
    const geometry = stage.assets.geometry(collection.shapes[index].mesh, mesh);
    const name = marks.names[index];
    const canvas = el("canvas", { class: "large", tabindex: 0, role: "img", "aria-label": `${name} with its landmarks; arrow keys rotate, plus and minus zoom` });
    const matrix = poseOf(app, index);
    const annotate = (context, project, orientation) => {
      context.font = `${12 * Math.min(2, devicePixelRatio || 1)}px system-ui, sans-serif`;
      context.fillStyle = getComputedStyle(canvas).color;
      marks.labels.forEach((_, label) => {
        const at = marks.place(index, label);
        if (!at) return;
        const place = new Vector3(...at).applyMatrix4(matrix);
        context.globalAlpha = place.clone().applyQuaternion(orientation).z < -0.05 ? 0.25 : 1;
        const [x, y] = project(place);
        context.fillText(String(label + 1), x + 9, y - 6);
      });
      context.globalAlpha = 1;
    };
    Object.assign(view, { placing: null, index });
    tile = stage.add(canvas, () => layers(app, index), { zoomable: true, annotate, handle: null });
    handle(app, canvas, tile, index, geometry, mesh, view);
    stage.turnable(canvas, tile);
    const list = el("div");
    const hint = el("p", { class: "muted", role: "status" });
    view.show = () => {
      hint.textContent = view.placing === null ? "Click a landmark to flag it, drag it to move it; drag elsewhere to rotate." : `Click on the surface where ${marks.labels[view.placing]} is.`;
      list.replaceChildren(table(`Landmarks of ${name}`, ["Landmark", "What it is", "Radius (unit of the file)", ""], rows(app, index, view)));
    };
    view.show();
    const system = collection.landmarks.systems[index];
    const confirm = () => marks.labels.forEach((_, label) => marks.state(index, label) === "carried" && marks.decide(index, label, { confirmed: true }));
    box.body.replaceChildren(hint, canvas,
      el("div", { class: "row tools" }, button("All others are right", confirm),
        button("Download .mrk.json", () => saveText(`${name}.mrk.json`, slicerText(marks.marks(index), system))),
        button("Download .fcsv", () => saveText(`${name}.fcsv`, fcsvText(marks.marks(index), system)))),
      list);
    box.show(name);
  };
}

// The bar at the bottom; hidden while nothing is decided.
function templateBar(app) {
  const { marks } = app;
  const count = el("strong", { role: "status" });
  const { command } = marks;
  const copy = button("Copy", () => navigator.clipboard.writeText(command));
  const save = button("Download templates (CSV)", () => { saveText("templates.csv", csvText(marks.templates())); marks.saved = true; }, { class: "primary", id: "download-templates" });
  const next = isShownByOpen
    ? [el("span", { class: "muted" }, "“Transfer landmarks” at the top of the window takes them.")]
    : [save, el("span", { class: "muted" }, "Then, where the file is: ", el("code", null, command)), copy];
  const bar = el("section", { class: "decisions", "aria-label": "Templates" }, count, ...next);
  const show = () => {
    const templates = marks.templates();
    bar.hidden = marks.decisions.size === 0;
    const many = marks.decisions.size;
    count.textContent = `${many} ${many === 1 ? "landmark" : "landmarks"} decided; ${templates.length} specimens are templates of the next transfer`;
    tell("templates.csv", many ? csvText(templates) : "");
  };
  marks.listeners.push(show);
  show();
  return bar;
}

export function startLandmarks(app, main, furnish) {
  app.marks = new Marks(app.collection);
  app.openShape = landmarkDialog(app);
  furnish([["gallery", "Specimens", gallery]]);
  main.append(templateBar(app));
}
