// @ts-check
/**
 * What was recorded of an example for the page without a server (docs/generation/demo.py): other designs of its result,
 * and each part of its asset changed. A slider leads there on straight lines.
 *
 * @typedef {{positions: string} | {glb: string}} Shape In base64: as a preview answers, or a GLB where the rig changes, too.
 * @typedef {{name: string, more: string, faces: (number | number[])[], shape: Shape}} Part
 * @typedef {{members: string, parts: Part[]}} Recorded `members`: as a preview answers, in base64; empty: there are none.
 */
import { readPreview } from "../../client/index.js";
import { bytesOf } from "../assets.js";
import { PICTURE, positionsOf } from "../create/live.js";
import { h } from "../dom.js";
import { titled } from "../format.js";

/** @param {string} preview In base64. @returns {{seed: number, positions: Map<string, Float32Array>}[]} */
function shapesOf(preview) {
  return readPreview(bytesOf(preview).buffer).shapes.map(({ seed, primitives }) => ({ seed, positions: positionsOf(primitives) }));
}

export class Moves {
  /**
   * @param {Recorded} recorded
   * @param {import("../viewer-box.js").ViewerBox} box That shows the result.
   * @param {{seed: number, bytes: ArrayBuffer}} result Its seed, and its file.
   * @param {import("../scope.js").Scope} scope
   * @param {(label: string) => void} shown Another shape is shown: what it is, as the slider has it.
   */
  constructor(recorded, box, result, scope, shown) {
    this.box = box;
    this.result = result;
    this.shown = shown;
    this.turn = 0;
    /** @type {HTMLButtonElement[]} */
    this.buttons = [];
    /** @type {{overlay: any, number: (root: any) => any} | null} */
    this.light = null;
    /** @type {Part | null} */
    this.part = null;
    const all = recorded.members ? shapesOf(recorded.members) : [];
    const members = all.map((member, k) => this._button(`Design ${k + 1}`, "live-member", () => this._see(null, member.seed === result.seed ? { glb: "" } : { positions: member.positions }, ""), h("img", { alt: "", width: PICTURE / 2, height: PICTURE / 2 })));
    const parts = recorded.parts.map((part) => this._button(titled(part.name), "chip chip-small", () => this._see(part, part.shape, `${titled(part.name)} ${part.more}`)));
    const whole = all.length ? null : this._button("Result", "chip chip-small", () => this._see(null, { glb: "" }, ""));
    this.element = h(
      "div",
      { class: "moves" },
      members.length ? h("div", { class: "live-strip", role: "group", "aria-label": "Designs" }, members) : null,
      h("div", { class: "chips", role: "group", "aria-label": "Parts" }, whole, parts),
    );
    this._press(members[all.findIndex(({ seed }) => seed === result.seed)] ?? whole);
    this.drawn = this._draw(all, members, scope);
    scope.add(() => this.light?.overlay.dispose());
  }

  /** @param {string} label @param {string} style @param {() => Promise<void>} act @param {...Node} inside */
  _button(label, style, act, ...inside) {
    const button = h("button", { type: "button", class: style, "aria-pressed": "false", "aria-label": label, title: inside.length ? label : null, on: { click: () => (this._press(button), act()) } }, ...(inside.length ? inside : [label]));
    this.buttons.push(button);
    return button;
  }

  /** @param {HTMLElement | null} chosen */
  _press(chosen) {
    for (const button of this.buttons) button.setAttribute("aria-pressed", String(button === chosen));
  }

  /** @param {{positions: Map<string, Float32Array>}[]} shapes @param {HTMLElement[]} buttons @param {import("../scope.js").Scope} scope */
  async _draw(shapes, buttons, scope) {
    for (const [k, { positions }] of shapes.entries()) {
      const picture = await this.box.viewer?.pictureOf(positions, { width: PICTURE, height: PICTURE }).catch(() => null);
      if (scope.over) return;
      const image = buttons[k].querySelector("img");
      if (picture && image) image.src = scope.url(picture);
    }
  }

  /** @param {Part | null} part @param {{positions: Map<string, Float32Array> | string} | Shape} shape @param {string} label */
  async _see(part, shape, label) {
    const turn = ++this.turn;
    await this.drawn;
    const { viewer } = this.box;
    if (!viewer || turn !== this.turn) return;
    if ("glb" in shape) await viewer.setDeformed(shape.glb ? bytesOf(shape.glb).buffer : this.result.bytes.slice(0), { keepCamera: true });
    else viewer.setShape(typeof shape.positions === "string" ? shapesOf(shape.positions)[0].positions : shape.positions);
    if (turn !== this.turn) return;
    this.part = part;
    await this._light();
    this.shown(label);
  }

  /** Light the part that is changed, where it is seen now. */
  async _light() {
    const { viewer } = this.box;
    if (!this.part && !this.light) return;
    if (!this.light) {
      const [{ Overlay }, { numberedSurface }] = await Promise.all([import("../../viewer/control/overlay.js"), import("../../viewer/control/surface.js")]);
      this.light = { overlay: new Overlay(viewer.stage.scene), number: numberedSurface };
    }
    this.follow();
  }

  /** The strength is another. */
  follow() {
    const { viewer } = this.box;
    if (!this.light || !viewer?.root) return;
    const surface = viewer.atRest(() => this.light?.number(viewer.root));
    this.light.overlay.setSurface(surface);
    if (!surface) return;
    const flags = new Uint8Array(surface.corners.length / 3);
    for (const item of this.part?.faces ?? []) {
      const [first, last] = typeof item === "number" ? [item, item] : item;
      flags.fill(1, first, last + 1);
    }
    this.light.overlay.setPart(flags, surface.corners);
    viewer.invalidate();
  }
}
