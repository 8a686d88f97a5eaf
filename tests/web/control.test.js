import assert from "node:assert/strict";
import { test } from "node:test";
import { controlOf, controlParams, controlProblem, History, isEmpty, noControl, regionWords } from "../../service/web/app/create/control/model.js";
import { documentOf, fileKey, wishOf } from "../../service/web/app/params.js";
import { readObjFaces } from "../../service/web/viewer/control/obj-faces.js";
import { keptFaces, Neighbours, rangesOf, selectedFaces, unionOf } from "../../service/web/viewer/control/selecting.js";

const GROUPS = { control: { regions: {}, handles: {}, symmetry: {}, falloff: {}, rigid: {} }, guidance: { sds: { prompts: {} }, target: {} }, unused: {}, input: {} };
const ASKED = {
  regions: [{ faces: [0, [4, 9]], action: "keep" }, { box: { min: [0, 0, 0], max: [1, 2, 1] }, action: "only" }],
  symmetry: "x",
};

const OTHERS = { rigid: [{ node: "wheel" }], handles: [{ position: [0, 1, 0], to: [0, 1.5, 0] }], falloff: 0.2 };

test("further prompts of a job are kept as they are, and the faces of a part are those of all its regions", () => {
  const prompts = [{ prompt: "a mushroom", weight: 3, regions: [{ node: "Head" }] }];
  const wish = wishOf({ prompt: "", params: { guidance: { prompts } } });
  const document = documentOf(wish, null, GROUPS);
  assert.deepEqual([document.params.guidance.prompts, "prompt" in document], [prompts, false]);
  assert.deepEqual([...unionOf([Uint8Array.from([1, 0, 0]), null, Uint8Array.from([0, 1, 0])], 3)], [1, 1, 0]);
});

test("a request asks for what the form holds, and the form holds what a job asked", () => {
  const control = controlOf(ASKED);
  assert.deepEqual(controlParams(control), ASKED);
  assert.deepEqual(controlParams(noControl()), {});
  assert.equal(isEmpty({ ...noControl(), regions: [{ faces: [], action: "keep" }] }), true);
  // As the API returns them: with members that are null.
  const told = controlOf({ regions: [{ node: "Hinge", box: null, action: "keep" }] });
  assert.deepEqual(told.regions, [{ node: "Hinge", action: "keep" }]);
  // The name of a part is for people.
  const head = { faces: [[0, 3]], action: "keep", label: "head" };
  assert.deepEqual(controlParams({ ...noControl(), regions: [head] }).regions, [{ faces: [[0, 3]], action: "keep" }]);
  assert.deepEqual([head, ...control.regions, told.regions[0]].map(regionWords), ["The head", "Painted, 7 triangles", "box", "node Hinge"]);
});

test("a job that is asked for again brings its control, and nothing twice", () => {
  const job = { prompt: "a vase", params: { control: { ...ASKED, ...OTHERS } }, output: {}, asset: { filename: "a.glb", size: 7 } };
  const wish = wishOf(job);
  assert.equal(wish.control.of, fileKey("a.glb", 7));
  assert.deepEqual(wish.kept.params, OTHERS, "what the form has no field for");
  const { checkpoint_every_steps: _, seed: __, preset: ___, ...params } = documentOf(wish, null, GROUPS).params;
  assert.deepEqual(params, { ...job.params, guidance: { kind: "sds" } });
});

test("what cannot be sent is said", () => {
  const good = controlOf(ASKED);
  assert.equal(controlProblem(good, false), "");
  assert.match(controlProblem(good, true), /numbered as in the file/);
});

test("undo goes back step by step, and the same state is no step", () => {
  const history = new History(noControl());
  history.add({ ...noControl(), symmetry: "x" });
  history.add({ ...noControl(), symmetry: "x" });
  history.add({ ...noControl(), symmetry: "y" });
  assert.equal(history.undo().symmetry, "x");
  assert.equal(history.undo().symmetry, "none");
  assert.equal(history.undo(), null);
});

// A strip of four triangles over six vertices.
const STRIP = {
  count: 4,
  rest: Float32Array.from([0, 0, 0, 1, 1, 0, 2, 0, 0, 3, 1, 0, 4, 0, 0, 5, 1, 0]),
  shown: Float32Array.from([0, 0, 0, 1, 1, 0, 2, 0, 0, 3, 1, 0, 4, 0, 0, 5, 1, 0]),
  groups: Uint32Array.from([0, 1, 2, 3, 4, 5]),
  corners: Uint32Array.from([0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4]),
};

test("a region selects what the service selects", () => {
  const faces = (region) => selectedFaces(region, STRIP) && [...selectedFaces(region, STRIP)];
  assert.deepEqual(faces({ faces: [0, [2, 3]] }), [1, 0, 1, 1]);
  assert.deepEqual(faces({ box: { min: [0, 0, 0], max: [3, 1, 0] } }), [1, 1, 0, 0]);
  assert.equal(faces({ node: "wheel" }), null);
  assert.equal(faces({ joint: { name: "Head" } }), null);
});

test("what is kept: each keep, and what lies outside of every only", () => {
  const flags = (...on) => Uint8Array.from([0, 1, 2, 3], (face) => Number(on.includes(face)));
  assert.deepEqual([...keptFaces([{ flags: flags(0) }], 4)], [1, 0, 0, 0]);
  assert.deepEqual([...keptFaces([{ action: "only", flags: flags(0, 1) }, { action: "keep", flags: flags(1) }], 4)], [0, 1, 1, 1]);
  // One `only` that the page does not know may hold anything.
  assert.deepEqual([...keptFaces([{ action: "only", flags: flags(0) }, { action: "only", flags: null }], 4)], [0, 0, 0, 0]);
  assert.deepEqual(rangesOf(flags(0, 2, 3)), [0, [2, 3]]);
});

test("a brush stays on the surface and within its radius", () => {
  const neighbours = new Neighbours(STRIP);
  assert.deepEqual(neighbours.around(0, [1, 0.3, 0], 0.1), [0]);
  assert.deepEqual(neighbours.around(0, [1, 0.3, 0], 1.2).sort(), [0, 1]);
  assert.deepEqual(neighbours.around(3, [4, 0.7, 0], 100).sort(), [0, 1, 2, 3]);
  // Two triangles at one place that share no vertex are two surfaces.
  const apart = new Neighbours({ corners: Uint32Array.from([0, 1, 2, 3, 4, 5]), groups: Uint32Array.from([0, 1, 2, 3, 4, 5]), shown: STRIP.shown });
  assert.deepEqual(apart.around(0, [1, 0, 0], 100), [0]);
});

test("an OBJ without faces, or with one that refers to nothing, is not numbered", () => {
  assert.equal(readObjFaces("v 0 0 0\n"), null);
  assert.equal(readObjFaces("v 0 0 0\nf 1 2 3\n"), null);
});

test("what a pointer changed is taken back as if it had not been", () => {
  const history = new History(noControl());
  const first = { ...noControl(), symmetry: "x" };
  history.add(first);
  const back = history.mark();
  history.add({ ...first, symmetry: "y" });
  history.add({ ...first, symmetry: "z" });
  assert.deepEqual(back(), first);
  assert.equal(history.past.length, 1);
  history.add(first);
  assert.equal(history.past.length, 1, "nothing to undo came from it");
  assert.deepEqual(history.undo(), noControl());
});
