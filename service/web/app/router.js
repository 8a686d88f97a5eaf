// @ts-check
/**
 * Addresses of the page's views. They live behind the `#`, so that the page is one file wherever it is served.
 *
 * @typedef {{name: "create", from: string | null, result?: boolean, example?: string, model?: string, prompt?: string}
 *   | {name: "surface", from: string | null, quick?: boolean}
 *   | {name: "family", from: string | null}
 *   | {name: "teach"}
 *   | {name: "jobs", state: string | null, search?: string}
 *   | {name: "job", id: string}
 *   | {name: "shared", id: string, link: string}
 *   | {name: "group", id: string}
 *   | {name: "examples"}
 *   | {name: "example", id: string}
 *   | {name: "compare", ids: [string, string]}
 *   | {name: "unknown", path: string}} Route
 */

export const STATES = ["queued", "running", "canceling", "succeeded", "failed", "canceled", "expired"];
/** As the API has it. */
export const MAX_SEARCH = 200;
const JOB_ID = /^job_[0-9a-z]{1,64}$/;
const EXAMPLE_ID = /^[a-z0-9-]{1,40}$/;
const TAUGHT = /^job:job_[0-9a-z]{1,64}$/;
const LINK = /^link\.[\w.-]{1,300}$/;
const GROUP_ID = /^[\w-]{1,64}$/;

/** The view that an address means. @param {string} hash With or without its `#`. @returns {Route} */
export function parseRoute(hash) {
  const [path, query = ""] = hash.replace(/^#/, "").split("?", 2);
  const parts = path.split("/").filter(Boolean);
  const params = new URLSearchParams(query);
  if (parts.length === 0) {
    const from = params.get("from");
    const example = params.get("example") ?? "";
    const model = params.get("model");
    const taught = model !== null && TAUGHT.test(model) ? { model, prompt: (params.get("prompt") ?? "").slice(0, MAX_SEARCH) } : null;
    const result = from !== null && params.has("result") ? { result: true } : {};
    return { name: "create", from: from !== null && JOB_ID.test(from) ? from : null, ...result, ...(EXAMPLE_ID.test(example) ? { example } : {}), ...taught };
  }
  if ((parts[0] === "surface" || parts[0] === "family") && parts.length === 1) {
    const from = params.get("from");
    const quick = parts[0] === "surface" && params.has("quick") ? { quick: true } : {};
    return { name: parts[0], from: from !== null && JOB_ID.test(from) ? from : null, ...quick };
  }
  if (parts[0] === "teach" && parts.length === 1) return { name: "teach" };
  if (parts[0] === "jobs" && parts.length === 1) {
    const state = params.get("state");
    return { name: "jobs", state: state !== null && STATES.includes(state) ? state : null, search: (params.get("q") ?? "").slice(0, MAX_SEARCH) };
  }
  if (parts[0] === "jobs" && parts.length === 2 && JOB_ID.test(parts[1])) {
    return { name: "job", id: parts[1] };
  }
  if (parts[0] === "shared" && parts.length === 3 && JOB_ID.test(parts[1]) && LINK.test(parts[2])) {
    return { name: "shared", id: parts[1], link: parts[2] };
  }
  if (parts[0] === "groups" && parts.length === 2 && GROUP_ID.test(parts[1])) {
    return { name: "group", id: parts[1] };
  }
  if (parts[0] === "examples" && parts.length === 1) return { name: "examples" };
  if (parts[0] === "examples" && parts.length === 2 && EXAMPLE_ID.test(parts[1])) return { name: "example", id: parts[1] };
  if (parts[0] === "compare" && parts.length === 3 && JOB_ID.test(parts[1]) && JOB_ID.test(parts[2])) {
    return { name: "compare", ids: [parts[1], parts[2]] };
  }
  return { name: "unknown", path: "/" + parts.join("/") };
}

/** The address of a view, with its `#`. @param {Route} route */
export function routeHash(route) {
  switch (route.name) {
    case "create":
      return `#/${queryOf({ from: route.from, result: route.result ? "1" : null, example: route.example, model: route.model, prompt: route.prompt })}`;
    case "surface":
      return `#/surface${queryOf({ from: route.from, quick: route.quick ? "1" : null })}`;
    case "family":
      return `#/family${queryOf({ from: route.from })}`;
    case "teach":
      return "#/teach";
    case "jobs":
      return `#/jobs${queryOf({ state: route.state, q: route.search })}`;
    case "job":
      return `#/jobs/${route.id}`;
    case "shared":
      return `#/shared/${route.id}/${route.link}`;
    case "group":
      return `#/groups/${route.id}`;
    case "examples":
      return "#/examples";
    case "example":
      return `#/examples/${route.id}`;
    case "compare":
      return `#/compare/${route.ids.join("/")}`;
    default:
      return `#${route.path}`;
  }
}

/** @param {Record<string, string | null | undefined>} values */
function queryOf(values) {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(values)) if (value) query.set(name, value);
  return query.size ? `?${query}` : "";
}

/**
 * Where `?job=ID`, which other programs can build more easily, leads; null where it says nothing.
 * @param {string} search The query of the page's own address.
 */
export function permalinkHash(search) {
  const id = new URLSearchParams(search).get("job");
  return id !== null && JOB_ID.test(id) ? routeHash({ name: "job", id }) : null;
}
