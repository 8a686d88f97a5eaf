// @ts-check
/** Perceptual colour maps and the legend that goes with a heat map. */

/** Eleven samples each of matplotlib's maps (CC0), evenly spaced; between them sRGB is interpolated. */
export const COLORMAPS = {
  viridis: "440154 482475 414487 355f8d 2a788e 21918c 22a884 44bf70 7ad151 bddf26 fde725",
  plasma: "0d0887 41049d 6a00a8 8f0da4 b12a90 cc4778 e16462 f2844b fca636 fcce25 f0f921",
};

/** @typedef {keyof typeof COLORMAPS} ColormapName */

/**
 * Colour of a position on a map.
 * @param {ColormapName} name
 * @param {number} t 0..1; outside, the nearest end
 * @returns {[number, number, number]} sRGB, 0..255
 */
export function colorAt(name, t) {
  const stops = COLORMAPS[name].split(" ").map((hex) => parseInt(hex, 16));
  const at = Math.min(Math.max(t, 0), 1) * (stops.length - 1);
  const low = Math.min(Math.floor(at), stops.length - 2);
  const mix = (/** @type {number} */ shift) => {
    const [a, b] = [(stops[low] >> shift) & 255, (stops[low + 1] >> shift) & 255];
    return Math.round(a + (at - low) * (b - a));
  };
  return [mix(16), mix(8), mix(0)];
}

/** A row of colours for a texture. @param {ColormapName} name @param {number} size @returns {Uint8Array} (4 size) sRGB and an opaque alpha */
export function colorRow(name, size = 256) {
  const row = new Uint8Array(4 * size);
  for (let i = 0; i < size; i++) row.set([...colorAt(name, i / (size - 1)), 255], 4 * i);
  return row;
}

/** @param {ColormapName} name @returns {string} the map from left to right, as a CSS image */
export function cssGradient(name) {
  return `linear-gradient(to right, ${COLORMAPS[name].split(" ").map((hex) => `#${hex}`).join(", ")})`;
}

/**
 * Colours that tell pieces apart: hues a golden angle apart, by turns lighter and darker.
 * @param {number} count
 * @returns {[number, number, number][]} sRGB, 0..255
 */
export function pieceColors(count) {
  return Array.from({ length: count }, (_, i) => {
    const [hue, light] = [((i * 137.508 + 210) % 360) / 30, [0.62, 0.48, 0.74][i % 3]];
    const spread = 0.55 * Math.min(light, 1 - light);
    const channel = (/** @type {number} */ shift) => {
      const k = (shift + hue) % 12;
      return Math.round(255 * (light - spread * Math.max(-1, Math.min(k - 3, 9 - k, 1))));
    };
    return [channel(0), channel(8), channel(4)];
  });
}

/**
 * Where a value lies on the legend.
 * @param {number} value
 * @param {{ range: [number, number], scale: "linear" | "log" }} legend
 * @returns {number} 0..1 within the range
 */
export function positionOf(value, { range: [low, high], scale }) {
  if (scale === "log") return high > low ? Math.log(value / low) / Math.log(high / low) : 0;
  return high > low ? (value - low) / (high - low) : 0;
}

/**
 * The ends and the middle of a legend.
 * @param {{ range: [number, number], scale: "linear" | "log" }} legend
 * @returns {{ text: string, at: number }[]} rising; `at` is 0..1
 */
export function ticks({ range: [low, high], scale }) {
  if (!(high > low)) return [{ text: formatValue(low), at: 0 }];
  const middle = scale === "log" ? Math.sqrt(low * high) : (low + high) / 2;
  return [low, middle, high].map((value, i) => ({ text: formatValue(value), at: i / 2 }));
}

/** @param {number} value @returns {string} three significant digits, no noise */
export function formatValue(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-3 ? value.toExponential(1) : String(Number(value.toPrecision(3)));
}
