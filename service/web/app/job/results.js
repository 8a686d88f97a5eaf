// @ts-check
/** What a job produced: its quality in words or what it taught, its files, its settings. */
import { button, h, icon, panel } from "../dom.js";
import { bytes, count } from "../format.js";
import { plainParams } from "../groups.js";
import { currentLink } from "../key.js";
import { artifactName } from "../names.js";
import { findings, skipped } from "../quality.js";
import { routeHash } from "../router.js";
import { withArticle } from "../vocabulary.js";
import { fileInput } from "../picking.js";
import { copyLink, deformAlike, download, downloadMade } from "./files.js";
import { isDeformation } from "./shapes.js";

const GLYPHS = { good: "check", warn: "warn", plain: "info" };

/** @param {import("../quality.js").Finding[]} findings */
export function findingList(findings) {
  const row = (/** @type {import("../quality.js").Finding} */ { tone, text, note }) =>
    h("li", { class: `finding finding-${tone}` }, icon(GLYPHS[tone]), h("div", null, h("strong", null, text), note ? h("span", { class: "small muted" }, note) : null));
  return h("ul", { class: "findings" }, findings.map(row));
}

// What the service can make of a finished job that was not asked for it.
const AFTERWARDS = ["result.stl", "morph.glb", "map.safetensors"];
const FILES = /** @type {Record<string, string>} */ ({
  "result.glb": "The asset in its new shape",
  "morph.glb": "The way from before to after, as an animation",
  "result.stl": "The new shape for printing: metres, Y up",
  "map.safetensors": "What deforms other files alike, on the command line",
  "surface.ndf": "The surface: base mesh and network",
  ...Object.fromEntries([0, 1, 2, 3, 4].map((level) => [`level_${level}.glb`, level ? `Every edge of the base in ${2 ** level}` : "The base mesh"])),
  "intrinsic.npz": "The highest level after intrinsic Delaunay flips",
  "segmentation.npz": "The part of each triangle",
  "correspondences.npz": "Where each point of the templates lies",
  "descriptors.npz": "Descriptors of the assets",
  "family.safetensors": "Templates, and the model of their shapes",
  "labelled.zip": "The assets with their parts",
  "wall.glb": "The shapes side by side, coloured by part",
  "shapes.zip": "All shapes, each as a GLB",
  "points.npz": "The points of the shapes",
  "weights.safetensors": "The model with its new word",
  "report.json": "Settings, figures, versions",
  "preview.png": "Before and after from four sides",
});

/** What files of the same name are for other kinds of job. */
const PICTURES = /** @type {Record<string, Record<string, string>>} */ ({
  family_fit: { "preview.png": "The assets, coloured by part" },
  family_synthesize: { "preview.png": "The shapes", "result.glb": "The first shape" },
});

/** @param {any} report */
export function qualityPanel(report) {
  const left = skipped(report);
  return panel("quality-title", "Quality", findingList(findings(report)), left.length ? h("p", { class: "small muted" }, `Input mesh: ${left.join(", ")}.`) : null);
}

/** @param {any} job @param {any[]} artifacts @param {import("../scope.js").Scope} scope */
export function filesPanel(job, artifacts, scope) {
  const order = Object.keys(FILES);
  // Who came by a link reads what there is.
  const shared = currentLink() !== "";
  const sorted = [...artifacts].sort((a, b) => rank(order, a.name) - rank(order, b.name));
  const row = (/** @type {string} */ name, /** @type {string} */ saved, /** @type {string} */ text, /** @type {number} */ size, /** @type {string} */ path, /** @type {boolean} */ signed) =>
    h(
      "li",
      { class: "file" },
      h("div", null, h("strong", null, name), h("span", { class: "small muted" }, `${text} · ${bytes(size)}`)),
      h(
        "div",
        { class: "row" },
        signed && !shared ? button(`Copy a link to ${name}`, () => copyLink(path, scope), { icon: "link", quiet: true, class: "button-quiet" }) : null,
        button(`Download ${name}`, () => download(path, saved, size, signed, scope), { icon: "download", quiet: true }),
      ),
    );
  const makeRow = (/** @type {string} */ name) => {
    const make = button(`Make and download ${name}`, async () => {
      make.disabled = true;
      await downloadMade(job, name, scope);
      make.disabled = false;
    }, { icon: "download", quiet: true });
    const words = h("div", null, h("strong", null, name), h("span", { class: "small muted" }, `${FILES[name]} · made when you download it`));
    return h("li", { class: "file" }, words, h("div", { class: "row" }, make));
  };
  const mayMake = job.state === "succeeded" && isDeformation(job) && !shared;
  const others = fileInput("alike", "Files to deform alike", "", (files) => deformAlike(job, files, scope), true);
  return panel(
    "files-title",
    "Files",
    h(
      "ul",
      { class: "files" },
      sorted.map((found) =>
        row(found.name, artifactName(job, found.name), PICTURES[job.kind]?.[found.name] ?? FILES[found.name] ?? (found.content_type === "model/gltf-binary" ? "A mesh" : found.content_type), found.size, `v1/jobs/${job.id}/artifacts/${found.name}`, true),
      ),
      mayMake ? AFTERWARDS.filter((name) => !artifacts.some((found) => found.name === name)).map(makeRow) : null,
      row(job.asset.filename, job.asset.filename, `The ${job.kind === "family_fit" ? "collection" : "asset"} as ${shared ? "it was sent" : "you sent it"}`, job.asset.size, `v1/jobs/${job.id}/asset`, false),
      mayMake
        ? h(
            "li",
            { class: "file" },
            h("div", null, h("strong", null, "Other files"), h("span", { class: "small muted" }, "Levels of detail, clothes, props that lie where the asset does")),
            h("div", { class: "row" }, others, button("Deform other files alike", () => others.click(), { icon: "spark", quiet: true })),
          )
        : null,
    ),
  );
}

/** @param {string[]} order @param {string} name */
function rank(order, name) {
  const found = order.indexOf(name);
  return found < 0 ? order.length : found;
}

/** @param {any} job @param {any} report Null where there is none. */
export function parametersPanel(job, report) {
  const written = plainParams(job.params);
  const params = report?.params ?? written;
  const entry = (/** @type {string} */ name, /** @type {unknown} */ value) => [
    h("dt", { class: name in written ? "written" : null }, name),
    h("dd", null, typeof value === "number" ? String(Number(value.toPrecision(8))) : value && typeof value === "object" ? JSON.stringify(value) : String(value) || "–"),
  ];
  const origin = job.origin
    ? h(
        "p",
        { class: "small" },
        `${job.origin.mode === "branch" ? "New version of" : "Retry of"} `,
        h("a", { href: `#/jobs/${job.origin.job_id}` }, "another job"),
        job.origin.step ? `, from step ${count(job.origin.step)}` : "",
      )
    : null;
  return h(
    "details",
    { class: "panel panel-fold" },
    h("summary", null, h("h2", null, "Settings")),
    origin,
    h("dl", { class: "parameters" }, Object.entries(params).flatMap(([name, value]) => entry(name, value))),
    report?.versions ? h("p", { class: "small muted" }, `Meshdeform ${report.versions.meshdeform}, torch ${report.versions.torch}${report.device ? `, on ${report.device}` : ""}`) : null,
    h("p", { class: "small muted" }, h("code", null, job.id)),
  );
}

/** @param {any} job */
export function isLesson(job) {
  return job.kind === "prior_teach";
}

/** What the report of a lesson says, in sentences. @param {any} report @returns {import("../quality.js").Finding[]} */
export function lessonFindings(report) {
  const { new: learned, old_before: before, old_after: after } = report.retrieval;
  const word = report.nouns.length === 1 ? withArticle(report.nouns[0].noun) : "what they show";
  return [
    { tone: learned.share >= 0.75 ? "good" : "warn", text: `${learned.hits} of ${learned.pictures} pictures that it had not seen look like ${word} to the model`, note: "Held-out pictures of your meshes" },
    { tone: after.hits >= before.hits - 2 ? "good" : "warn", text: `${after.hits} of ${after.pictures} old words that were tried are still known`, note: `Before the lesson: ${before.hits}` },
    { tone: "plain", text: `The weights of step ${report.steps.best} are kept`, note: report.stopped_early ? `Stopped after ${report.steps.done} steps, as more did not help` : `${report.steps.done} steps` },
    ...report.warnings.map((/** @type {string} */ text) => ({ tone: /** @type {const} */ ("warn"), text, note: "" })),
  ];
}

/** @param {any} job @param {any} report */
export function lessonPanel(job, report) {
  const prompt = withArticle(report.nouns[0].noun);
  return panel(
    "lesson-title",
    "What it learned",
    findingList(lessonFindings(report)),
    // Who came by a link makes no jobs.
    currentLink() ? null : h("p", null, h("a", { class: "button button-primary", href: routeHash({ name: "create", from: null, model: `job:${job.id}`, prompt }) }, `Use “${prompt}”`)),
  );
}
