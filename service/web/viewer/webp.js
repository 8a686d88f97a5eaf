// @ts-check
/**
 * An animated WebP from still ones, which browsers can write: the pictures stay as they are, one frame each.
 *
 * Source: RFC 9649 (WebP Image Format), sections 2.5 to 2.7.
 */

const ANIMATION = 0x02;
const ALPHA = 0x10;
const PICTURE = ["ALPH", "VP8 ", "VP8L"];

/**
 * @param {ArrayBuffer[]} stills WebP files of the same size
 * @param {{width: number, height: number, milliseconds: number}} options `milliseconds` is the time of each frame
 * @returns {Uint8Array<ArrayBuffer>} a WebP that repeats for ever
 * @throws {Error} a picture is not a WebP
 */
export function animatedWebp(stills, { width, height, milliseconds }) {
  const frames = stills.map(pictureChunks);
  const alpha = frames.some((chunks) => chunks.some(({ name }) => name !== "VP8 "));
  const header = bytes(10, (view) => {
    view.setUint8(0, ANIMATION | (alpha ? ALPHA : 0));
    uint24(view, 4, width - 1);
    uint24(view, 7, height - 1);
  });
  const parts = [chunk("VP8X", [header]), chunk("ANIM", [new Uint8Array(6)])];
  for (const chunks of frames) {
    const place = bytes(16, (view) => {
      uint24(view, 6, width - 1);
      uint24(view, 9, height - 1);
      uint24(view, 12, milliseconds);
      view.setUint8(15, 0x02); // replaces the frame before it
    });
    parts.push(chunk("ANMF", [place, ...chunks.map(({ name, data }) => chunk(name, [data]))]));
  }
  return chunk("RIFF", [ascii("WEBP"), ...parts]);
}

/** @param {ArrayBuffer} still */
function pictureChunks(still) {
  const view = new DataView(still);
  if (still.byteLength < 20 || text(view, 0) !== "RIFF" || text(view, 8) !== "WEBP") throw new Error("This browser cannot write WebP pictures.");
  const found = [];
  for (let at = 12; at + 8 <= still.byteLength; ) {
    const size = view.getUint32(at + 4, true);
    const name = text(view, at);
    if (PICTURE.includes(name)) found.push({ name, data: new Uint8Array(still, at + 8, size) });
    at += 8 + size + (size % 2);
  }
  return found;
}

/** @param {string} name @param {Uint8Array[]} parts @returns {Uint8Array<ArrayBuffer>} padded to an even length */
function chunk(name, parts) {
  const size = parts.reduce((sum, part) => sum + part.length, 0);
  const made = bytes(8 + size + (size % 2), (view) => view.setUint32(4, size, true));
  made.set(ascii(name));
  let at = 8;
  for (const part of parts) {
    made.set(part, at);
    at += part.length;
  }
  return made;
}

/** @param {number} length @param {(view: DataView) => void} write */
function bytes(length, write) {
  const made = new Uint8Array(length);
  write(new DataView(made.buffer));
  return made;
}

/** @param {DataView} view @param {number} at @param {number} value */
function uint24(view, at, value) {
  view.setUint16(at, value & 0xffff, true);
  view.setUint8(at + 2, value >> 16);
}

/** @param {string} name */
function ascii(name) {
  return Uint8Array.from(name, (letter) => letter.charCodeAt(0));
}

/** @param {DataView} view @param {number} at */
function text(view, at) {
  return String.fromCharCode(...Array.from({ length: 4 }, (_, k) => view.getUint8(at + k)));
}
