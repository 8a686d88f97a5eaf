// @ts-check
/** The page: a frame around one view at a time. */
import { announce, mountAnnouncer, toast } from "./announce.js";
import { DEMO, rewind } from "./demo.js";
import { button, fill, h } from "./dom.js";
import { forgetDrafts } from "./drafts.js";
import { currentKey, currentLink, forgetKey, holdLink } from "./key.js";
import { handMany } from "./picking.js";
import { parseRoute, permalinkHash } from "./router.js";
import { Scope } from "./scope.js";

const main = /** @type {HTMLElement} */ (document.getElementById("main"));
const tools = /** @type {HTMLElement} */ (document.getElementById("tools"));
let scope = new Scope();
let first = true;
let turn = 0;
/** The link at the top that stands for a view, where it is not that to the jobs. */
const SECTIONS = /** @type {Record<string, string>} */ ({ create: "create", surface: "create", field: "create", family: "create", words: "create", many: "create", examples: "examples", shared: "shared", api: "api", usage: "api", unknown: "" });
const RELOAD_MS = 30_000;
const AGAIN_MS = 1000;
const SHOWN_WITHOUT_SERVER = new Set(["examples", "shared", "field"]);

/** @typedef {(root: HTMLElement, scope: Scope) => unknown} View Shows it. */

/** Load the modules of a view. @type {Record<string, (route: any) => Promise<View>>} */
const VIEWS = {
  async create(route) {
    if (DEMO) return import("./examples/view.js").then(({ ExampleView }) => (root, scope) => new ExampleView(root, scope, route.example));
    const [{ Workbench }, { exampleOrigin, resultOrigin }] = await Promise.all([import("./create/view.js"), import("./create/origins.js")]);
    const example = route.example ? exampleOrigin(route.example) : null;
    return (root, scope) => new Workbench(root, scope, { from: route.result ? resultOrigin(route.from) : (route.from ?? example) });
  },
  surface: ({ from, quick }) => import("./create/surface-view.js").then(({ SurfaceView }) => (root, scope) => new SurfaceView(root, scope, from, quick)),
  field: () => import("./own-field.js").then(({ OwnField }) => (root, scope) => new OwnField(root, scope)),
  family: ({ from }) => import("./family/view.js").then(({ FamilyView }) => (root, scope) => new FamilyView(root, scope, from)),
  many: ({ id }) => import("./many/view.js").then(({ ManyView }) => (root, scope) => new ManyView(root, scope, id ?? "")),
  words: () => import("./words/view.js").then(({ WordsView }) => (root, scope) => new WordsView(root, scope)),
  examples: () => import("./examples/view.js").then(({ showExamples }) => showExamples),
  compare: ({ ids: [before, after] }) => import("./job/view.js").then(({ openJob }) => (root, scope) => openJob(root, scope, after, before)),
  api: () => import("./api/view.js").then(({ showReference }) => showReference),
  usage: () => import("./api/view.js").then(({ showUsage }) => showUsage),
  jobs: ({ state, search }) => import("./jobs/list.js").then(({ ListView }) => (root, scope) => new ListView(root, scope, { state, search })),
  job: ({ id }) => import("./job/view.js").then(({ openJob }) => (root, scope) => openJob(root, scope, id)),
  shared: (route) => VIEWS.job(route),
  unknown: async ({ path }) => (root) => fill(root, h("h1", null, "Not found"), h("p", { class: "lead" }, `There is no page ${path}. `, h("a", { href: "#/" }, "Create something"))),
};

/**
 * Say that a view could not be loaded, and load the page again once the server answers: browsers keep a module that
 * failed, and what was typed is a draft. Not soon after another reload, or what is always missing would never rest.
 * @param {HTMLElement} root @param {Scope} scope
 */
async function showUnloaded(root, scope) {
  fill(root, h("h1", null, "The page could not be loaded"), h("p", { class: "lead", role: "status" }, "The server does not answer. Trying again… ", button("Reload", () => location.reload())));
  const [start] = /** @type {PerformanceNavigationTiming[]} */ (performance.getEntriesByType("navigation"));
  if (start?.type === "reload") await scope.sleep(RELOAD_MS - performance.now());
  while (await scope.sleep(AGAIN_MS)) {
    const answer = await fetch(new URL("web/app/main.js", document.baseURI), { cache: "no-store", signal: scope.signal }).catch(() => null);
    if (answer?.ok) return location.reload();
  }
}

async function show() {
  const wanted = parseRoute(location.hash);
  const route = DEMO && !SHOWN_WITHOUT_SERVER.has(wanted.name) && !("example" in wanted) ? /** @type {const} */ ({ name: "examples" }) : wanted;
  if (DEMO) rewind();
  turn += 1;
  const mine = turn;
  // What was there stays until the next view can be shown.
  const view = await VIEWS[route.name](route).catch(() => showUnloaded);
  if (mine !== turn) return;
  scope.dispose();
  scope = new Scope();
  holdLink(route.name === "shared" ? route.link : "");
  showTools();
  document.title = "Meshdeform";
  const root = h("div", { class: `view view-${route.name}` });
  fill(main, root);
  // Who came by a link has no other jobs here, and makes none.
  for (const nav of document.querySelectorAll("nav")) nav.hidden = route.name === "shared" && !DEMO;
  for (const link of document.querySelectorAll("nav a")) {
    const here = link.getAttribute("data-view") === (SECTIONS[route.name] ?? "jobs");
    if (here) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  view(root, scope);
  if (route.name === "create") handMany(scope);
  if (first) {
    first = false;
    return;
  }
  // As after a page load: at the top, and the keyboard at the new content.
  window.scrollTo(0, 0);
  main.focus({ preventScroll: true });
  announce({ create: "New job", surface: "New surface fit", field: "Open a field", family: "New family", words: "Your words", many: "Many files", api: "API", usage: "Usage", examples: "Examples", jobs: "Jobs", job: "Job", shared: "Shared job", compare: "Comparison", unknown: "Not found" }[route.name]);
}

function showTools() {
  fill(tools, currentKey() && !currentLink()
    ? button("Forget the API key", () => (forgetKey(), void forgetDrafts(), toast("API key and drafts removed from this browser")), { icon: "key", quiet: true, class: "button-quiet" })
    : null);
}

mountAnnouncer(document.body);
document.addEventListener("keychange", showTools);
window.addEventListener("hashchange", show);
// `#main` would be an address of a view.
document.getElementById("skip")?.addEventListener("click", (event) => {
  event.preventDefault();
  main.focus();
});
window.addEventListener("pagehide", (event) => !event.persisted && scope.dispose());
const permalink = permalinkHash(location.search);
if (permalink && !location.hash) history.replaceState(null, "", location.pathname + permalink);
show();
