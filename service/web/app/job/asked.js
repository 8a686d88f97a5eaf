// @ts-check
/** What a job was asked to keep and to hold: in words, and over its first view. */
import { withoutPrompts } from "../create/control/further.js";
import { controlOf, controlWords, promptWords } from "../create/control/model.js";
import { h, panel } from "../dom.js";
import { counted } from "../format.js";
import { plainParams } from "../groups.js";
import { toggle } from "./stage-controls.js";

/** @param {any} job @returns {HTMLElement | null} null where nothing was asked */
export function askedPanel(job) {
  const words = [...guideWords(job), ...controlWords(controlOf(plainParams(job.params)))];
  if (!words.length) return null;
  return panel("asked-title", "Control", h("ul", { class: "asked" }, words.map((text) => h("li", null, text))));
}

/** @param {any} job @returns {string[]} what guides it besides its prompt */
function guideWords({ files = {}, ...job }) {
  const params = plainParams(job.params);
  const target = files.target ? [`Target: ${files.target.filename}`] : [];
  const pairs = params.landmarks?.length ? [counted(params.landmarks.length, "pair of points", "pairs of points")] : [];
  const pictures = (params.silhouettes ?? []).map((/** @type {any} */ view, /** @type {number} */ i) => `Picture: ${files[`silhouette_${i + 1}`]?.filename ?? i + 1}, from ${view.azimuth}°${view.elevation ? `, ${view.elevation}° up` : ""}`);
  return [...target, ...pairs, ...pictures, ...promptWords(params.prompts ?? [])];
}

/**
 * A button that shows over a view what is kept, and where handles lead; null where nothing was asked.
 * @param {any} job
 * @param {import("../viewer-box.js").ViewerBox} box Shows the asset.
 * @param {import("../scope.js").Scope} scope
 */
export function askedToggle(job, box, scope) {
  const params = plainParams(job.params);
  const control = controlOf(params);
  const { handles } = control;
  const regions = withoutPrompts(control.regions);
  if (!regions.length && !handles.length) return null;
  /** @type {import("../../viewer/control/overlay.js").Overlay | null} */
  let overlay = null;
  const show = async () => {
    const [{ Overlay }, { namedParts, numberedSurface }, { keptFaces, selectedFaces }] = await Promise.all([
      import("../../viewer/control/overlay.js"),
      import("../../viewer/control/surface.js"),
      import("../../viewer/control/selecting.js"),
    ]);
    const { viewer } = box;
    if (scope.over || overlay || !viewer?.root) return;
    const surface = numberedSurface(viewer.root, params.exclude ?? []);
    overlay = new Overlay(viewer.stage.scene);
    overlay.setSurface(surface);
    if (surface) {
      const named = namedParts(viewer.root, surface);
      // Where long edges were split first, the numbers are those of other triangles.
      const known = regions.map((region) => ({ action: region.action, flags: region.faces && job.output?.subdivide ? null : selectedFaces(region, surface, named) }));
      overlay.setKept(keptFaces(known, surface.count), surface.corners);
    }
    overlay.setMarks(null, handles.map(({ position, to }) => ({ position: /** @type {any} */ (position ?? null), to: /** @type {any} */ (to) })), -1);
    overlay.group.visible = button.getAttribute("aria-pressed") === "true";
    scope.add(() => overlay?.dispose());
    viewer.invalidate();
  };
  const button = toggle("Control", (on) => {
    if (overlay) overlay.group.visible = on;
    box.viewer?.invalidate();
  });
  button.setAttribute("aria-pressed", "true");
  button.title = "Tint what is kept, and show the handles";
  box.ready.then(() => {
    if (scope.over || !box.viewer) return void (button.hidden = true);
    box.viewer.addEventListener("ready", () => void show());
    if (box.viewer.ready) void show();
  });
  return button;
}
