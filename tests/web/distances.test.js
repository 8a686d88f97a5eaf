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

test("distances on a ball are angles", () => {
  const [rows, columns] = [40, 80];
  const [positions, indices] = [[], []];
  for (let i = 0; i <= rows; i++) for (let j = 0; j < columns; j++) {
    const [down, around] = [(Math.PI * i) / rows, (2 * Math.PI * j) / columns];
    positions.push(Math.sin(down) * Math.cos(around), Math.cos(down), Math.sin(down) * Math.sin(around));
  }
  for (let i = 0; i < rows; i++) for (let j = 0; j < columns; j++) {
    const [a, b] = [i * columns + j, i * columns + ((j + 1) % columns)];
    if (i > 0) indices.push(a, b, a + columns);
    if (i < rows - 1) indices.push(b, b + columns, a + columns);
  }
  const source = (rows / 2) * columns + 7;
  const found = distancesFrom(Float64Array.from(positions), Uint32Array.from(indices), source);
  const at = (v) => positions.slice(3 * v, 3 * v + 3);
  const apart = [];
  for (let v = columns; v < rows * columns; v++) {
    const angle = Math.acos(Math.max(-1, Math.min(1, at(v).reduce((sum, value, axis) => sum + value * at(source)[axis], 0))));
    apart.push(Math.abs(found[v] - angle));
  }
  assert.ok(apart.reduce((sum, value) => sum + value) / apart.length < 0.01);
  assert.ok(Math.max(...apart) < 0.08);
});
