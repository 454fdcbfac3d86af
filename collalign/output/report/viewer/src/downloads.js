// Saves what is shown: canvases as PNG, charts as SVG and PDF, surfaces as PLY with values.

import { button } from "./dom.js";
import { pdfOf } from "./pdf.js";

function save(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// Whether `collalign open` shows this page within its own, whose buttons apply what is decided here.
export const isShownByOpen = parent !== window && location.protocol.startsWith("http");

// Tells the page around this one, where `collalign open` shows it, what a download would hold now.
export function tell(name, text) {
  if (isShownByOpen) parent.postMessage({ name, text }, "*");
}

export function saveText(name, text) {
  save(name, new Blob([text]));
}

export function savePng(name, canvas) {
  canvas.toBlob((blob) => save(`${name}.png`, blob));
}

// What `make` returns in the light theme: charts go onto white paper.
function inLight(make) {
  const root = document.documentElement;
  const { theme } = root.dataset;
  root.dataset.theme = "light";
  const made = make();
  if (theme) root.dataset.theme = theme;
  else delete root.dataset.theme;
  return made;
}

// Buttons that save the chart in `picture` as it is then.
export function chartButtons(name, picture) {
  const chart = () => picture.querySelector("svg");
  return [
    button("Save chart (SVG)", () => save(`${name}.svg`, new Blob([inLight(() => svgOf(chart()))], { type: "image/svg+xml" }))),
    button("Save chart (PDF)", () => save(`${name}.pdf`, new Blob([inLight(() => pdfOf(chart()))], { type: "application/pdf" }))),
  ];
}

function svgOf(chart) {
  const copy = chart.cloneNode(true);
  const shown = [chart, ...chart.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((node, at) => {
    const style = getComputedStyle(shown[at]);
    for (const key of ["fill", "fill-opacity", "stroke", "stroke-width", "font-size", "font-family", "paint-order", "text-anchor", "visibility"]) {
      node.setAttribute(key, style.getPropertyValue(key));
    }
    node.removeAttribute("class");
  });
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  return new XMLSerializer().serializeToString(copy);
}

export function savePly(name, positions, faces, offsets) {
  const lines = ["ply", "format ascii 1.0", `element vertex ${positions.length / 3}`, "property float x", "property float y", "property float z", "property float offset",
    `element face ${faces.length / 3}`, "property list uchar int vertex_indices", "end_header"];
  for (let at = 0; at < offsets.length; at++) lines.push([...positions.subarray(3 * at, 3 * at + 3), offsets[at]].map((value) => value.toPrecision(6)).join(" "));
  for (let at = 0; at < faces.length; at += 3) lines.push(`3 ${faces[at]} ${faces[at + 1]} ${faces[at + 2]}`);
  save(`${name}.ply`, new Blob([`${lines.join("\n")}\n`]));
}
