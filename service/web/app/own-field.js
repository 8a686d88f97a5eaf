// @ts-check
/** A `.ndf` of the user's own, unfolded in the browser: nothing is sent. */
import { exampleAsset } from "./assets.js";
import { intro, kindsNav } from "./create/form.js";
import { DEMO } from "./demo.js";
import { button, fill, h, icon, say } from "./dom.js";
import { FieldStage } from "./job/field-stage.js";
import { fileInput, isField, takeDrops, takeHanded } from "./picking.js";
import { Scope } from "./scope.js";

export class OwnField {
  /** @param {HTMLElement} root @param {Scope} scope */
  constructor(root, scope) {
    this.scope = scope;
    this.stage = new Scope();
    scope.add(() => this.stage.dispose());
    this.column = h("div", { class: "results" });
    this.refused = h("div", { class: "field-problem", role: "alert", hidden: true });
    const input = fileInput("field-file", "Field file", ".ndf", ([file]) => this._show(file));
    const element = h(
      "section",
      { class: "asset-panel", "aria-label": "Field" },
      h("div", { class: "drop-veil", "aria-hidden": "true" }, icon("upload"), h("strong", null, "Drop it here")),
      h("div", { class: "row" }, button("Choose a .ndf", () => input.click(), { icon: "upload" }), input, h("p", { class: "small muted" }, h("span", { class: "with-mouse" }, "Or drop one anywhere on this page. "), "It stays on this computer.")),
      this.refused,
      this.column,
    );
    fill(root, intro("Open", "a field", "The file of a surface fit, unfolded to any level: to look at, and to save as a mesh."), DEMO ? null : kindsNav("surface"), element);
    takeDrops(scope, element, ([file]) => this._show(file));
    const file = takeHanded();
    if (file) this._show(file);
    else void this._sample();
  }

  /** Nothing opens empty. */
  async _sample() {
    const asset = await exampleAsset("bumpy_torus.ndf", this.scope.signal).catch(() => null); // all works without it
    if (asset && !this.scope.over && !this.column.childElementCount) this._show(new File([asset.blob], asset.name), "A sample: a bumpy torus");
  }

  /** @param {File} file @param {string} [title] */
  _show(file, title = file.name) {
    say(this.refused, isField(file) ? "" : `${file.name} isn't supported. Use NDF.`);
    if (!isField(file)) return;
    this.stage.dispose();
    this.stage = new Scope();
    fill(this.column, h("h2", null, title), new FieldStage({ state: "succeeded" }, this.stage, file).element);
  }
}
