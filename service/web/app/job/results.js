// @ts-check
/** What a job produced: its quality in words, its files, its settings. */
import { button, h, icon, panel } from "../dom.js";
import { bytes, count } from "../format.js";
import { plainParams } from "../groups.js";
import { currentLink } from "../key.js";
import { artifactName } from "../names.js";
import { findings } from "../quality.js";
import { fileInput } from "../picking.js";
import { copyLink, deformAlike, download, downloadMade } from "./files.js";
import { isDeformation } from "./shapes.js";

const GLYPHS = { good: "check", warn: "warn", plain: "info" };

/** @param {import("../quality.js").Finding[]} findings */
function findingList(findings) {
  const row = (/** @type {import("../quality.js").Finding} */ { tone, text, note }) =>
    h("li", { class: `finding finding-${tone}` }, icon(GLYPHS[tone]), h("div", null, h("strong", null, text), note ? h("span", { class: "small muted" }, note) : null));
  return h("ul", { class: "findings" }, findings.map(row));
}

// What the service can make of a finished job that was not asked for it, besides the formats of its result.
const AFTERWARDS = ["map.safetensors"];
const FILES = /** @type {Record<string, string>} */ ({
  "result.glb": "The asset in its new shape",
  "morph.glb": "The way from before to after, as an animation",
  "result.stl": "The new shape for printing: metres, Y up",
  "map.safetensors": "Map of the edit, for other files on the command line",
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

/** What a job of another kind began with. */
const SOURCES = /** @type {Record<string, string>} */ ({ family_fit: "The collection", family_synthesize: "The family" });

/** What files of the same name are for other kinds of job. */
const PICTURES = /** @type {Record<string, Record<string, string>>} */ ({
  family_fit: { "preview.png": "The assets, coloured by part" },
  family_synthesize: { "preview.png": "The shapes", "result.glb": "The first shape" },
});

/** What was measured: why the result is worth what it is stands elsewhere. @param {any} report @param {Record<string, any>} [files] Of the job, by their names in it. */
export function qualityPanel(report, files = {}) {
  return panel("quality-title", "Quality", findingList(findings(report, files)));
}

/** @param {any} job @param {any[]} artifacts @param {import("../scope.js").Scope} scope */
export function filesPanel(job, artifacts, scope) {
  const order = Object.keys(FILES);
  // Who came by a link reads what there is.
  const shared = currentLink() !== "";
  const sorted = [...artifacts].sort((a, b) => rank(order, a.name) - rank(order, b.name));
  const line = (/** @type {string} */ title, /** @type {string} */ text, /** @type {(HTMLElement | null)[]} */ ...tools) =>
    h("li", { class: "file" }, h("div", null, h("strong", null, title), h("span", { class: "small muted" }, text)), h("div", { class: "row" }, tools));
  const row = (/** @type {any} */ found) => {
    const path = `v1/jobs/${job.id}/artifacts/${found.name}`;
    const text = PICTURES[job.kind]?.[found.name] ?? FILES[found.name] ?? (found.content_type === "model/gltf-binary" ? "A mesh" : found.content_type);
    const link = shared ? null : button(`Copy a link to ${found.name}`, () => copyLink(path, scope), { icon: "link", quiet: true, class: "button-quiet" });
    return line(found.name, `${text} · ${bytes(found.size)}`, link, button(`Download ${found.name}`, () => download(path, artifactName(job, found.name), found.size, true, scope), { icon: "download", quiet: true }));
  };
  const makeRow = (/** @type {string} */ name) => {
    const make = button(`Make and download ${name}`, async () => {
      make.disabled = true;
      await downloadMade(job, name, scope);
      make.disabled = false;
    }, { icon: "download", quiet: true });
    return line(name, `${FILES[name]} · made when you download it`, make);
  };
  const mayMake = job.state === "succeeded" && isDeformation(job) && !shared;
  const others = fileInput("alike", "Files to deform alike", "", (files) => deformAlike(job, files, scope), true);
  const { filename, size } = job.asset;
  const list = h(
    "ul",
    { class: "files" },
    sorted.map(row),
    mayMake ? AFTERWARDS.filter((name) => !artifacts.some((found) => found.name === name)).map(makeRow) : null,
    line(filename, `${SOURCES[job.kind] ?? "The asset"} as ${shared ? "it was sent" : "you sent it"} · ${bytes(size)}`, button(`Download ${filename}`, () => download(`v1/jobs/${job.id}/asset`, filename, size, false, scope), { icon: "download", quiet: true })),
    mayMake ? line("Other files", "Levels of detail, clothes, props that lie where the asset does", others, button("Deform other files alike", () => others.click(), { icon: "spark", quiet: true })) : null,
  );
  return panel("files-title", "Files", list);
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
    h("summary", null, h("h2", null, "All settings")),
    origin,
    h("dl", { class: "parameters" }, Object.entries(params).flatMap(([name, value]) => entry(name, value))),
    report?.versions ? h("p", { class: "small muted" }, `Meshdeform ${report.versions.meshdeform}, torch ${report.versions.torch}${report.device ? `, on ${report.device}` : ""}`) : null,
    h("p", { class: "small muted" }, h("code", null, job.id)),
  );
}
