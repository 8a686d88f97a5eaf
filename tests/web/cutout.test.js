/** The ground of the service's pictures goes, the asset and its shadow stay. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { clearGround } from "../../service/web/app/jobs/cutout.js";

const SIDE = 64;

/** The studio's ground, with a shadow low in the middle, and a square of some colour on it. */
function picture(colour, darkness = 0.4) {
  const pixels = new Uint8ClampedArray(4 * SIDE * SIDE);
  for (let y = 0; y < SIDE; y++) {
    for (let x = 0; x < SIDE; x++) {
      const below = (y + 0.5) / SIDE;
      const shadow = 1 - darkness * Math.max(0, 1 - Math.hypot(x - 32, y - 48) / 24);
      const ground = [[0.965, 0.885], [0.968, 0.89], [0.972, 0.9]].map(([upper, lower]) => 255 * shadow * (upper + (lower - upper) * below));
      const inside = x >= 20 && x < 44 && y >= 16 && y < 48;
      pixels.set([...(inside ? colour : ground), 255], 4 * (y * SIDE + x));
    }
  }
  return pixels;
}

const at = (pixels, x, y) => [...pixels.slice(4 * (y * SIDE + x), 4 * (y * SIDE + x) + 4)];

test("the ground is transparent, its shadow is black, and the asset is as it was", () => {
  for (const colour of [[200, 90, 40], [150, 150, 165], [255, 255, 255], [10, 10, 10]]) {
    const pixels = picture(colour);
    clearGround(pixels, SIDE);
    assert.deepEqual(at(pixels, 2, 2), [0, 0, 0, 0]);
    assert.deepEqual(at(pixels, 61, 61).slice(0, 3), [0, 0, 0]);
    assert.deepEqual(at(pixels, 32, 32), [...colour, 255]);
    const [, , , shade] = at(pixels, 32, 49);
    assert.ok(shade > 60 && shade < 140, `the shadow has ${shade}`);
    assert.deepEqual(at(pixels, 20, 30), [...colour, 128], "its edge is half the ground's");
  }
});

test("what has the ground's colour inside the asset stays", () => {
  const pixels = picture([200, 90, 40]);
  const before = [246 * 0.99, 247 * 0.99, 248 * 0.99].map(Math.round);
  for (let y = 28; y < 34; y++) for (let x = 28; x < 34; x++) pixels.set(before, 4 * (y * SIDE + x));
  clearGround(pixels, SIDE);
  assert.deepEqual(at(pixels, 30, 30), [...before, 255]);
});
