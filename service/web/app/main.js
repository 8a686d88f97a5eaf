// @ts-check
/** The page: a frame around one view at a time. */
import { announce, mountAnnouncer, toast } from "./announce.js";
import { DEMO, rewind } from "./demo.js";
import { button, fill, h } from "./dom.js";
import { forgetDrafts } from "./drafts.js";
import { currentKey, currentLink, forgetKey, holdLink } from "./key.js";
import { parseRoute, permalinkHash } from "./router.js";
import { Scope } from "./scope.js";
import { themeSwitch } from "./theme.js";

const main = /** @type {HTMLElement} */ (document.getElementById("main"));
const tools = /** @type {HTMLElement} */ (document.getElementById("tools"));
const theme = themeSwitch();
let scope = new Scope();
let first = true;
let turn = 0;
/** The link at the top that stands for a view, where it is not that to the jobs. */
const SECTIONS = /** @type {Record<string, string>} */ ({ create: "create", surface: "create", family: "create", examples: "examples", example: "examples", teach: "teach", shared: "shared" });
const SHOWN_WITHOUT_SERVER = new Set(["examples", "example", "shared"]);

/**
 * Load the modules of a view.
 * @param {import("./router.js").Route} route
 * @returns {Promise<(root: HTMLElement, scope: Scope) => unknown>} Shows it.
 */
async function viewOf(route) {
  if (route.name === "create") {
    const [{ CreateView }, { exampleOrigin, resultOrigin }] = await Promise.all([import("./create/view.js"), import("./create/origins.js")]);
    const example = route.example ? exampleOrigin(route.example) : null;
    return (root, scope) => new CreateView(root, scope, route.from && route.result ? resultOrigin(route.from) : (route.from ?? example), route);
  }
  if (route.name === "surface") {
    const { SurfaceView } = await import("./create/surface-view.js");
    return (root, scope) => new SurfaceView(root, scope, route.from, route.quick);
  }
  if (route.name === "family") {
    const { FamilyView } = await import("./family/view.js");
    return (root, scope) => new FamilyView(root, scope, route.from);
  }
  if (route.name === "examples" || route.name === "example") {
    const { ExampleView, showExamples } = await import("./examples/view.js");
    return (root, scope) => (route.name === "example" ? new ExampleView(root, scope, route.id) : showExamples(root, scope));
  }
  if (route.name === "compare") {
    const { CompareView } = await import("./compare/view.js");
    return (root, scope) => new CompareView(root, scope, route.ids);
  }
  if (route.name === "teach") {
    const { TeachView } = await import("./teach/view.js");
    return (root, scope) => new TeachView(root, scope);
  }
  if (route.name === "jobs" || route.name === "group") {
    const { ListView } = await import("./jobs/list.js");
    return (root, scope) => new ListView(root, scope, route.name === "group" ? { group: route.id } : { state: route.state, search: route.search });
  }
  if (route.name === "job" || route.name === "shared") {
    const { JobView } = await import("./job/view.js");
    return (root, scope) => new JobView(root, scope, route.id);
  }
  return (root) => fill(root, h("h1", null, "Not found"), h("p", { class: "lead" }, `There is no page ${route.path}. `, h("a", { href: "#/" }, "Create something")));
}

/** @param {HTMLElement} root */
function showUnloaded(root) {
  fill(root, h("h1", null, "The page could not be loaded"), h("p", { class: "lead" }, "Check the connection. ", button("Reload", () => location.reload())));
}

async function show() {
  const wanted = parseRoute(location.hash);
  const route = DEMO && !SHOWN_WITHOUT_SERVER.has(wanted.name) ? /** @type {const} */ ({ name: "examples" }) : wanted;
  if (DEMO) rewind();
  turn += 1;
  const mine = turn;
  // What was there stays until the next view can be shown.
  const view = await viewOf(route).catch(() => showUnloaded);
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
  if (first) {
    first = false;
    return;
  }
  // As after a page load: at the top, and the keyboard at the new content.
  window.scrollTo(0, 0);
  main.focus({ preventScroll: true });
  announce({ create: "New job", surface: "New surface fit", family: "New family", examples: "Examples", example: "Example", teach: "Teach a word", jobs: "Jobs", group: "Variations", job: "Job", shared: "Shared job", compare: "Comparison", unknown: "Not found" }[route.name]);
}

function showTools() {
  const key = currentKey() && !currentLink()
    ? button("Forget the API key", () => (forgetKey(), void forgetDrafts(), toast("API key and drafts removed from this browser")), { icon: "key", quiet: true, class: "button-quiet" })
    : null;
  fill(tools, key, theme);
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
