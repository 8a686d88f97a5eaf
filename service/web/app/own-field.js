// @ts-check
/** A `.ndf` of the user's own, unfolded in the browser: nothing is sent. */
import { intro, kindsNav } from "./create/form.js";
import { DEMO } from "./demo.js";
import { button, fill, h, icon, say } from "./dom.js";
import { FieldStage } from "./job/field-stage.js";
import { fileInput, isField, takeDrops, takeHanded } from "./picking.js";
import { Scope } from "./scope.js";

export class OwnField {
  /** @param {HTMLElement} root @param {Scope} scope */
  constructor(root, scope) {
    this.stage = new Scope();
    scope.add(() => this.stage.dispose());
    this.place = h("div", null);
    this.refused = h("div", { class: "field-problem", role: "alert", hidden: true });
    const input = fileInput("field-file", "Field file", ".ndf", ([file]) => this._show(file));
    const element = h(
      "section",
      { class: "asset-panel", "aria-label": "Field" },
      h("div", { class: "drop-veil", "aria-hidden": "true" }, icon("upload"), h("strong", null, "Drop it here")),
      h("div", { class: "row" }, button("Choose a .ndf", () => input.click(), { icon: "upload" }), input, h("p", { class: "small muted" }, h("span", { class: "with-mouse" }, "Or drop one anywhere on this page. "), "It stays on this computer.")),
      this.refused,
      this.place,
    );
    fill(root, intro("Open", "a field", "The file of a surface fit, unfolded to any level: to look at, to measure on, and to save as a mesh."), DEMO ? null : kindsNav("surface"), element);
    takeDrops(scope, element, ([file]) => this._show(file));
    const file = takeHanded();
    if (file) this._show(file);
  }

  /** @param {File} file */
  _show(file) {
    say(this.refused, isField(file) ? "" : `${file.name} isn't supported. Use NDF.`);
    if (!isField(file)) return;
    this.stage.dispose();
    this.stage = new Scope();
    fill(this.place, h("h2", null, file.name), new FieldStage({ state: "succeeded" }, this.stage, file).element);
  }
}
