// Keeps decisions over a reload: in the browser's storage, or, where a browser refuses it to files, with the page in its history.

const PREFIX = "collalign-decisions-";

// Remember `value` for the result called `run`; whether it will still be there when the page was closed.
export function keep(run, value) {
  history.replaceState({ ...history.state, [PREFIX + run]: value }, "");
  try {
    localStorage.setItem(PREFIX + run, JSON.stringify(value));
    return true;
  } catch {
    return false;
  }
}

// What was remembered for this result; undefined if nothing was.
export function kept(run) {
  try {
    const text = localStorage.getItem(PREFIX + run);
    if (text !== null) return JSON.parse(text);
  } catch {
    // Refused, or written by something else: the history may know.
  }
  return history.state?.[PREFIX + run];
}
