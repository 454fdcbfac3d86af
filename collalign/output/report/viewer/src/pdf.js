// A chart of lines, circles, polygons and texts as a PDF file of one page, in the standard font Helvetica.

const SCALE = 0.5; // points per unit of the chart: 900 wide is 6.25 inches
const KAPPA = 0.5523;

const fixed = (value) => String(Number(value.toFixed(3)));
const join = (...values) => values.map((value) => (typeof value === "number" ? fixed(value) : value)).join(" ");

// Red, green and blue in [0, 1]; null where nothing is painted.
function paint(text) {
  const channels = text.match(/[\d.]+/g)?.map(Number);
  return text === "none" || !channels || channels[3] === 0 ? null : channels.slice(0, 3).map((value) => value / 255);
}

// The page draws no other commands than M, L, H and V.
function pathOf(d) {
  let [x, y] = [0, 0];
  return [...d.matchAll(/([MLHV])([^MLHV]*)/g)].map(([, command, rest]) => {
    const numbers = rest.trim().split(/[\s,]+/).map(Number);
    if (command === "H") [x] = numbers;
    else if (command === "V") [y] = numbers;
    else [x, y] = numbers;
    return join(x, y, command === "M" ? "m" : "l");
  });
}

function outline(node) {
  const value = (key) => node[key].baseVal.value;
  if (node.tagName === "line") return [join(value("x1"), value("y1"), "m"), join(value("x2"), value("y2"), "l")];
  if (node.tagName === "polygon") return [...[...node.points].map(({ x, y }, at) => join(x, y, at ? "l" : "m")), "h"];
  if (node.tagName === "path") return pathOf(node.getAttribute("d"));
  const [r, k] = [value("r"), KAPPA * value("r")];
  return [join(r, 0, "m"), join(r, k, k, r, 0, r, "c"), join(-k, r, -r, k, -r, 0, "c"), join(-r, -k, -k, -r, 0, -r, "c"), join(k, -r, r, -k, r, 0, "c")];
}

// Characters beyond Latin-1 become question marks: the standard fonts have no others.
function literal(text) {
  return [...text].map((character) => {
    const code = character.codePointAt(0);
    if (code > 255) return "?";
    return code < 32 || code > 126 || "()\\".includes(character) ? `\\${code.toString(8).padStart(3, "0")}` : character;
  }).join("");
}

function textOf(node, style, measure) {
  const size = parseFloat(style.fontSize);
  measure.font = `${size}px Helvetica, Arial, "Liberation Sans", sans-serif`;
  const ahead = { start: 0, middle: 0.5, end: 1 }[style.textAnchor] * measure.measureText(node.textContent).width;
  const [x, y] = ["x", "y"].map((key) => Number(node.getAttribute(key)));
  return [join(...paint(style.fill), "rg"), `BT /F ${fixed(size)} Tf ${join(1, 0, 0, -1, x - ahead, y)} Tm (${literal(node.textContent)}) Tj ET`];
}

function figureOf(node, style, states) {
  const [fill, stroke] = [paint(style.fill), paint(style.stroke)];
  const out = [join(parseFloat(style.strokeWidth), "w")];
  const opacity = Number(style.fillOpacity);
  if (opacity < 1) {
    states.add(opacity);
    out.push(`/G${[...states].indexOf(opacity)} gs`);
  }
  if (fill) out.push(join(...fill, "rg"));
  if (stroke) out.push(join(...stroke, "RG"));
  return [...out, ...outline(node), fill && stroke ? "B" : fill ? "f" : stroke ? "S" : "n"];
}

export function pdfOf(chart) {
  const { width, height } = chart.viewBox.baseVal;
  const toChart = chart.getScreenCTM().inverse();
  const measure = document.createElement("canvas").getContext("2d");
  const states = new Set();
  const content = [join(SCALE, 0, 0, -SCALE, 0, SCALE * height, "cm")];
  for (const node of chart.querySelectorAll("path, line, polygon, circle, text")) {
    const style = getComputedStyle(node);
    if (style.visibility === "hidden") continue;
    const { a, b, c, d, e, f } = toChart.multiply(node.getScreenCTM());
    const drawn = node.tagName === "text" ? textOf(node, style, measure) : figureOf(node, style, states);
    content.push("q", join(a, b, c, d, e, f, "cm"), ...drawn, "Q");
  }
  const stream = content.join("\n");
  const opacities = [...states].map((opacity, at) => `/G${at} << /ca ${opacity} >>`).join(" ");
  const objects = [
    "<< /Type /Catalog /Pages 2 0 R >>",
    "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
    `<< /Type /Page /Parent 2 0 R /MediaBox [0 0 ${join(SCALE * width, SCALE * height)}] /Contents 4 0 R /Resources << /Font << /F 5 0 R >> /ExtGState << ${opacities} >> >> >>`,
    `<< /Length ${stream.length} >>\nstream\n${stream}\nendstream`,
    "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
  ];
  let file = "%PDF-1.4\n";
  const places = objects.map((text, at) => {
    const place = file.length;
    file += `${at + 1} 0 obj\n${text}\nendobj\n`;
    return `${String(place).padStart(10, "0")} 00000 n \n`;
  });
  return `${file}xref\n0 6\n0000000000 65535 f \n${places.join("")}trailer\n<< /Size 6 /Root 1 0 R >>\nstartxref\n${file.length}\n%%EOF\n`;
}
