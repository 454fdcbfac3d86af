// Colours: a colour-blind safe set for labels, viridis for magnitudes, positions as hues for matched points.

import { Color } from "three";

const OKABE_ITO = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b5a800", "#7a5195"];
const VIRIDIS = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
export const BONE = "#d9c8a5";
export const GREY = "#a9b0b8";

// A fixed set first, then hues spaced by the golden angle.
export function categorical(at) {
  if (at < OKABE_ITO.length) return OKABE_ITO[at];
  return `hsl(${((at * 137.508) % 360).toFixed(1)} 55% ${at % 2 ? 45 : 60}%)`;
}

export function viridis(share) {
  const at = Math.min(1, Math.max(0, share)) * (VIRIDIS.length - 1);
  const low = Math.min(VIRIDIS.length - 2, Math.floor(at));
  return new Color(VIRIDIS[low]).lerp(new Color(VIRIDIS[low + 1]), at - low);
}

// One colour per sample, by its place in the shape's bounding box: neighbours look alike.
export function positionColors(samples) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  samples.forEach((value, at) => {
    if (Number.isNaN(value)) return;
    low[at % 3] = Math.min(low[at % 3], value);
    high[at % 3] = Math.max(high[at % 3], value);
  });
  const colors = [];
  for (let at = 0; at < samples.length; at += 3) {
    const share = [0, 1, 2].map((axis) => (samples[at + axis] - low[axis]) / (high[axis] - low[axis] || 1));
    colors.push(share.some(Number.isNaN) ? null : new Color(...share.map((value) => 0.08 + 0.84 * value)));
  }
  return colors;
}
