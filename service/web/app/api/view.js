// @ts-check
/** The reference of the API, read from the document that the server has of itself. */
import { client } from "../client.js";
import { button, fill, h, labelled } from "../dom.js";
import { currentKey } from "../key.js";
import { problemBox } from "../problem-box.js";
import { copyButton, snippetsBlock } from "../snippets.js";
import { curlOf, matches, members, sections, typeOf } from "./model.js";

/** What the first program does: the sample asset of a clone, and a word. */
const FIRST = { document: { prompt: "a mushroom", params: { seed: 7 } }, files: { asset: "sphere.glb" } };

/** @param {HTMLElement} root @param {import("../scope.js").Scope} scope */
export async function showReference(root, scope) {
  fill(root, h("p", { class: "loading" }, "Loading…"));
  try {
    const spec = await client.json("openapi.json", { signal: scope.signal });
    const keyed = await needsKey(scope.signal);
    if (!scope.signal.aborted) new Reference(root, spec, keyed);
  } catch (error) {
    if (!scope.signal.aborted) fill(root, h("h1", null, "API"), problemBox(error));
  }
}

/** Whether programs need a key; nobody is asked for one to read about it. @param {AbortSignal} signal */
async function needsKey(signal) {
  if (currentKey()) return true;
  return (await fetch(new URL("v1/limits", document.baseURI), { signal })).status === 401;
}

class Reference {
  /** @param {HTMLElement} root @param {any} spec @param {boolean} keyed */
  constructor(root, spec, keyed) {
    this.spec = spec;
    this.keyed = keyed;
    this.sections = sections(spec);
    const search = h("input", { id: "api-search", type: "search", maxlength: 100, placeholder: "artifacts, POST, words…", on: { input: () => this.list(search.value) } });
    this.found = h("div", { class: "api-list" });
    this.count = h("p", { class: "muted small", role: "status" });
    fill(
      root,
      h("h1", null, "API"),
      h("p", { class: "lead" }, "Everything that this page does, your programs can do. ", keyed ? "Requests carry a key, as a bearer token. " : "This server needs no key. ",
        h("a", { href: "openapi.json" }, "The OpenAPI document"), ", ", h("a", { href: "#/usage" }, "what you have used"), "."),
      h("section", { class: "panel", "aria-labelledby": "api-job" }, h("h2", { id: "api-job" }, "A job, from the file to the result"), snippetsBlock({ ...FIRST, keyed })),
      h("section", { class: "panel", "aria-labelledby": "api-preview" }, h("h2", { id: "api-preview" }, "A preview, in seconds"), snippetsBlock({ ...FIRST, keyed, preview: true })),
      h("div", { class: "row api-search" }, labelled("api-search", "Find a request", search), this.count),
      this.found,
    );
    this.list("");
  }

  /** @param {string} words */
  list(words) {
    const shown = this.sections.map((section) => ({ ...section, operations: section.operations.filter((each) => matches(each, words)) })).filter(({ operations }) => operations.length);
    const number = shown.reduce((sum, { operations }) => sum + operations.length, 0);
    this.count.textContent = number === 1 ? "1 request" : `${number} requests`;
    fill(this.found, shown.map((section) => this.section(section)));
  }

  /** @param {{tag: string, about: string, operations: import("./model.js").Operation[]}} section */
  section({ tag, about, operations }) {
    const id = `api-tag-${tag}`;
    return h("section", { class: "api-section", "aria-labelledby": id }, h("h2", { id }, tag[0].toUpperCase() + tag.slice(1)), h("p", { class: "muted" }, prose(about)), operations.map((each) => this.operation(each)));
  }

  /** @param {import("./model.js").Operation} operation */
  operation(operation) {
    const summary = h("summary", null, h("span", { class: `api-method api-${operation.method.toLowerCase()}` }, operation.method), h("code", null, operation.path), h("span", { class: "api-summary" }, operation.summary));
    return whenOpened(h("details", { class: "api-operation", id: `api-${operation.id}` }, summary), () => this.details(operation));
  }

  /** @param {import("./model.js").Operation} operation */
  details(operation) {
    const { parameters, body, answers } = operation;
    const curl = curlOf(this.spec, operation, new URL(".", document.baseURI).href, this.keyed);
    return [
      operation.about ? operation.about.split(/\n\n+/).map((text) => h("p", null, prose(text))) : null,
      parameters.length ? [h("h3", null, "Parameters"), h("dl", { class: "api-members" }, parameters.flatMap((each) => this.row({ name: each.name, type: `${typeOf(this.spec, each.schema)}, in ${each.in}`, required: each.required, about: each.description ?? "", schema: null })))] : null,
      body ? [h("h3", null, "Body, ", h("code", null, body.type)), this.members(body.schema)] : null,
      h("h3", null, "Answers"),
      h("dl", { class: "api-members" }, answers.flatMap(({ status, about, schema }) => [h("dt", null, h("code", null, status)), h("dd", null, prose(about), schema ? this.inside(schema) : null)])),
      h("div", { class: "snippet" }, h("div", { class: "snippet-head" }, h("h3", null, "curl"), copyButton(() => curl)), h("pre", { tabindex: "0", "aria-label": "curl", role: "region" }, h("code", null, curl))),
    ];
  }

  /** @param {any} schema @returns {HTMLElement} */
  members(schema) {
    const found = members(this.spec, schema);
    if (!found.length) return h("p", { class: "muted" }, typeOf(this.spec, schema));
    return h("dl", { class: "api-members" }, found.flatMap((each) => this.row(each)));
  }

  /** @param {import("./model.js").Member} member */
  row({ name, type, required, about, schema }) {
    const told = [h("span", { class: "muted small" }, type), required ? h("span", { class: "api-required" }, "required") : null];
    return [h("dt", null, h("code", null, name), " ", told), h("dd", null, prose(about), schema ? this.inside(schema) : null)];
  }

  /** What is inside of a member is made when somebody looks: schemas refer to each other. @param {any} schema */
  inside(schema) {
    if (!members(this.spec, schema).length) return null;
    return whenOpened(h("details", { class: "api-inside" }, h("summary", null, "Members")), () => this.members(schema));
  }
}

/** Fill an element when it is opened for the first time. @param {HTMLDetailsElement} details @param {() => any} make */
function whenOpened(details, make) {
  details.addEventListener("toggle", () => details.open && details.append(...[make()].flat(3).filter(Boolean)), { once: true });
  return details;
}

/** Text with its `code`; links of the documents become their words. @param {string} text @returns {(Node | string)[]} */
function prose(text) {
  return text.replace(/\[([^\]]+)\]\([^)]+\)/g, "$1").split(/`([^`]+)`/).map((text, at) => (at % 2 ? h("code", null, text) : text));
}

/** What the owner of the key has used, by month. @param {HTMLElement} root @param {import("../scope.js").Scope} scope */
export async function showUsage(root, scope) {
  const months = h("div", { class: "panel" }, h("p", { class: "loading" }, "Loading…"));
  fill(root, h("h1", null, "Usage"), h("p", { class: "lead" }, "Jobs that ended, the time for which workers had them, and the files that they made."), months);
  const load = async () => {
    try {
      fill(months, table(await client.usage(scope.signal)));
    } catch (error) {
      if (!scope.signal.aborted) fill(months, problemBox(error), button("Try again", load));
    }
  };
  await load();
}

/** @param {import("../../client/types.js").UsageMonth[]} months */
function table(months) {
  if (!months.length) return h("p", { class: "muted" }, "Nothing yet: months appear with the first job that ends.");
  const number = new Intl.NumberFormat("en", { maximumFractionDigits: 1 });
  const named = new Intl.DateTimeFormat("en", { month: "long", year: "numeric", timeZone: "UTC" });
  return h(
    "table",
    { class: "usage" },
    h("thead", null, h("tr", null, ["Month", "Jobs", "Seconds", "Megabytes"].map((name) => h("th", { scope: "col" }, name)))),
    h("tbody", null, months.map(({ month, jobs, seconds, bytes }) => h("tr", null, h("th", { scope: "row" }, named.format(new Date(`${month}-01T00:00:00Z`))), [jobs, seconds, bytes / 1e6].map((each) => h("td", null, number.format(each)))))),
  );
}
