// @ts-check
/**
 * Addresses of the page's views. They live behind the `#`, so that the page is one file wherever it is served.
 *
 * @typedef {{name: "create", from: string | null, result?: boolean, example?: string}
 *   | {name: "surface", from: string | null, quick?: boolean}
 *   | {name: "family", from: string | null}
 *   | {name: "examples" | "field" | "words" | "api" | "usage"}
 *   | {name: "jobs", state: string | null, search?: string}
 *   | {name: "job", id: string}
 *   | {name: "shared", id: string, link: string}
 *   | {name: "many", id?: string}
 *   | {name: "compare", ids: [string, string]}
 *   | {name: "unknown", path: string}} Route
 */
import { STATE_WORDS } from "./format.js";

/** As the API has it. */
export const MAX_SEARCH = 200;
const JOB = /^job_[0-9a-z]{1,64}$/;
const EXAMPLE = /^[a-z0-9-]{1,40}$/;
const LINK = /^link\.[\w.-]{1,300}$/;
const GROUP = /^[\w-]{1,64}$/;

/** What follows the first word of an address, and the view that it means. @type {[string, RegExp[], (rest: string[], query: URLSearchParams) => Route][]} */
const ROUTES = [
  ["", [], (_, query) => createRoute(query)],
  ["surface", [], (_, query) => ({ name: "surface", from: jobOf(query), ...(query.has("quick") ? { quick: true } : {}) })],
  ["family", [], (_, query) => ({ name: "family", from: jobOf(query) })],
  ["field", [], () => ({ name: "field" })],
  ["many", [], () => ({ name: "many" })],
  ["many", [GROUP], ([id]) => ({ name: "many", id })],
  ["words", [], () => ({ name: "words" })],
  ["api", [], () => ({ name: "api" })],
  ["usage", [], () => ({ name: "usage" })],
  ["jobs", [], (_, query) => ({ name: "jobs", state: stateOf(query.get("state")), search: (query.get("q") ?? "").slice(0, MAX_SEARCH) })],
  ["jobs", [JOB], ([id]) => ({ name: "job", id })],
  ["shared", [JOB, LINK], ([id, link]) => ({ name: "shared", id, link })],
  ["groups", [GROUP], ([id]) => ({ name: "many", id })],
  ["examples", [], () => ({ name: "examples" })],
  ["examples", [EXAMPLE], ([example]) => ({ name: "create", from: null, example })],
  ["compare", [JOB, JOB], ([a, b]) => ({ name: "compare", ids: [a, b] })],
];

/** The view that an address means. @param {string} hash With or without its `#`. @returns {Route} */
export function parseRoute(hash) {
  const [path, query = ""] = hash.replace(/^#/, "").split("?", 2);
  const segments = path.split("/").filter(Boolean);
  const [first = "", ...rest] = segments;
  const found = ROUTES.find(([name, patterns]) => name === first && patterns.length === rest.length && patterns.every((pattern, i) => pattern.test(rest[i])));
  return found ? found[2](rest, new URLSearchParams(query)) : { name: "unknown", path: "/" + segments.join("/") };
}

/** @param {URLSearchParams} query @returns {Route} */
function createRoute(query) {
  const from = jobOf(query);
  return { name: "create", from, ...(from && query.has("result") ? { result: true } : {}) };
}

/** @param {URLSearchParams} query @returns {string | null} The job that a form begins with. */
function jobOf(query) {
  const id = query.get("from") ?? "";
  return JOB.test(id) ? id : null;
}

/** @param {string | null} value */
function stateOf(value) {
  return value !== null && Object.hasOwn(STATE_WORDS, value) ? value : null;
}

/** The address of a view, with its `#`. @param {Route} route */
export function routeHash(route) {
  switch (route.name) {
    case "create":
      return route.example ? `#/examples/${route.example}` : `#/${queryOf({ from: route.from, result: route.result })}`;
    case "surface":
    case "family":
      return `#/${route.name}${queryOf({ from: route.from, quick: route.name === "surface" && route.quick })}`;
    case "jobs":
      return `#/jobs${queryOf({ state: route.state, q: route.search })}`;
    case "job":
      return `#/jobs/${route.id}`;
    case "shared":
      return `#/shared/${route.id}/${route.link}`;
    case "many":
      return route.id ? `#/many/${route.id}` : "#/many";
    case "compare":
      return `#/compare/${route.ids.join("/")}`;
    case "unknown":
      return `#${route.path}`;
    default:
      return `#/${route.name}`;
  }
}

/** @param {Record<string, string | boolean | null | undefined>} values True is written as 1. */
function queryOf(values) {
  const used = Object.entries(values).flatMap(([name, value]) => (value ? [[name, value === true ? "1" : value]] : []));
  return used.length ? `?${new URLSearchParams(used)}` : "";
}

/**
 * Where `?job=ID`, which other programs can build more easily, leads; null where it says nothing.
 * @param {string} search The query of the page's own address.
 */
export function permalinkHash(search) {
  const id = new URLSearchParams(search).get("job") ?? "";
  return JOB.test(id) ? routeHash({ name: "job", id }) : null;
}
