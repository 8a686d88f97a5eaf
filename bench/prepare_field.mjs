// CPU milliseconds that the page's scripts need to read a field, to unfold a level and to evaluate its scalars, in a process of Node.js that has
// just started: the same engine as Chromium's, but CPU time, which a busy machine does not change much. All threads of the process count.
// `again_ms` is the mean of 20 more times of unfolding, with every function compiled.
//
// node bench/prepare_field.mjs spot.ndf 3 pieces
import { readFileSync } from "node:fs";
import { readField, scalarsAt, unfold } from "../service/web/viewer/ndf.js";

const [path, level, ...names] = process.argv.slice(2);
const data = new Uint8Array(readFileSync(path));
const begin = process.cpuUsage();
const passed = () => (({ user, system }) => Number(((user + system) / 1000).toFixed(1)))(process.cpuUsage(begin));
const field = await readField(data);
const read_ms = passed();
const { indices, corners, weights } = unfold(field, Number(level));
const unfolded_ms = passed();
for (const scalars of field.scalars.filter(({ name }) => !names.length || names.includes(name)))
  for (let output = 0; output < (scalars.labels.length ? 1 : scalars.offset.length); output++) scalarsAt(scalars, corners, weights, output);
const all_ms = passed();
for (let round = 0; round < 5; round++) unfold(field, Number(level));
const compiled = passed();
for (let round = 0; round < 20; round++) unfold(field, Number(level));
const again_ms = Number(((passed() - compiled) / 20).toFixed(1));
console.log(JSON.stringify({ bytes: data.length, triangles: indices.length / 3, read_ms, unfolded_ms, all_ms, again_ms }));
