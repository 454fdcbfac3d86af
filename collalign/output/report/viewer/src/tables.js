// What was left out and why, and how the run was made.

import { button, el, number, table } from "./dom.js";

export function excludedSection({ collection }) {
  return [table("Files and pairs left out", ["File", "Why, and what to do"], collection.excluded)];
}

function flatten(value, prefix = "") {
  if (value === null || typeof value !== "object" || Array.isArray(value)) return [[prefix, Array.isArray(value) ? JSON.stringify(value) : String(value ?? "not set")]];
  return Object.entries(value).flatMap(([key, inner]) => flatten(inner, prefix ? `${prefix}.${key}` : key));
}

export function runSection({ collection }) {
  const { options, versions, timings } = collection;
  const total = Object.values(timings).reduce((sum, value) => sum + value, 0);
  const parts = [
    [table("Options", ["Option", "Value"], flatten(options)), Object.keys(options).length],
    [table("Versions", ["Software", "Version"], Object.entries(versions)), Object.keys(versions).length],
    [table(`Time, ${number(total)} s in all`, ["Stage", "Seconds"], Object.entries(timings).map(([key, value]) => [key, number(value)])), Object.keys(timings).length],
  ];
  const said = [collection.date && `Made on ${collection.date}.`, collection.command && "By the command:"].filter(Boolean).join(" ");
  return [
    el("h3", null, "For the methods section"), el("pre", { class: "methods", tabindex: 0 }, collection.methods),
    button("Copy", () => navigator.clipboard.writeText(collection.methods)),
    el("p", null, said), collection.command ? el("pre", { tabindex: 0 }, collection.command) : "",
    el("div", { class: "columns" }, ...parts.filter(([, size]) => size).map(([part]) => part))];
}
