// @ts-check
/** The menu of a result's formats. What is not there yet is made when it is chosen; what a format cannot hold is said. */
import { arDevice, sceneViewer } from "../viewer/ar.js";
import { announce } from "./announce.js";
import { client } from "./client.js";
import { h, icon } from "./dom.js";
import { bytes } from "./format.js";
import { download, downloadMade } from "./job/files.js";
import { currentLink } from "./key.js";
import { artifactName } from "./names.js";
import { orToast } from "./problem-box.js";

/** @type {[string, string, string][]} The artifact, its name and what it is for. */
export const FORMATS = [
  ["result.glb", "GLB", "Web, game engines, Blender. Everything is kept"],
  ["result.usdz", "USDZ", "iPhone, iPad, Mac. Rig and one animation are kept"],
  ["result.obj.zip", "OBJ", "Any 3D program. With materials and textures"],
  ["result.3mf", "3MF", "3D printing in colour. Millimetres, Z up"],
  ["result.stl", "STL", "3D printing. The shape alone, in metres, Y up"],
  ["morph.glb", "Animated GLB", "From before to after"],
];

/**
 * A button that opens the list of formats.
 * @param {any} job A deformation that has succeeded.
 * @param {any[]} artifacts Those that it has.
 * @param {import("./scope.js").Scope} scope
 * @returns {HTMLDetailsElement}
 */
export function downloadMenu(job, artifacts, scope) {
  const sizes = new Map(artifacts.map(({ name, size }) => [name, size]));
  // Who came by a link reads what there is.
  const shown = FORMATS.filter(([name]) => sizes.has(name) || !currentLink());
  const rows = shown.map(([name, label, hint]) => row(label, sizes.has(name) ? `${hint} · ${bytes(sizes.get(name))}` : hint, () => save(job, name, sizes, scope)));
  if (arDevice() && !currentLink()) rows.unshift(row("View in your room", "Augmented reality", () => viewInRoom(job, sizes, scope)));
  const list = h("ul", { class: "download-list" }, rows);
  const menu = /** @type {HTMLDetailsElement} */ (h("details", { class: "download-menu" }, h("summary", { class: "button button-primary" }, icon("download"), "Download"), list));
  const close = (/** @type {boolean} */ back) => {
    menu.open = false;
    if (back) menu.querySelector("summary")?.focus();
  };
  menu.addEventListener("keydown", (event) => event.key === "Escape" && menu.open && (event.stopPropagation(), close(true)));
  menu.addEventListener("focusout", ({ relatedTarget }) => relatedTarget instanceof Node && !menu.contains(relatedTarget) && close(false));
  list.addEventListener("click", () => close(true));
  document.addEventListener("pointerdown", ({ target }) => target instanceof Node && !menu.contains(target) && close(false), { signal: scope.signal });
  return menu;
}

/** @param {string} label @param {string} hint @param {() => unknown} act */
function row(label, hint, act) {
  return h("li", null, h("button", { type: "button", class: "download-row", on: { click: act } }, h("strong", null, label), h("span", { class: "small muted" }, hint)));
}

/** @param {any} job @param {string} name @param {Map<string, number>} sizes @param {import("./scope.js").Scope} scope */
async function save(job, name, sizes, scope) {
  const size = sizes.get(name);
  if (size === undefined) return downloadMade(job, name, scope);
  return download(`v1/jobs/${job.id}/artifacts/${name}`, artifactName(job, name), size, true, scope);
}

/** Show the result in the room: the device's viewer loads it by an address that needs no key. @param {any} job @param {Map<string, number>} sizes @param {import("./scope.js").Scope} scope */
function viewInRoom(job, sizes, scope) {
  const ios = arDevice() === "ios";
  const path = `v1/jobs/${job.id}/artifacts/${ios ? "result.usdz" : "result.glb"}`;
  announce("Making the file for your room");
  return orToast("Not shown", async () => {
    if (ios && !sizes.has("result.usdz")) await client.json(path, { method: "POST", signal: scope.signal });
    const { url } = await client.json(`${path}/url`, { method: "POST", signal: scope.signal });
    const address = client.url(url);
    const link = h("a", { href: ios ? address : sceneViewer(address, job.prompt || "3D model"), rel: ios ? "ar" : null }, h("img", { alt: "" }));
    document.body.append(link);
    link.click();
    link.remove();
  });
}
