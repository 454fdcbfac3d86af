// Saves what is shown: canvases as PNG, charts as SVG, surfaces as PLY with values.

function save(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export function savePng(name, canvas) {
  canvas.toBlob((blob) => save(`${name}.png`, blob));
}

// The chart with the colours that the page gives it at the moment.
export function saveSvg(name, chart) {
  const copy = chart.cloneNode(true);
  const shown = [chart, ...chart.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((node, at) => {
    const style = getComputedStyle(shown[at]);
    for (const key of ["fill", "fill-opacity", "stroke", "stroke-width", "font-size", "font-family", "text-anchor", "visibility"]) {
      node.setAttribute(key, style.getPropertyValue(key));
    }
    node.removeAttribute("class");
  });
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  save(`${name}.svg`, new Blob([new XMLSerializer().serializeToString(copy)], { type: "image/svg+xml" }));
}

export function savePly(name, positions, faces, offsets) {
  const lines = ["ply", "format ascii 1.0", `element vertex ${positions.length / 3}`, "property float x", "property float y", "property float z", "property float offset",
    `element face ${faces.length / 3}`, "property list uchar int vertex_indices", "end_header"];
  for (let at = 0; at < offsets.length; at++) lines.push([...positions.subarray(3 * at, 3 * at + 3), offsets[at]].map((value) => value.toPrecision(6)).join(" "));
  for (let at = 0; at < faces.length; at += 3) lines.push(`3 ${faces[at]} ${faces[at + 1]} ${faces[at + 2]}`);
  save(`${name}.ply`, new Blob([`${lines.join("\n")}\n`]));
}
