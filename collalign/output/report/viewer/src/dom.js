// Elements without a framework. Text always goes in as text nodes, so names from files are never read as markup.

const SVG = "http://www.w3.org/2000/svg";

function fill(node, properties, children) {
  for (const [key, value] of Object.entries(properties ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

export function el(tag, properties, ...children) {
  return fill(document.createElement(tag), properties, children);
}

export function svg(tag, properties, ...children) {
  return fill(document.createElementNS(SVG, tag), properties, children);
}

export function table(caption, head, rows, properties) {
  const header = head.map((text) => el("th", { scope: "col" }, text));
  const body = rows.map((row) =>
    el("tr", null, ...row.map((cell, at) => (at === 0 ? el("th", { scope: "row" }, cell) : el("td", null, cell)))),
  );
  return el(
    "div",
    { class: "scroll", tabindex: 0, role: "region", "aria-label": caption },
    el("table", properties, el("caption", null, caption), el("thead", null, el("tr", null, ...header)), el("tbody", null, ...body)),
  );
}

export function select(label, options, onchange, value) {
  const box = el(
    "select",
    { onchange: (event) => onchange(event.target.value) },
    ...options.map(([key, text]) => el("option", { value: key, selected: key === value }, text)),
  );
  return el("label", { class: "field" }, el("span", null, label), box);
}

export function checkbox(label, onchange, checked) {
  return el("label", { class: "check" }, el("input", { type: "checkbox", checked, onchange: (event) => onchange(event.target.checked) }), label);
}

export function button(text, onclick, properties) {
  return el("button", { type: "button", onclick, ...properties }, text);
}

// A modal dialog with a heading, a button that lets it fill the window and one that closes it; the focus returns to where it was when it closes.
export function modal(onclose) {
  const heading = el("h2", { id: `dialog-title-${modal.count++}`, tabindex: -1 });
  const body = el("div", { class: "dialog-body" });
  const dialog = el("dialog", { "aria-labelledby": heading.id });
  const close = button("Close", () => dialog.close(), { class: "close" });
  const full = button("Full size", () => {
    full.setAttribute("aria-pressed", String(dialog.classList.toggle("full")));
    dialog.scrollTop = 0;
  }, { "aria-pressed": "false" });
  dialog.append(el("div", { class: "dialog-head" }, heading, el("div", { class: "row" }, full, close)), body);
  dialog.addEventListener("close", () => {
    onclose?.();
    body.replaceChildren();
  });
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  document.body.append(dialog);
  return {
    dialog,
    body,
    show(title) {
      heading.replaceChildren(title);
      if (!dialog.open) dialog.showModal();
      dialog.scrollTop = 0;
      heading.focus();
    },
  };
}
modal.count = 0;

// Draws into `box` again whenever the window becomes narrow or wide: `draw(narrow)` returns what it holds.
export function responsive(box, draw) {
  const narrow = matchMedia("(max-width: 40rem)");
  const show = () => box.replaceChildren(...draw(narrow.matches).filter(Boolean));
  narrow.addEventListener("change", show);
  show();
  return show;
}

export function number(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e5)) return value.toExponential(digits - 1);
  return Number(value.toPrecision(digits)).toString();
}

export function degrees(value) {
  return Number.isNaN(value) || value === null ? "–" : `${value.toFixed(1)}°`;
}
