// @ts-check
/** A picture over the asset, which is turned until it fits: the direction is that of the view. */
import { h } from "../../dom.js";
import { announce } from "../../announce.js";
import { wrapped } from "./model.js";

const SIDES = [0, 90, 180, -90];

export class PictureView {
  /** @param {import("../asset-panel.js").AssetPanel} assets @param {import("../../scope.js").Scope} scope @param {import("./panel.js").GuidePanel} panel */
  constructor(assets, scope, panel) {
    this.assets = assets;
    this.scope = scope;
    this.panel = panel;
    /** The picture that is fitted; -1: none. */
    this.fitting = -1;
    /** The picture to fit as soon as there is a view to turn; -1: none. */
    this.waiting = -1;
    /** @type {WeakMap<object, string>} */
    this.urls = new WeakMap();
    this.image = h("img", { class: "picture-veil", alt: "", hidden: true });
    assets.stage.append(this.image);
    assets.box.ready.then(() => {
      assets.box.viewer?.addEventListener("camerachange", () => this._turned());
      assets.box.viewer?.addEventListener("ready", () => this._loaded());
    });
  }

  /** Whether there is a view to turn. */
  get possible() {
    return Boolean(this.assets.box.viewer?.ready);
  }

  /** @param {import("../../assets.js").Asset} file */
  url(file) {
    const known = this.urls.get(file) ?? this.scope.url(file.blob);
    this.urls.set(file, known);
    return known;
  }

  /** The direction that a picture has at first. @param {number} number */
  direction(number) {
    const taken = this.panel.guide.pictures.map(({ azimuth }) => azimuth);
    return { azimuth: SIDES.find((side) => !taken.includes(side)) ?? 45 * number, elevation: 0 };
  }

  /** Lay a picture over the asset, and look from its direction. @param {number} at */
  fit(at) {
    this.waiting = this.possible ? -1 : at;
    if (!this.possible) return;
    const { azimuth, elevation } = this.panel.guide.pictures[at];
    this.fitting = -1; // this movement is not the user's
    this.assets.box.look(azimuth, elevation);
    this.fitting = at;
    this.image.src = this.url(this.panel.images[at]);
    this.image.hidden = false;
    this.panel._show();
    announce("Turn the asset until it fits the picture");
  }

  end() {
    this.waiting = -1;
    if (this.fitting < 0) return;
    this.fitting = -1;
    this.image.hidden = true;
    this.panel._show();
  }

  /** The asset may come later than the picture. */
  _loaded() {
    if (this.panel.images[this.waiting]) this.fit(this.waiting);
    else this.panel._show();
  }

  _turned() {
    const view = this.panel.guide.pictures[this.fitting];
    const seen = view && this.assets.box.seenFrom();
    if (!seen) return;
    const [azimuth, elevation] = [Math.round(wrapped(seen.azimuth)), Math.round(seen.elevation)];
    if (azimuth === view.azimuth && elevation === view.elevation) return;
    Object.assign(view, { azimuth, elevation });
    this.panel.turned(this.fitting);
  }
}
