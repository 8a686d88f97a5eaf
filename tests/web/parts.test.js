import assert from "node:assert/strict";
import { test } from "node:test";
import { partAt, sentenceOf, sizeOf, withWanted } from "../../service/web/app/create/parts/sentence.js";

const LONG = { operation: "long", more: "longer", less: "shorter" };
const FAT = { operation: "fat", more: "thicker", less: "thinner" };

test("what is asked of parts is one sentence, in the order in which it was asked", () => {
  let wanted = withWanted([], { part: "legs", change: LONG, percent: 30 });
  assert.equal(sentenceOf(wanted), "legs longer by 30 %");
  wanted = withWanted(wanted, { part: "tail", change: FAT, percent: 100 });
  wanted = withWanted(wanted, { part: "legs", change: LONG, percent: -50 });
  assert.equal(sentenceOf(wanted), "legs shorter by 50 % and tail thicker by 100 %");
  wanted = withWanted(wanted, { part: "legs", change: FAT, percent: 5 });
  wanted = withWanted(wanted, { part: "legs", change: LONG, percent: 0 });
  assert.equal(sentenceOf(wanted), "tail thicker by 100 % and legs thicker by 5 %");
  assert.equal(sentenceOf([]), "");
});

test("a triangle means the smallest part that has it, and one that only has a name at last", () => {
  const part = (name, found_by, faces) => ({ name, found_by, faces, changes: [LONG] });
  const parts = [part("arms", "joints", [[0, 9]]), part("hands", "joints", [2, [4, 5]]), part("skin", "names", [4, 12])];
  assert.equal(sizeOf(parts[1]), 3);
  const at = (face) => partAt(parts, face)?.name;
  assert.deepEqual([0, 2, 3, 4, 9, 10, 12].map(at), ["arms", "hands", "arms", "hands", "arms", undefined, "skin"]);
});
