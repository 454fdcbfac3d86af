// Shape against size and groups: what explains how much of the variation, allometry, every two groups, disparity.

import { checkbox, el, number, responsive, select, table } from "./dom.js";
import { chartButtons } from "./downloads.js";
import { regression, scatter } from "./scatter.js";

const cell = (value) => (typeof value === "number" ? number(value) : (value ?? ""));

// A table of the files, its first row the heading; of equal neighbours in its first column only the first is written.
export function shownTable(caption, [head, ...rows]) {
  const lines = rows.map((row, at) => row.map((value, column) => (column === 0 && at > 0 && rows[at - 1][0] === value ? "" : cell(value))));
  return table(caption, head.map((word) => word.replaceAll("_", " ")), lines, { class: "numbers" });
}

// What a model's only term explains, in words.
function explains([model, , num, effect, , , , share, , , p]) {
  return model === effect ? `By itself, ${effect} explains ${(100 * share).toFixed(1)} % of the variation of shape of ${num} specimens (p = ${number(p)}).` : "";
}

// What the terms of the first model explain, in words, where it has several: it is the one that was asked for.
function ofModel([first, ...others]) {
  const rows = first ? [first, ...others].filter(([model, , , , , , , , , , p]) => model === first[0] && p !== "" && p != null) : [];
  if (rows.length < 2) return [];
  const terms = rows.map(([, , , effect, , , , share, , , p], at) => `${effect} ${at ? "" : "explains "}${(100 * share).toFixed(1)} % ${at ? "" : "of the variation of shape "}(p = ${number(p)})`);
  return [`In the model ${first[0]} (${first[2]} specimens), ${terms.slice(0, -1).join(", ")} and ${terms.at(-1)}.`];
}

function allometry(app) {
  const [head, ...rows] = app.variation.tables.allometry;
  const columns = Object.keys(app.variation.columns);
  const picture = el("div", { class: "picture" });
  const points = rows.map((row) => row.slice(-2));
  let [column, named] = [columns[0] ?? "", true];
  const show = responsive(picture, (narrow) => scatter({
    points,
    line: points.length > 1 ? regression(points) : [],
    named,
    names: app.variation.names,
    values: rows.map((row) => (column ? row[head.indexOf(column, 1)] : "")),
    titles: ["logarithm of centroid size", "regression score (Procrustes distance)"],
    words: `Allometry of ${rows.length} specimens`,
    narrow,
    open: app.showSpecimen,
  }));
  return [
    el("h3", null, "Allometry"),
    el("div", { class: "row tools" },
      columns.length ? select("Colour by", [...columns.map((key) => [key, key]), ["", "nothing"]], (key) => { column = key; show(); }, column) : "",
      checkbox("Names", (on) => { named = on; show(); }, true),
      ...chartButtons("allometry", picture),
      el("span", { class: "muted" }, "The line is the least-squares fit of all dots.")),
    picture,
  ];
}

const SUMS = { I: "in sequence (type I): each term counts beyond those before it", II: "marginal (type II): each term counts beyond all others that do not contain it" };

function method({ sumsOfSquares, permutations, seed }) {
  return `Procrustes ANOVA of whole surfaces at unit centroid size. Sums of squares are ${SUMS[sumsOfSquares]}. p and effect sizes (Z) are by ${permutations} random permutations of residuals (seed ${seed}). Columns of numbers are covariates.`;
}

// Tables that there are only where somebody asked for them: their headings and captions.
const ON_REQUEST = [
  ["sides", "Left and right", "Procrustes ANOVA of individuals and sides"],
  ["asymmetry", "", "Asymmetry of every individual (Procrustes distance of its sides), and without the directional part"],
  ["measurement_error", "Measured again", "Procrustes ANOVA of the error of measurement"],
  ["repeats", "", "How far measurements are from their mean"],
  ["digitisation", "", "Error of placing each landmark, in the unit of the files"],
  ["integration", "Blocks of landmarks", "Integration of every two blocks, by partial least squares"],
];

function onRequest(tables) {
  return ON_REQUEST.flatMap(([name, title, caption]) => (tables[name] ? [title ? el("h3", null, title) : "", shownTable(caption, tables[name])] : []));
}

export function statisticsSection(app) {
  const { anova, groups, pairs } = app.variation.tables;
  const said = [...new Set([...ofModel(anova.slice(1)), ...anova.slice(1).map(explains)])].filter(Boolean);
  return [
    el("p", null, said.join(" ") || "There are too few specimens for tests."),
    el("p", { class: "muted" }, method(app.variation.tests)),
    shownTable("Procrustes ANOVA", anova), ...allometry(app),
    pairs.length > 1 ? el("h3", null, "Groups") : el("p", null, "No labels tell groups of two specimens or more apart. Give a table with --labels."),
    pairs.length > 1 ? shownTable("Means of every two groups, as they are and with size held constant; their disparity and their slopes", pairs) : "",
    groups.length > 1 ? shownTable("Disparity within groups (Procrustes variance)", groups) : "",
    ...onRequest(app.variation.tables),
    el("p", { class: "muted" }, "The same tables are in the folder statistics."),
  ];
}
