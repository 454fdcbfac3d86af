// Landmarks as the files that 3D Slicer, R and `--landmarks` read.

const SCHEMA = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#";

// A cell that no spreadsheet takes for a formula, in ASCII or full width, as the toolkit's own tables have it.
function cell(value) {
  const text = String(value);
  const plain = /^'*[=+\-@\t\r\uff1d\uff0b\uff0d\uff20]/.test(text) && Number.isNaN(Number(text)) ? `'${text}` : text;
  return /[",\n\v\f\r\x1c-\x1e\x85\u2028\u2029]/.test(plain) ? `"${plain.replaceAll('"', '""')}"` : plain;
}

// `specimens`: { name, marks: [label, place] }.
export function csvText(specimens) {
  const rows = specimens.flatMap(({ name, marks }) => marks.map(([label, place]) => [name, label, ...place]));
  return [["name", "landmark", "x", "y", "z"], ...rows].map((row) => `${row.map(cell).join(",")}\n`).join("");
}

// All specimens with all labels; `place(index, label)` is null where there is none.
export function tpsText(names, labels, place) {
  return names.map((name, index) => {
    const lines = labels.map((_, label) => (place(index, label) ?? ["NaN", "NaN", "NaN"]).join(" "));
    return `LM3=${labels.length}\n${lines.join("\n")}\nID=${name.replace(/\s/g, "_")}\n`;
  }).join("");
}

export function slicerText(marks, system) {
  const controlPoints = marks.map(([label, position], at) => ({ id: String(at + 1), label, position, positionStatus: "defined" }));
  return JSON.stringify({ "@schema": SCHEMA, markups: [{ type: "Fiducial", coordinateSystem: system, controlPoints }] }, null, 1);
}

export function fcsvText(marks, system) {
  const head = `# Markups fiducial file version = 4.11\n# CoordinateSystem = ${system}\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n`;
  return head + marks.map(([label, place], at) => `${at + 1},${place.join(",")},0,0,0,1,1,1,0,${label.replaceAll(",", " ")},,\n`).join("");
}
