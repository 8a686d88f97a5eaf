// Many files at once: what each is at, what is to be done with it, and what a ZIP of all has.
import assert from "node:assert/strict";
import { test } from "node:test";
import { csvRow, Item, resultNames, tally } from "../../service/web/app/many/item.js";

const JOB = { id: "job_1", state: "queued", prompt: "20 % taller", asset: { filename: "dog.glb" }, metadata: { path: "pets/dog.glb" } };
const READ = { noun: "dog", sure: false, noun_given: false };

test("a file is changed by each sentence in turn, and read while nothing else is to be done", () => {
  const item = new Item("dog.glb", {});
  assert.deepEqual([item.state(""), item.next(""), item.next("wider")], ["waiting", "read", "change"]);
  item.made = { sentence: "wider", blob: {} };
  assert.equal(item.next("wider"), "read");
  item.doing = "reading";
  assert.deepEqual([item.state("wider"), item.state("")], ["changed", "reading"]);
  item.doing = "";
  item.why = { title: "No.", advice: "", sentence: null };
  assert.deepEqual([item.state("wider"), item.next("wider"), item.state("")], ["changed", "", "refused"]);
  item.made = item.why = null;
  item.reading = READ;
  assert.deepEqual([item.state(""), item.next(""), item.noun], ["read", "", "Perhaps a dog"]);
  assert.deepEqual([item.state("wider"), item.next("wider")], ["waiting", "change"]);
  item.made = { sentence: "wider", blob: {} };
  assert.deepEqual([item.state("wider"), item.next("wider"), item.has("wider")], ["changed", "", true]);
  assert.deepEqual([item.state("taller"), item.next("taller"), item.has("taller")], ["waiting", "change", false]);
});

test("a sample is not read before something is to be changed", () => {
  const item = new Item("dog.glb", {}, true);
  assert.deepEqual([item.state(""), item.next(""), item.next("wider")], ["read", "", "change"]);
});

test("a refusal is that of its sentence, one of the reading is that of all", () => {
  const item = new Item("dog.glb", {});
  item.reading = READ;
  item.why = { title: "No.", advice: "", sentence: "wider" };
  assert.deepEqual([item.state("wider"), item.next("wider")], ["refused", ""]);
  assert.equal(item.next("taller"), "change");
  item.why.sentence = null;
  assert.deepEqual([item.state("taller"), item.next("taller"), item.state("")], ["refused", "", "refused"]);
});

test("what is kept is its job, and says why it failed", () => {
  const item = Item.of(JOB);
  assert.deepEqual([item.path, item.keeps("20 % taller"), item.keeps(""), item.keeps("wider")], ["pets/dog.glb", true, true, false]);
  assert.deepEqual([item.state("20 % taller"), item.next("20 % taller")], ["queued", ""]);
  item.job = { ...JOB, state: "succeeded" };
  assert.deepEqual([item.words(""), item.next(""), item.failure], ["Kept", "look", null]);
  assert.equal(item.next("wider"), "change");
  item.job = { ...JOB, state: "failed", error: { title: "Out of memory", detail: "", advice: "Use less." } };
  assert.deepEqual(item.failure, { title: "Out of memory", advice: "Use less." });
  item.job = { ...JOB, state: "canceled" };
  assert.equal(item.failure?.title, "It was canceled.");
});

test("all are counted by what they are at", () => {
  const [one, other, third] = ["a.glb", "b.glb", "c.glb"].map((name) => new Item(name, {}));
  one.reading = other.reading = READ;
  other.doing = "changing";
  assert.equal(tally([one, other, third], ""), "1 read, 1 changing, 1 waiting");
});

test("results have the names of their files, each once and inside of the ZIP", () => {
  const paths = ["pets/dog.glb", "pets/dog.obj", "../pets/Dog.stl", "cat", "/pets/./a.b.glb"];
  assert.deepEqual(resultNames(paths), ["pets/dog.glb", "pets/dog-2.glb", "pets/Dog-3.glb", "cat.glb", "pets/a.b.glb"]);
});

test("a table has what needs quotes in quotes", () => {
  assert.equal(csvRow(["a", 1, 'say "x", y', "two\nlines"]), 'a,1,"say ""x"", y","two\nlines"');
});
