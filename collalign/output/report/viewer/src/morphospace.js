// The specimens on any two components.

import { checkbox, el, responsive, select } from "./dom.js";
import { chartButtons } from "./downloads.js";
import { scatter } from "./scatter.js";

export function morphospaceSection(app) {
  const { variation } = app;
  const columns = Object.keys(variation.columns);
  const chosen = { x: 0, y: Math.min(1, variation.shares.length - 1), column: columns[0] ?? "", outline: "hulls", named: true };
  const picture = el("div", { class: "picture" });
  const title = (at) => `principal component ${at + 1} (${(100 * variation.shares[at]).toFixed(1)} % of the variance)`;
  const show = responsive(picture, (narrow) => scatter({
    points: variation.scores.map((row) => [row[chosen.x], row[chosen.y]]),
    names: variation.names,
    values: chosen.column ? variation.columns[chosen.column] : variation.names.map(() => ""),
    outline: chosen.outline,
    named: chosen.named,
    titles: [title(chosen.x), title(chosen.y)],
    words: `Morphospace of ${variation.names.length} specimens`,
    equal: true,
    narrow,
    open: app.showSpecimen,
  }));
  const change = (key, read = String) => (value) => { chosen[key] = read(value); show(); };
  const axes = variation.shares.map((_, at) => [String(at), `PC${at + 1}`]);
  return [
    el("div", { class: "row tools" },
      select("Across", axes, change("x", Number), String(chosen.x)), select("Up", axes, change("y", Number), String(chosen.y)),
      columns.length ? select("Colour by", [...columns.map((key) => [key, key]), ["", "nothing"]], change("column"), chosen.column) : "",
      columns.length ? select("Around groups", [["hulls", "hulls"], ["ellipses", "ellipses (95 %)"], ["none", "nothing"]], change("outline"), chosen.outline) : "",
      checkbox("Names", (on) => { chosen.named = on; show(); }, true),
      ...chartButtons("morphospace", picture),
      el("span", { class: "muted" }, "A specimen's dot shows it against the mean. Scores are Procrustes distances from the mean.")),
    picture,
  ];
}
