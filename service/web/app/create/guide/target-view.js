// @ts-check
/** The target beside the asset. */
import { Scope } from "../../scope.js";
import { ViewerBox } from "../../viewer-box.js";

export class TargetView {
  /** @param {import("../asset-panel.js").AssetPanel} assets @param {import("../../scope.js").Scope} scope */
  constructor(assets, scope) {
    this.assets = assets;
    /** @type {ViewerBox | null} */
    this.box = null;
    /** Of the view of one target. @type {Scope | null} */
    this.own = null;
    scope.add(() => this.own?.dispose());
  }

  /** @param {import("../../assets.js").Asset | null} target */
  async show(target) {
    this.own?.dispose();
    this.own = null;
    this.box?.element.remove();
    this.box = null;
    this.assets.stage.classList.toggle("with-target", target !== null);
    this.assets.box.tag.hidden = target === null;
    if (!target) return;
    const own = (this.own = new Scope());
    this.box = new ViewerBox("Target", own);
    this.assets.besides(this.box);
    await this.box.load(await target.bytes(), target.format);
  }
}
