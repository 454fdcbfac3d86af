// How far each shape's pose can be trusted, most doubtful first.

import { button, degrees, el, table } from "./dom.js";
import { meter, tags } from "./gallery.js";
import { percent } from "./layers.js";

function evidence(app, index) {
  const { pairs, shapes } = app.collection;
  const angles = [];
  let [left, count] = [0, 0];
  for (let other = 0; other < shapes.length; other++) {
    const pair = app.collection.pairAt(index, other);
    if (pair < 0) continue;
    count++;
    if (!pairs.inlier[pair]) left++;
    if (!Number.isNaN(pairs.disagreement[pair])) angles.push(pairs.disagreement[pair]);
  }
  angles.sort((a, b) => a - b);
  return { count, left, median: angles.length ? angles[Math.floor(angles.length / 2)] : NaN };
}

export function doubtSection(app) {
  const { shapes, doubtThreshold } = app.collection;
  const order = app.collection.byDoubt;
  const doubtful = order.filter((index) => app.collection.isDoubtful(index)).length;
  const cells = order.map((index) => {
    const { count, left, median } = evidence(app, index);
    const marks = el("span", { class: "tags" }, ...tags(app, index));
    app.corrections.onchange((changed) => changed === index && marks.replaceChildren(...tags(app, index)));
    const open = button(shapes[index].name, () => app.openShape(index), { class: "link" });
    const share = count ? `${left}\u00a0of\u00a0${count}` : "–";
    return [open, meter(app, index), degrees(median), share, String(shapes[index].alternatives.length), marks];
  });
  const words = doubtful === 0
    ? "No pose is doubtful."
    : `${doubtful} of ${shapes.length} shapes have a confidence below ${percent(doubtThreshold)}. Open them, compare them with the reference, and choose the right pose.`;
  const head = ["Shape", "Confidence", "Median disagreement of its pairs", "Pairs left out", "Other poses", "Marks"];
  const stability = el("p", null, "Run ", el("code", null, "collalign stability FOLDER"),
    " to write stability.html next to this report; FOLDER is the folder of this page. It says how often each pose stays the same with other points, other seeds and fewer shapes.");
  return [el("p", null, words), stability, table("Shapes by confidence", head, cells, { class: "doubt" })];
}
