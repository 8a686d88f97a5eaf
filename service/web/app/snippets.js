// @ts-check
/**
 * A job or a preview as programs to copy: for the shell (curl), Python and TypeScript.
 *
 * @typedef {object} SnippetRequest
 * @property {Record<string, any>} document The request document of the job, as `POST /v1/jobs` takes it.
 * @property {Record<string, string | Record<string, string>>} [files] By its name in the job: the name of a file of the user, or a
 *   reference to one at the service (`{upload_id}`, `{job_id, artifact}`, `{url}`); beside those of the document.
 * @property {boolean} [preview] The shape alone, in seconds and without a job; else a job.
 * @property {string} [artifact] What to download; default: `result.glb`.
 * @property {string} [baseUrl] Address of the service; default: that of this page.
 * @property {boolean} [keyed] Whether requests need a key; default: whether the page has one.
 *
 * @typedef {keyof typeof WRITERS} Language
 */
import { copyText } from "./clipboard.js";
import { button, fill, h, uniqueId } from "./dom.js";
import { quoted } from "./format.js";
import { currentKey, storage } from "./key.js";

const CHOSEN = "meshdeform.language";
const WIDTH = 88;
const KEY = "MESHDEFORM_API_KEY";
/** What Python's `deform` takes beside the asset and the prompt, in its order, and what `preview_glb` does. */
const OF_JOB = ["kind", "params", "output", "metadata", "priority", "deadline_s", "max_run_s", "retention_s", "webhook"];
const OF_PREVIEW = ["params", "output"];

/** @typedef {Required<SnippetRequest> & {stem: string}} Known What a writer is given; `stem` names the new file. */

/** The programs. @param {SnippetRequest} request @returns {Record<Language, string>} */
export function snippets(request) {
  const { preview = false, artifact = "result.glb" } = request;
  // A preview shows several seeds at once, and its GLB is of one.
  const { seeds = [], files: stored = {}, ...rest } = request.document;
  const files = { ...stored, ...request.files };
  const main = files.asset ?? Object.values(files)[0];
  const stem = (typeof main === "string" ? main : "asset").replace(/^.*[\\/]/, "").replace(/\.[^.]*$/, "") || "asset";
  const baseUrl = (request.baseUrl ?? new URL(".", document.baseURI).href).replace(/\/$/, "");
  const wanted = preview && seeds.length ? { ...rest, params: { ...rest.params, seed: seeds[0] } } : rest;
  const known = { document: wanted, files, preview, artifact, baseUrl, stem, keyed: request.keyed ?? Boolean(currentKey()) };
  return /** @type {any} */ (Object.fromEntries(Object.entries(WRITERS).map(([name, write]) => [name, write(known)])));
}

/** The programs, one shown at a time, with a button that copies it. @param {SnippetRequest} request @returns {HTMLElement} */
export function snippetsBlock(request) {
  const made = snippets(request);
  const names = /** @type {Language[]} */ (Object.keys(made));
  const kept = /** @type {Language} */ (storage("localStorage")?.getItem(CHOSEN) ?? "");
  let shown = names.includes(kept) ? kept : names[0];
  const id = uniqueId("snippet");
  // Text that scrolls sideways must be reachable by keyboard.
  const code = h("pre", { id, role: "tabpanel", tabindex: "0", "aria-labelledby": `${id}-${shown}` });
  const tabs = names.map((name) => h("button", { type: "button", role: "tab", id: `${id}-${name}`, "aria-controls": id, on: { click: () => show(name) } }, name));
  const list = h("div", { class: "snippet-tabs", role: "tablist", "aria-label": "Language", on: { keydown: move } }, tabs);

  /** @param {Language} name */
  function show(name) {
    shown = name;
    storage("localStorage")?.setItem(CHOSEN, name);
    fill(code, h("code", null, made[name]));
    code.setAttribute("aria-labelledby", `${id}-${name}`);
    tabs.forEach((tab, at) => {
      tab.setAttribute("aria-selected", String(names[at] === name));
      tab.tabIndex = names[at] === name ? 0 : -1;
    });
  }

  /** @param {KeyboardEvent} event */
  function move(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const next = (names.indexOf(shown) + step + names.length) % names.length;
    show(names[next]);
    tabs[next].focus();
  }

  show(shown);
  return h("div", { class: "snippet" }, h("div", { class: "snippet-head" }, list, copyButton(() => made[shown])), code);
}

/** A button that copies a text. @param {() => string} text */
export function copyButton(text) {
  return button("Copy", () => copyText(text(), "Copied"));
}

/** A file as `curl -F` reads it. @param {string} name @param {string} path */
function formFile(name, path) {
  return quoted(/[";,\\]/.test(path) ? `${name}=@"${path.replace(/["\\]/g, "\\$&")}"` : `${name}=@${path}`);
}

/** @param {Known} request */
function curl({ document, files, preview, artifact, baseUrl, stem, keyed }) {
  const local = Object.entries(files).filter(([, file]) => typeof file === "string");
  const stored = Object.fromEntries(Object.entries(files).filter(([, file]) => typeof file !== "string"));
  const body = JSON.stringify(Object.keys(stored).length ? { ...document, files: stored } : document);
  const key = keyed ? ` -H "Authorization: Bearer $${KEY}"` : "";
  const sent = local.length
    ? [...local.map(([name, path]) => `-F ${formFile(name, /** @type {string} */ (path))}`), `--form-string request=${quoted(body)}`]
    : ["-H 'Content-Type: application/json'", `--data-raw ${quoted(body)}`];
  const path = preview ? "v1/jobs:preview?as=glb" : "v1/jobs";
  const out = preview ? `-o ${quoted(`${stem}-preview.glb`)}` : "-o /dev/stderr -w '%header{location}'";
  const post = [`curl -sS --fail-with-body${key} ${out}`, ...sent, quoted(`${baseUrl}/${path}`)].join(" \\\n  ");
  const head = keyed ? [`export ${KEY}=mdk_...`] : [];
  if (preview) return [...head, post, ""].join("\n");
  return [
    ...head,
    `JOB=${quoted(baseUrl)}$(${post})`,
    "# what happens, until the job has ended",
    `curl -sSN${key} -H 'Accept: text/event-stream' "$JOB/events"`,
    `curl -sS --fail-with-body${key} -o ${quoted(resultName(stem, artifact))} "$JOB/artifacts/${artifact}"`,
    "",
  ].join("\n");
}

/** @param {Known} request */
function python({ document, files, preview, baseUrl, stem, keyed }) {
  const { asset, target, ...more } = files;
  const names = (preview ? OF_PREVIEW : OF_JOB).filter((name) => document[name] !== undefined);
  const given = Object.fromEntries(names.map((name) => [name, document[name]]));
  const all = { ...(target ? { target } : {}), ...(Object.keys(more).length ? { files: more } : {}), ...given };
  const called = [
    ...(asset ? [literal(asset, PYTHON, 2)] : []),
    ...(document.prompt ? [asset ? text(document.prompt) : `prompt=${text(document.prompt)}`] : []),
    ...Object.entries(all).map(([name, value]) => `${name}=${literal(value, PYTHON, 2)}`),
  ];
  const method = `client.${preview ? "preview_glb" : "deform"}`;
  return [
    ...(preview ? ["from pathlib import Path", ""] : []),
    "from meshdeform import Client",
    "",
    ...(keyed ? [`# The key comes from the environment: export ${KEY}=mdk_...`] : []),
    `with Client(${text(baseUrl)}) as client:`,
    `    ${preview ? "made" : "result"} = ${joined(`${method}(`, called, ")", 1)}`,
    preview ? `    Path(${text(`${stem}-preview.glb`)}).write_bytes(made)` : `    result.save(${text(`${stem}-deformed`)})`,
    "",
  ].join("\n");
}

/** @param {Known} request */
function typescript({ document, files, preview, artifact, baseUrl, stem, keyed }) {
  const { asset, ...more } = files;
  const local = Object.values(files).some((file) => typeof file === "string");
  const given = joined("{ ", Object.entries(more).map(([name, file]) => `${member(name)}: ${fileOf(file)}`), " }", 1);
  const options = [...(Object.keys(more).length ? [`files: ${given}`] : []), ...(preview ? ['as: "glb"'] : [])];
  const called = [asset ? fileOf(asset) : "null", literal(document, SCRIPT, 1), ...(options.length ? [joined("{ ", options, " }", 1)] : [])];
  const result = text(preview ? `${stem}-preview.glb` : resultName(stem, artifact));
  return [
    `import { ${local ? "readFile, " : ""}writeFile } from "node:fs/promises";`,
    'import { Client } from "meshdeform";',
    "",
    `const client = new Client({ baseUrl: ${text(baseUrl)}${keyed ? `, apiKey: process.env["${KEY}"] ?? ""` : ""} });`,
    `const ${preview ? "made" : "job"} = await ${joined(`client.${preview ? "preview" : "deform"}(`, called, ")", 0)};`,
    preview
      ? `await writeFile(${result}, new Uint8Array(made.data));`
      : `await writeFile(${result}, new Uint8Array(await (await client.download(job, ${text(artifact)})).arrayBuffer()));`,
    "",
  ].join("\n");
}

/** The file of a result. @param {string} stem @param {string} artifact */
function resultName(stem, artifact) {
  return artifact === "result.glb" ? `${stem}-deformed.glb` : `${stem}-${artifact}`;
}

/** @param {string | Record<string, string>} file */
function fileOf(file) {
  if (typeof file !== "string") return literal(file, SCRIPT, 1);
  return `new File([new Uint8Array(await readFile(${text(file)}))], ${text(file.replace(/^.*[\\/]/, ""))})`;
}

/** @typedef {{constants: Record<string, string>, name: (name: string) => string, pad: string}} Syntax */
/** @type {Syntax} */
const PYTHON = { constants: { true: "True", false: "False", null: "None" }, name: text, pad: "" };
/** @type {Syntax} */
const SCRIPT = { constants: {}, name: member, pad: " " };

/** A string in double quotes, which all three languages read alike. @param {unknown} value */
function text(value) {
  return JSON.stringify(value);
}

/** @param {string} name */
function member(name) {
  return /^[A-Za-z_]\w*$/.test(name) ? name : text(name);
}

/** A value of JSON in another language. @param {unknown} value @param {Syntax} syntax @param {number} depth @returns {string} */
function literal(value, syntax, depth) {
  if (Array.isArray(value)) {
    const items = value.map((each) => literal(each, syntax, depth + 1));
    return joined("[", value.every((each) => typeof each === "number") ? filled(items) : items, "]", depth);
  }
  if (typeof value !== "object" || value === null) return (typeof value !== "string" && syntax.constants[String(value)]) || text(value);
  const members = Object.entries(value).filter(([, each]) => each !== undefined);
  const { name, pad } = members.length ? syntax : { ...syntax, pad: "" };
  return joined(`{${pad}`, members.map(([key, each]) => `${name(key)}: ${literal(each, syntax, depth + 1)}`), `${pad}}`, depth);
}

/** Items between brackets, on one line where they fit. @param {string} open @param {string[]} items @param {string} close @param {number} depth Of the line. */
function joined(open, items, close, depth) {
  const line = `${open}${items.join(", ")}${close}`;
  if (!items.length || (!line.includes("\n") && line.length + 4 * depth <= WIDTH)) return line;
  const indent = "    ".repeat(depth + 1);
  return [open.trimEnd(), ...items.map((item) => `${indent}${item},`), `${"    ".repeat(depth)}${close.trimStart()}`].join("\n");
}

/** Numbers, as many on a line as fit. @param {string[]} numbers @returns {string[]} Lines. */
function filled(numbers) {
  return numbers.reduce((lines, number) => {
    const last = lines.at(-1);
    if (last !== undefined && last.length + number.length < WIDTH / 2) lines[lines.length - 1] = `${last}, ${number}`;
    else lines.push(number);
    return lines;
  }, /** @type {string[]} */ ([]));
}

const WRITERS = { curl, Python: python, TypeScript: typescript };
