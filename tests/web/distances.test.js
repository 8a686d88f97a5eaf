import assert from "node:assert/strict";
import { test } from "node:test";
import { distancesFrom } from "../../service/web/viewer/distances.js";

test("distances in a plane are straight, and none leads to another part", () => {
  const [positions, indices, side] = [[], [], 21];
  for (let i = 0; i < side; i++) for (let j = 0; j < side; j++) positions.push(i / 10, j / 20, 7);
  for (let i = 0; i + 1 < side; i++) for (let j = 0; j + 1 < side; j++) {
    const a = i * side + j;
    indices.push(a, a + side, a + 1, a + side, a + side + 1, a + 1);
  }
  const far = positions.length / 3;
  positions.push(9, 9, 9, 9, 8, 9, 8, 9, 9);
  indices.push(far, far + 1, far + 2);
  const found = distancesFrom(Float64Array.from(positions), Uint32Array.from(indices), 0);
  for (let v = 0; v < far; v++) assert.ok(Math.abs(found[v] - Math.hypot(positions[3 * v], positions[3 * v + 1])) < 1e-9);
  assert.deepEqual([...found.subarray(far)], [Infinity, Infinity, Infinity]);
});

