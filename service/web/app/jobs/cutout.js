// @ts-check
/** The service's pictures of assets without their light ground, so that they stand on any. The shadow stays. */

/** The ground above and below, as `meshdeform/rendering/studio.py` paints it: a shadow makes it darker, and no other colour. */
const UPPER = [0.965, 0.968, 0.972];
const LOWER = [0.885, 0.89, 0.9];
const DARKEST = 0.55;
/** Levels of 255 by which rounding changes a colour, and by which a shadow changes from one pixel to the next. */
const ROUNDING = 1.6;
const STEP = 6;

/**
 * Make the ground of one view transparent, from its border inwards.
 * @param {Uint8ClampedArray} pixels RGBA of side times side pixels, which are changed.
 * @param {number} side
 */
export function clearGround(pixels, side) {
  const light = lightOf(pixels, side);
  const ground = flooded(light, side);
  const at = [-side, side, -1, 1];
  for (let y = 1; y < side - 1; y++) {
    for (let i = y * side + 1; i < (y + 1) * side - 1; i++) if (!ground[i] && at.some((step) => ground[i + step] === 1)) ground[i] = 2;
  }
  for (let i = 0; i < light.length; i++) {
    if (ground[i] === 1) pixels.set([0, 0, 0, 255 * Math.max(0, 0.98 - light[i])], 4 * i);
    if (ground[i] !== 2) continue;
    // Half of it is ground: it takes the colour of what lies behind it.
    const behind = i + (at.find((step) => !ground[i + step]) ?? 0);
    pixels.copyWithin(4 * i, 4 * behind, 4 * behind + 3);
    pixels[4 * i + 3] = 128;
  }
}

/** What share of the ground's light each pixel has; -1: it is no ground. @param {Uint8ClampedArray} pixels @param {number} side */
function lightOf(pixels, side) {
  const light = new Float32Array(side * side).fill(-1);
  for (let y = 0; y < side; y++) {
    const [r, g, b] = UPPER.map((upper, c) => 255 * (upper + ((LOWER[c] - upper) * (y + 0.5)) / side));
    for (let i = y * side, k = 4 * i; i < (y + 1) * side; i++, k += 4) {
      const share = (pixels[k] / r + pixels[k + 1] / g + pixels[k + 2] / b) / 3;
      const off = Math.max(Math.abs(pixels[k] - r * share), Math.abs(pixels[k + 1] - g * share), Math.abs(pixels[k + 2] - b * share));
      if (share > DARKEST && off <= ROUNDING) light[i] = share;
    }
  }
  return light;
}

/** What of the ground the border leads to: 1. @param {Float32Array} light @param {number} side */
function flooded(light, side) {
  const found = new Uint8Array(light.length);
  const next = /** @type {number[]} */ ([]);
  const take = (/** @type {number} */ i, /** @type {number} */ from) => {
    if (found[i] || light[i] < 0 || Math.abs(light[i] - from) * 255 > STEP) return;
    found[i] = 1;
    next.push(i);
  };
  for (let k = 0; k < side; k++) for (const i of [k, k * side, (k + 1) * side - 1, side * (side - 1) + k]) take(i, light[i]);
  for (let i = next.pop(); i !== undefined; i = next.pop()) {
    const x = i % side;
    if (x) take(i - 1, light[i]);
    if (x < side - 1) take(i + 1, light[i]);
    if (i >= side) take(i - side, light[i]);
    if (i < light.length - side) take(i + side, light[i]);
  }
  return found;
}

/** Views of a picture, without their ground, as PNG. @param {Blob} picture @param {number} side Of a view, in pixels. @param {[number, number][]} cells Columns and rows. @returns {Promise<Blob[]>} */
export async function viewsOf(picture, side, cells) {
  const image = await createImageBitmap(picture);
  return Promise.all(cells.map(([column, row]) => {
    const canvas = Object.assign(document.createElement("canvas"), { width: side, height: side });
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    context.drawImage(image, -column * side, -row * side);
    const view = context.getImageData(0, 0, side, side);
    clearGround(view.data, side);
    context.putImageData(view, 0, 0);
    return /** @type {Promise<Blob>} */ (new Promise((resolve, reject) => canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The picture could not be written."))))));
  }));
}
