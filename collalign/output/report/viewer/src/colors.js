// Colours: a colour-blind safe set for labels, viridis for magnitudes.

import { Color, SRGBColorSpace } from "three";

const OKABE_ITO = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b5a800", "#7a5195"];
const VIRIDIS = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];
const DIVERGING = ["#2166ac", "#67a9cf", "#d1e5f0", "#f7f7f7", "#fddbc7", "#ef8a62", "#b2182b"];
export const BONE = "#d9c8a5";
export const GREY = "#a9b0b8";

// A component of a screen's colour as three.js adds light, in [0, 1].
export const linear = (value) => value ** 2.2;

// A fixed set first, then hues spaced by the golden angle.
export function categorical(at) {
  if (at < OKABE_ITO.length) return OKABE_ITO[at];
  const hue = ((at * 137.508) % 360) / 360;
  return `#${new Color().setHSL(hue, 0.55, at % 2 ? 0.45 : 0.6, SRGBColorSpace).getHexString()}`;
}

function ramp(stops) {
  const colors = stops.map((stop) => new Color(stop));
  return (share) => {
    const at = Math.min(1, Math.max(0, share)) * (stops.length - 1);
    const low = Math.min(stops.length - 2, Math.floor(at));
    return colors[low].clone().lerp(colors[low + 1], at - low);
  };
}

export const viridis = ramp(VIRIDIS);
export const VIRIDIS_CSS = `linear-gradient(90deg, ${VIRIDIS.join(", ")})`;

// From blue (0) over white (one half) to red (1).
export const diverging = ramp(DIVERGING);
const gradient = (colors) => `linear-gradient(90deg, ${colors.join(", ")})`;
export const DIVERGING_CSS = gradient(DIVERGING);
// The half from white (0) to red.
export const RISING_CSS = gradient(DIVERGING.slice((DIVERGING.length - 1) / 2));
