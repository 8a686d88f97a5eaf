// @ts-check
/** One file of many, large: before and after beside each other, turned and played in step. */
import { openDialog } from "../dialogs.js";
import { button, h } from "../dom.js";
import { Scope } from "../scope.js";
import { linkViews, movingTools, ViewerBox } from "../viewer-box.js";

/** @param {string} name @param {import("../assets.js").Asset} asset @param {Blob | null} result @param {Scope} scope Of the view that goes with it. */
export function lookCloser(name, asset, result, scope) {
  const own = new Scope();
  scope.add(() => own.dispose());
  const views = ["Before", "After"].slice(0, result ? 2 : 1).map((tag) => new ViewerBox(tag, own));
  const stem = name.replace(/^.*\//, "").replace(/\.[^.]*$/, "");
  const moving = movingTools(own, views, (ending) => `${stem}-turntable.${ending}`);
  const close = button("Close", () => dialog.close(), { class: "button-primary" });
  const stage = h("div", { class: result ? "stage many-stage" : "stage many-stage many-alone" }, views.map(({ element }) => element));
  const dialog = openDialog(name, [stage, moving, h("div", { class: "dialog-actions" }, close)], own, "many-dialog");
  dialog.addEventListener("close", () => own.dispose());
  void show(views, asset, result, own);
}

/** @param {ViewerBox[]} views @param {import("../assets.js").Asset} asset @param {Blob | null} result @param {Scope} scope */
async function show([before, after], asset, result, scope) {
  const source = await asset.bytes();
  if (scope.over) return;
  await before.load(source.slice(0), asset.format || "gltf");
  if (!after || !result) return;
  await linkViews(before, after);
  // A result of other triangles is shown by itself.
  if (await after.load(source, asset.format || "gltf")) if (await after.deform(await result.arrayBuffer())) after.viewer?.setMorph(1);
}
