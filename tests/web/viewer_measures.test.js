// Known answers for what the viewer measures.
import assert from "node:assert/strict";
import { test } from "node:test";

import {
  averageToVertices,
  displacement,
  doubleAreas,
  stretch,
  summarize,
  textureStretch,
} from "../../service/web/viewer/measures.js";
import { tornApart, weld } from "../../service/web/viewer/weld.js";

const TRIANGLE = [0, 0, 0, 1, 0, 0, 0, 1, 0];
const near = (actual, expected, tolerance = 1e-9) =>
  assert.ok(Math.abs(actual - expected) <= tolerance * Math.max(1, Math.abs(expected)), `${actual} is not ${expected}`);

/** The triangle under a linear map of the plane (a b; c d), turned out of it. */
function mapped([a, b, c, d]) {
  const [cos, sin] = [Math.cos(0.7), Math.sin(0.7)];
  const out = [];
  for (let i = 0; i < 9; i += 3) {
    const [x, y] = [a * TRIANGLE[i] + b * TRIANGLE[i + 1], c * TRIANGLE[i] + d * TRIANGLE[i + 1]];
    out.push(5 + x, cos * y - 3, sin * y + 2);
  }
  return out;
}

test("a rigid motion stretches nothing", () => near(stretch(TRIANGLE, mapped([1, 0, 0, 1]), [0, 1, 2])[0], 1));

test("growing and shrinking count alike", () => {
  near(stretch(TRIANGLE, mapped([3, 0, 0, 1]), [0, 1, 2])[0], 3);
  near(stretch(TRIANGLE, mapped([1, 0, 0, 1 / 3]), [0, 1, 2])[0], 3);
  near(stretch(TRIANGLE, mapped([2, 0, 0, 0.25]), [0, 1, 2])[0], 4);
  near(stretch(TRIANGLE, mapped([2, 0, 0, 2]), [0, 1, 2])[0], 2);
});

test("a shear by 1 has the golden ratio as its larger singular value", () =>
  near(stretch(TRIANGLE, mapped([1, 1, 0, 1]), [0, 1, 2])[0], (1 + Math.sqrt(5)) / 2));

test("a face that collapses is infinite, one that had no area is no number", () => {
  assert.equal(stretch(TRIANGLE, [0, 0, 0, 1, 0, 0, 2, 0, 0], [0, 1, 2])[0], Infinity);
  assert.ok(Number.isNaN(stretch([0, 0, 0, 1, 0, 0, 2, 0, 0], TRIANGLE, [0, 1, 2])[0]));
});

test("displacement is the distance of each vertex", () =>
  assert.deepEqual([...displacement([0, 0, 0, 1, 1, 1], [3, 4, 0, 1, 1, 1])], [5, 0]));

test("the percentile lies between its neighbours, and only finite values count", () => {
  const values = Float64Array.from({ length: 101 }, (_, i) => 100 - i);
  assert.deepEqual(summarize([values]), { min: 0, max: 100, p99: 99, count: 101 });
  assert.deepEqual(summarize([Float64Array.of(1, NaN, Infinity), Float64Array.of(2)]), { min: 1, max: 2, p99: 1.99, count: 2 });
  assert.deepEqual(summarize([]), { min: 0, max: 0, p99: 0, count: 0 });
});

test("faces are averaged by area, over a seam, without those that are infinite", () => {
  // Two faces that share the places of vertices 1 and 2, which the second has as 3 and 4; and one that collapsed.
  const groups = [0, 1, 2, 1, 2, 5];
  const values = averageToVertices([1, 4, Infinity], [3, 1, 9], [0, 1, 2, 3, 4, 5, 0, 0, 0], groups);
  assert.deepEqual([...values], [1, 1.75, 1.75, 1.75, 1.75, 4]);
});

test("vertices at one place are found, minus zero and zero among them", () => {
  const positions = Float32Array.of(0, 1, 2, 5, 5, 5, -0, 1, 2, 5, 5, 5.0000005);
  assert.deepEqual([...weld(positions)], [0, 1, 0, 3]);
});

test("another order tears places apart", () => {
  const before = Float32Array.of(0, 0, 0, 1, 0, 0, 0, 0, 0, 2, 0, 0);
  assert.deepEqual(tornApart(before, [7, 7, 7, 1, 0, 0, 7, 7, 7, 2, 0, 0], 1e-6), { torn: 0, shared: 1 });
  assert.deepEqual(tornApart(before, [7, 7, 7, 7, 7, 7, 1, 0, 0, 2, 0, 0], 1e-6), { torn: 1, shared: 1 });
});

test("texture stretch is the ratio of the larger singular values from texture to surface", () => {
  const texels = [0, 0, 256, 0, 0, 128];
  const ratio = (matrix, uvs = texels) => textureStretch(TRIANGLE, mapped(matrix), [0, 1, 2], uvs)[0];
  near(ratio([1, 0, 0, 1]), 1);
  near(ratio([3, 0, 0, 3]), 3);
  // A texel is 1/256 wide and 1/128 high: it has to become more than twice as wide before that is the worst direction.
  near(ratio([6, 0, 0, 1]), 3);
  near(ratio([1, 0, 0, 6]), 6);
  near(ratio([1.5, 0, 0, 1]), 1);
  const square = [0, 0, 1, 0, 0, 1];
  near(ratio([1, 1, 0, 1], square), (1 + Math.sqrt(5)) / 2);
  assert.ok(Number.isNaN(ratio([1, 0, 0, 1], [0, 0, 0, 0, 0, 0])));
});
