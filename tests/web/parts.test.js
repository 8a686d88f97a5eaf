import assert from "node:assert/strict";
import { test } from "node:test";
import { controlOf, controlParams, isEmpty, readingOf } from "../../service/web/app/create/control/model.js";
import { joined, moved } from "../../service/web/app/create/parts/naming.js";
import { doubts, ELSE, frontOptions, isUnsure, nounOptions, originWords, readingSentence } from "../../service/web/app/create/parts/reading.js";
import { partAt, sentenceOf, sizeOf, withWanted } from "../../service/web/app/create/parts/sentence.js";
import { documentOf, wishOf } from "../../service/web/app/params.js";

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

const READING = {
  noun: "elephant", probability: 0.52, sure: false, noun_given: false, front_azimuth_deg: 90, front_sure: true, front_given: false,
  nouns: [{ noun: "elephant", probability: 0.52 }, { noun: "cow", probability: 0.31 }],
};

test("an asset is told as what it is read as, and as no surer than that", () => {
  assert.deepEqual(doubts(READING, false), ["Perhaps an", "perhaps faces"], "the front of a guess is a guess");
  assert.deepEqual(doubts({ ...READING, front_given: true }, false), ["Perhaps an", "faces"]);
  assert.deepEqual(nounOptions(READING, "").map(([value]) => value), ["", "elephant", "cow", ELSE]);
  assert.equal(nounOptions(READING, "")[0][1], "elephant, 52%");
  const sure = { ...READING, sure: true, front_sure: false };
  assert.deepEqual(doubts(sure, false), ["", "perhaps faces"]);
  assert.deepEqual(doubts(sure, true), ["", "faces"], "who said it is sure");
  assert.deepEqual(nounOptions(sure, ""), [["", "Elephant"], ["cow", "cow, 31%"], [ELSE, "Something else…"]]);
  const given = { ...READING, noun: "mouse", noun_given: true };
  assert.deepEqual(doubts(given, false), ["", "faces"]);
  assert.deepEqual(nounOptions(given, "mouse").map(([value]) => value), ["mouse", "elephant", "cow", "", ELSE]);
});

test("the front is one of eight sides, or an angle", () => {
  assert.deepEqual(frontOptions(READING, "").map(([value]) => value), ["", "0", "45", "90", "135", "180", "225", "270", "315"]);
  const first = (front_azimuth_deg, said = "") => frontOptions({ ...READING, front_azimuth_deg }, said)[0][1];
  assert.deepEqual([first(90), first(-90), first(50), first(null)], ["+X", "−X", "50°", "no side that is the front"]);
  assert.deepEqual(frontOptions(READING, "35").at(-1), ["35", "35°"]);
  assert.equal(first(90, "0"), "As it was read");
});

test("how a part was found is said, and a guess is a guess", () => {
  const part = (found_by, confidence = null) => ({ name: "ears", found_by, confidence, faces: [], changes: [] });
  assert.deepEqual([part("given"), part("joints"), part("names"), part("shapes", 0.87)].map((each) => originWords(each, READING, true)), ["As you said.", "By the joints of the file.", "By a name in the file.", "Found by its shape, 87% sure."]);
  assert.deepEqual([part("shapes", 0.2), part("shapes", 0.5), part("given")].map((each) => isUnsure(each, READING)), [true, false, false]);
  const guess = { ...READING, probability: 0.3 };
  assert.deepEqual([part("shapes", 0.9), part("joints")].map((each) => isUnsure(each, guess)), [true, false]);
  assert.equal(originWords(part("given"), READING, false), "As the file says.");
  assert.equal(isUnsure(part("shapes", 0.9), { ...guess, noun_given: true }), false);
  assert.equal(originWords(part("shapes", 0.9), guess, false), "If it is an elephant: found by its shape, 90% sure.");
  assert.equal(originWords(part("shapes", 0.2), null, false), "Perhaps found by its shape, 20% sure.");
});

test("parts get names and become one, and what is called as it was found is no correction", () => {
  let names = joined([], ["horns"], "ears");
  assert.deepEqual(names, [{ name: "ears", parts: ["horns"] }]);
  names = joined(names, ["ears", "crest"], "ears");
  assert.deepEqual(names, [{ name: "ears", parts: ["horns", "crest"] }]);
  names = joined(names, ["ears"], "antlers");
  assert.deepEqual(names, [{ name: "antlers", parts: ["horns", "crest"] }], "by the names that they were found under");
  assert.deepEqual(joined([{ name: "ears", parts: ["horns"] }], ["ears"], "horns"), []);
});

test("corrections are sent as documented, kept for the next job, and said", () => {
  const asked = {
    source_noun: "elephant",
    parts: [{ name: "ears", parts: ["horns", "crest"] }, { name: "trunk", faces: [[0, 8]], parts: null, node: null }],
    regions: [{ node: "Foot", action: "keep" }],
  };
  const control = controlOf(asked);
  assert.deepEqual(controlParams(control), { ...asked, parts: [asked.parts[0], { name: "trunk", faces: [[0, 8]] }] });
  assert.deepEqual(controlParams(readingOf(control)), controlParams(controlOf({ ...asked, regions: [] })));
  assert.equal(isEmpty(readingOf(control)), true, "they say nothing about what may move");
  const wish = wishOf({ prompt: "longer legs", params: { guidance: { source_noun: "elephant" }, control: { parts: asked.parts } } });
  assert.deepEqual(wish.kept.params, {});
  const groups = { control: { parts: {}, regions: {} }, guidance: { sds: { source_noun: {} }, target: {} }, unused: {}, input: {} };
  const { guidance, control: sent } = documentOf(wish, null, groups).params;
  assert.deepEqual(guidance, { kind: "sds", source_noun: "elephant" });
  assert.deepEqual(sent.parts[1], { name: "trunk", faces: [[0, 8]] });
  assert.deepEqual(moved(control.regions, ["trunk"], "nose")[1].action, "part:nose");
});

test("what the asset is read as is a sentence, and a guess says so", () => {
  const reading = { noun: "dog", probability: 0.9, sure: true, nouns: [], noun_given: false, front_azimuth_deg: 270, front_sure: true, front_given: false };
  assert.equal(readingSentence(reading, 4), "Read as a dog, facing left. Its parts:");
  assert.equal(readingSentence({ ...reading, front_azimuth_deg: -20 }, 0), "Read as a dog, facing you.");
  assert.equal(readingSentence({ ...reading, noun: "owl", sure: false, front_azimuth_deg: 100 }, 1), "Perhaps an owl, perhaps facing right. Its parts:");
  assert.equal(readingSentence({ ...reading, front_azimuth_deg: null }, 0), "Read as a dog.");
});
