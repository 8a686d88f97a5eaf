import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { groupsOf, fieldOf, plainParams } from "../../service/web/app/groups.js";
import { noControl } from "../../service/web/app/create/control/model.js";
import { checkpointEvery, documentOf, fieldProblem, integerProblem, keptText, nothingKept, numbersOf, randomSeed, wishOf } from "../../service/web/app/params.js";

const WISH = { prompt: " a mushroom ", model: "builtin", preset: "preview", seed: 7, subdivide: false, strength: "", kept: { params: {}, output: {} } };
// What the server serves as web/parameters.json has the same members.
const openapi = JSON.parse(readFileSync(new URL("../../openapi/openapi.json", import.meta.url), "utf8"));
const GROUPS = groupsOf({ ...openapi.components.schemas.DeformParams, $defs: openapi.components.schemas });

test("one job asks for what was chosen and nothing else", () => {
  assert.deepEqual(documentOf(WISH, 80, GROUPS), {
    prompt: "a mushroom", params: { preset: "preview", checkpoint_every_steps: 8, seed: 7, guidance: { kind: "sds", model: "builtin" } }, output: {},
  });
});

test("the front is a word or a number", () => {
  const asked = (front) => documentOf({ ...WISH, control: { ...noControl(), front } }, 80, GROUPS).params.guidance.orientation;
  assert.deepEqual(["90", "keep", ""].map(asked), [90, "keep", undefined]);
  assert.equal(wishOf({ params: { guidance: { orientation: 180 } } }).control.front, "180");
});

test("what is wrong is said", () => {
  const steps = { name: "steps", label: "Steps", help: "", type: "integer", min: 1, max: 50000 };
  assert.equal(fieldProblem(steps, ""), "");
  assert.match(fieldProblem(steps, "2.5"), /whole/);
  assert.match(fieldProblem(steps, "many"), /number/);
  assert.match(fieldProblem(steps, "0"), /At least 1/);
  assert.match(fieldProblem(steps, "60000"), /50,000/);
});

test("a whole number is not rounded, cut or guessed", () => {
  assert.deepEqual(["0", " 9 ", "+3"].map((text) => integerProblem(text, 0, 9)), ["", "", ""]);
  for (const text of ["", "1.5", "many", "1e3"]) assert.match(integerProblem(text, 0, 9), /whole number from 0 to 9/);
  assert.equal(integerProblem("-5", 0, 9), "At least 0.");
  assert.equal(integerProblem("99999999999999999999", 0, 9), "At most 9.");
});

test("a job's own parameters fill the form again, and what it has no field for is kept", () => {
  const job = {
    prompt: "a vase",
    params: { preset: "paper", seed: 3, learning_rate: 0.01, guidance: { timestep_min: 0.5 }, control: { exclude: ["Ground"] }, input: { up: "z" }, checkpoint_every_steps: 7 },
    output: { morph: true, subdivide: true, other: 1 },
  };
  const kept = { params: { learning_rate: 0.01, timestep_min: 0.5, exclude: ["Ground"], up: "z" }, output: { morph: true, other: 1 } };
  const wish = wishOf(job);
  const control = { ...noControl(), of: "" };
  const guide = { pictures: [], targets: 0 };
  assert.deepEqual(wish, { control, guide, byShape: false, prompt: "a vase", model: "", preset: "paper", seed: 3, subdivide: true, rig: "", strength: "", kept });
  const document = documentOf(wish, null, GROUPS);
  assert.deepEqual(document, {
    prompt: "a vase", params: { preset: "paper", seed: 3, learning_rate: 0.01, guidance: { kind: "sds", timestep_min: 0.5 }, control: { exclude: ["Ground"] }, input: { up: "z" } }, output: { morph: true, subdivide: true, other: 1 },
  });
  assert.equal(keptText(kept), 'learning_rate 0.01, timestep_min 0.5, exclude ["Ground"], up z, output.morph true, output.other 1');
  // What every job has is not kept, in whatever order its members are.
  const paths = { morph_path: { seconds: 1, frames: 8 }, other: { frames: 8 } };
  assert.deepEqual(wishOf({ output: paths }, { morph_path: { frames: 8, seconds: 1 }, other: { frames: 4 } }).kept.output, { other: { frames: 8 } });
  assert.equal(keptText(nothingKept()), "");
});

test("the rig is asked for where someone chose it", () => {
  assert.deepEqual(documentOf({ ...WISH, rig: "keep" }, 80, GROUPS).output, { rig: "keep" });
  const again = wishOf({ output: { rig: "follow" } }, { rig: "keep" });
  assert.deepEqual([again.rig, again.kept.output], ["follow", {}]);
});

test("each parameter is in its group, and what another kind of guidance has stays here", () => {
  const guide = { pictures: [{ azimuth: 0, elevation: 0 }] };
  const asked = (more) => documentOf({ ...WISH, kept: { params: { guidance_scale: 9, steps: 40 }, output: {} }, ...more }, 80, GROUPS).params;
  const common = { preset: "preview", steps: 40, checkpoint_every_steps: 4, seed: 7 };
  assert.deepEqual(asked({ guide: { ...guide, targets: 1 } }), { ...common, guidance: { kind: "target" } });
  assert.deepEqual(asked({ guide, prompt: "" }), { ...common, guidance: { kind: "silhouettes", silhouettes: guide.pictures } });
  const prompted = asked({ guide });
  assert.deepEqual(prompted, { ...common, guidance: { kind: "sds", silhouettes: guide.pictures, model: "builtin", guidance_scale: 9 } });
  assert.deepEqual(plainParams(prompted), { ...common, silhouettes: guide.pictures, model: "builtin", guidance_scale: 9 });
  // Reports have them as they are here.
  for (const params of [{ guidance: "target", seed: 3 }, { guidance: { kind: "target" }, seed: 3 }]) assert.deepEqual(plainParams(params), { guidance: "target", seed: 3 });
  assert.deepEqual(plainParams(undefined), {});
});

test("a refused place is read without its group", () => {
  const places = [["params", "guidance", "prompts", 0, "prompt"], ["params", "control", "falloff"], ["params", "guidance"], ["params", "steps"], ["target"]];
  assert.deepEqual(places.map((loc) => fieldOf({ loc })), [["prompts", 0, "prompt"], ["falloff"], ["guidance"], ["steps"], []]);
  assert.deepEqual(fieldOf({}), []);
});

test("numbers of another kind of job, with what they are by themselves", () => {
  const schema = {
    properties: {
      base_faces: { type: "integer", minimum: 100, maximum: 4000, default: 1000, description: "Faces of the base." },
      learning_rate: { type: "number", exclusiveMinimum: 0, maximum: 1, default: 0.01 },
      name: { type: "string" },
    },
  };
  const [faces, rate, ...more] = numbersOf(schema);
  assert.equal(more.length, 0);
  assert.deepEqual([faces.label, faces.help, faces.standard], ["Base faces", "Faces of the base.", 1000]);
  assert.equal(fieldProblem(faces, "20"), "At least 100.");
  assert.equal(fieldProblem(rate, "0"), "More than 0.");
  assert.deepEqual(numbersOf(undefined), []);
});
