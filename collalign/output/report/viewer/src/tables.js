// What was left out and why, and how the run was made.

import { button, el, table } from "./dom.js";

export function excludedSection({ collection }) {
  return [table("Files and pairs left out", ["File", "Why, and what to do"], collection.excluded)];
}

function flatten(value, prefix = "") {
  if (value === null || typeof value !== "object" || Array.isArray(value)) return [[prefix, Array.isArray(value) ? JSON.stringify(value) : String(value ?? "not set")]];
  return Object.entries(value).flatMap(([key, inner]) => flatten(inner, prefix ? `${prefix}.${key}` : key));
}

export function runSection({ collection }) {
  const { options, versions } = collection;
  const parts = [
    [table("Options", ["Option", "Value"], flatten(options)), Object.keys(options).length],
    [table("Versions", ["Software", "Version"], Object.entries(versions)), Object.keys(versions).length],
  ];
  return [
    el("h3", null, "For the methods section"), el("pre", { class: "methods", tabindex: 0 }, collection.methods),
    button("Copy", () => navigator.clipboard.writeText(collection.methods)),
    el("p", null, "Date, command and times of the run are in run.json of the result."),
    el("div", { class: "columns" }, ...parts.filter(([, size]) => size).map(([part]) => part))];
}
