// The command that repeats the work with the decisions made here, as it is pasted into a terminal.

import { button, el } from "./dom.js";

const PLAIN = /^[\w@%+=:,./-]+$/;
const UNPRINTABLE = /[\0-\x1f\x7f]/;

// The folder in which this report lies, null where the page cannot tell.
function resultFolder() {
  if (location.protocol !== "file:") return null;
  const folders = decodeURIComponent(location.pathname).split("/");
  folders.pop();
  if (folders.at(-1) === "report_pages") folders.pop();
  const path = folders.join("/");
  return /^\/[A-Za-z]:/.test(path) ? path.slice(1) : path;
}

// Whether other shapes are on other pages, so that this one does not know all labels.
export function isPart() {
  return document.querySelector(".every") !== null || location.pathname.includes("/report_pages/");
}

function quoted(word, windows) {
  if (PLAIN.test(word)) return word;
  return windows ? `"${word.replaceAll('"', "")}"` : `'${word.replaceAll("'", `'"'"'`)}'`;
}

function cell(text) {
  return /[",]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

// Lines that write what the command reads.
function heredoc(path, text) {
  return `cat > ${quoted(path)} <<'END'\n${text}\nEND`;
}

// The whole command, with `decisions` unless that is empty and without the shapes `leftOut`; empty where a name cannot
// be pasted. In the shells of Windows it reads the downloaded file.
export function wholeCommand({ again, labels, shapes }, decisions, leftOut) {
  const columns = isPart() ? [] : Object.keys(labels);
  const rows = columns.length ? [["name", ...columns], ...shapes.map(({ name }, at) => [name, ...columns.map((column) => labels[column][at])])] : [];
  const out = resultFolder() ?? "OUT";
  if ([...again, ...leftOut, out, ...rows.flat()].some((word) => UNPRINTABLE.test(word))) return "";
  const windows = /^[A-Za-z]:/.test(out);
  const [file, table] = ["corrections.json", "labels.csv"].map((name) => (windows ? name : `${out}/${name}`));
  const words = ["collalign", "align", ...again, `--out=${out}`, ...(decisions ? [`--corrections=${file}`] : []), ...leftOut.map((name) => `--exclude=${name}`), ...(rows.length && !windows ? [`--labels=${table}`] : [])];
  const command = words.map((word) => quoted(word, windows)).join(" ");
  if (windows) return command;
  const written = decisions ? [heredoc(file, JSON.stringify(JSON.parse(decisions)))] : [];
  if (rows.length) written.push(heredoc(table, rows.map((row) => row.map(cell).join(",")).join("\n")));
  return [...written, command].join("\n");
}

// A box with a command and a button that copies it, or selects it where the browser lets no page write to the clipboard.
export function commandBox(collection) {
  const lacks = isPart() && Object.keys(collection.labels).length ? "; add --labels, the table is not on this page" : "";
  const text = el("pre", { tabindex: 0, "aria-label": "The command" });
  const said = el("span", { class: "muted", role: "status" });
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(text.textContent);
      said.textContent = "Copied.";
    } catch {
      getSelection().selectAllChildren(text);
      said.textContent = "Selected: press Ctrl-C (on a Mac Cmd-C).";
    }
  };
  const box = el("details", { class: "command" }, el("summary", null, `The command that applies them${lacks}`),
    el("div", { class: "row" }, button("Copy", copy), said), text);
  box.addEventListener("toggle", () => (text.scrollTop = text.scrollHeight));
  return {
    box,
    show(command) {
      box.hidden = !command;
      text.textContent = command;
      said.textContent = "";
    },
  };
}
