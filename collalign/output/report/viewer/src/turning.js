// Mouse, touch and keyboard on a drawing: dragging and arrow keys turn, wheel and + - zoom.

import { Quaternion, Vector3 } from "three";

const STEP = Math.PI / 24;
const KEYS = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] };
const DRAG_PIXELS = 4;

// Rotation of what is seen: `dx` about the upright axis of the screen, `dy` about its level one, `roll` about the line of sight.
export function turnOnScreen(dx, dy, roll = 0) {
  const about = (x, y, z, angle) => new Quaternion().setFromAxisAngle(new Vector3(x, y, z), angle);
  return about(0, 1, 0, dx).multiply(about(1, 0, 0, dy)).multiply(about(0, 0, 1, roll));
}

// A drag that ends on a button is not a click on it.
function swallowClick() {
  const swallow = (event) => {
    event.stopPropagation();
    event.preventDefault();
  };
  addEventListener("click", swallow, { capture: true, once: true });
  setTimeout(() => removeEventListener("click", swallow, { capture: true }), 50);
}

function drag(down, turn, setMoving) {
  if (down.button !== 0) return;
  let [x, y] = [down.clientX, down.clientY];
  let moved = false;
  const move = (event) => {
    const [dx, dy] = [event.clientX - x, event.clientY - y];
    if (!moved && Math.hypot(dx, dy) < DRAG_PIXELS) return;
    [x, y, moved] = [event.clientX, event.clientY, true];
    setMoving(true);
    turn(dx * 0.01, dy * 0.01, event);
  };
  const end = () => {
    removeEventListener("pointermove", move);
    removeEventListener("pointerup", end);
    removeEventListener("pointercancel", end);
    if (moved) swallowClick();
    setMoving(false);
  };
  addEventListener("pointermove", move);
  addEventListener("pointerup", end);
  addEventListener("pointercancel", end);
}

export function makeTurnable(handle, { turn, setMoving, zoom }) {
  handle.addEventListener("pointerdown", (event) => drag(event, turn, setMoving));
  handle.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (KEYS[event.key]) {
      event.preventDefault();
      turn(...KEYS[event.key], event);
    } else if (zoom && (event.key === "+" || event.key === "-")) zoom(event.key === "+" ? 1.15 : 1 / 1.15);
  });
  // The wheel zooms only where the drawing has the focus: otherwise it scrolls the page.
  const wheel = (event) => {
    if (document.activeElement !== handle) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.001));
  };
  if (zoom) handle.addEventListener("wheel", wheel, { passive: false });
}
