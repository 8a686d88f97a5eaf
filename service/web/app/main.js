// @ts-check
/** The page: a frame around one view at a time. */
import { announce, mountAnnouncer, toast } from "./announce.js";
import { exampleOrigin, resultOrigin } from "./create/origins.js";
import { SurfaceView } from "./create/surface-view.js";
import { CreateView } from "./create/view.js";
import { CompareView } from "./compare/view.js";
import { button, fill, h } from "./dom.js";
import { forgetDrafts } from "./drafts.js";
import { ExampleView, showExamples } from "./examples/view.js";
import { FamilyView } from "./family/view.js";
import { JobView } from "./job/view.js";
import { ListView } from "./jobs/list.js";
import { currentKey, currentLink, forgetKey, holdLink } from "./key.js";
import { parseRoute, permalinkHash } from "./router.js";
import { Scope } from "./scope.js";
import { TeachView } from "./teach/view.js";
import { themeSwitch } from "./theme.js";

const main = /** @type {HTMLElement} */ (document.getElementById("main"));
const tools = /** @type {HTMLElement} */ (document.getElementById("tools"));
const theme = themeSwitch();
let scope = new Scope();
let first = true;
/** The link at the top that stands for a view, where it is not that to the jobs. */
const SECTIONS = /** @type {Record<string, string>} */ ({ create: "create", surface: "create", family: "create", examples: "examples", example: "examples", teach: "teach" });

function show() {
  const route = parseRoute(location.hash);
  scope.dispose();
  scope = new Scope();
  holdLink(route.name === "shared" ? route.link : "");
  showTools();
  document.title = "Meshdeform";
  const root = h("div", { class: `view view-${route.name}` });
  fill(main, root);
  // Who came by a link has no other jobs here, and makes none.
  for (const nav of document.querySelectorAll("nav")) nav.hidden = route.name === "shared";
  for (const link of document.querySelectorAll("nav a")) {
    const here = link.getAttribute("data-view") === (SECTIONS[route.name] ?? "jobs");
    if (here) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  if (route.name === "create") new CreateView(root, scope, route.from && route.result ? resultOrigin(route.from) : route.from ?? (route.example ? exampleOrigin(route.example) : null), route);
  else if (route.name === "surface") new SurfaceView(root, scope, route.from, route.quick);
  else if (route.name === "family") new FamilyView(root, scope, route.from);
  else if (route.name === "examples") showExamples(root, scope);
  else if (route.name === "compare") new CompareView(root, scope, route.ids);
  else if (route.name === "example") new ExampleView(root, scope, route.id);
  else if (route.name === "teach") new TeachView(root, scope);
  else if (route.name === "jobs") new ListView(root, scope, { state: route.state, search: route.search });
  else if (route.name === "group") new ListView(root, scope, { group: route.id });
  else if (route.name === "job") new JobView(root, scope, route.id);
  else if (route.name === "shared") new JobView(root, scope, route.id);
  else fill(root, h("h1", null, "Not found"), h("p", { class: "lead" }, `There is no page ${route.path}. `, h("a", { href: "#/" }, "Create something")));
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
