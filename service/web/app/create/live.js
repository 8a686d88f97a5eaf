// @ts-check
/** What the asset becomes, while the prompt is typed: the shape in the view, and other designs of it below, of which a click takes one. */
import { announce } from "../announce.js";
import { isAbort, MeshdeformError } from "../client.js";
import { readPreview } from "../../client/index.js";
import { fill, h, say } from "../dom.js";
import { debounced } from "../scope.js";

/** @typedef {{seed: number, places: Map<string, Float32Array>, name: string}} Member */
/** @typedef {(form: "glb" | "positions", seeds: number[], signal: AbortSignal) => Promise<ArrayBuffer>} Ask */

const PAUSE_MS = 300;
const MEMBERS = 6;
const PICTURE = 168; // pixels, twice as many as are seen
const AGAIN_S = 5;

export class Live {
  /**
   * @param {import("../viewer-box.js").ViewerBox} box
   * @param {import("../scope.js").Scope} scope
   * @param {Ask} ask The server, about the form, at full strength.
   * @param {(seed: number) => void} take A design.
   * @param {() => void} reshaped What is shown has another shape.
   */
  constructor(box, scope, ask, take, reshaped) {
    this.box = box;
    this.ask = ask;
    this.take = take;
    this.reshaped = reshaped;
    /** What is asked for, without the seed and the strength; empty: nothing is. */
    this.goal = "";
    this.seed = 0;
    /** How far of the way, as the form has it. */
    this.strength = 1;
    /** What the members are of, and the first of their seeds. */
    this.of = "";
    /** @type {Member[]} */
    this.members = [];
    /** What the view leads to, as `_key` has it; empty: the asset alone. */
    this.shown = "";
    /** Whether this server makes previews. */
    this.able = true;
    this.asking = new AbortController();
    scope.add(() => this.asking.abort());
    this.scope = scope;
    this.show = debounced(() => this._show(), PAUSE_MS, scope);
    this.note = h("p", { class: "small muted", role: "status", hidden: true });
    this.strip = h("div", { class: "live-strip", role: "group", "aria-label": "Designs" });
    this.element = h("div", { class: "live", hidden: true }, this.strip, this.note);
  }

  /**
   * Say what the form asks for.
   * @param {string} goal Empty: nothing that could be seen before.
   * @param {number} seed
   * @param {number} strength From 0 to 1.
   */
  suit(goal, seed, strength) {
    const asked = goal !== this.goal || seed !== this.seed;
    if (!asked && strength === this.strength) return;
    this.goal = goal;
    this.seed = seed;
    this.strength = strength;
    this._press();
    if (!goal || !this.able) return this.clear();
    if (!asked) return this._blend();
    this.asking.abort();
    this.show();
  }

  /** Show the asset as it is. */
  clear() {
    this.asking.abort();
    this.of = "";
    this.members = [];
    fill(this.strip);
    this.element.hidden = true;
    say(this.note, "");
    if (this.shown) this.box.viewer?.clearDeformed();
    this._see("");
  }

  /** Show the share of the way, on straight lines: what breaks on them, the job mends. */
  _blend() {
    if (!this.shown) return;
    this.box.viewer?.setMorph(this.strength);
    say(this.box.tag, this._tag());
  }

  _tag() {
    return this.strength === 1 ? "Preview" : `Preview · ${Math.round(100 * this.strength)}%`;
  }

  /** What the form asks for. */
  _key() {
    return JSON.stringify([this.goal, this.seed]);
  }

  async _show() {
    const { goal, seed } = this;
    if (!goal) return;
    const asked = (this.asking = new AbortController());
    const { signal } = asked;
    this.element.hidden = false;
    this.element.setAttribute("aria-busy", "true");
    const slow = setTimeout(() => signal.aborted || say(this.note, "Making the shape…"), 700);
    try {
      await this._load(await this.ask("glb", [seed], signal), signal);
      if (signal.aborted) return;
      say(this.note, "");
      announce("The preview is shown");
      if (this.of !== goal || !this.members.some((member) => member.seed === seed)) await this._others(goal, seed, signal);
    } catch (error) {
      if (!signal.aborted && !isAbort(error)) this._failed(error);
    } finally {
      clearTimeout(slow);
      if (!signal.aborted) this.element.setAttribute("aria-busy", "false");
    }
  }

  /** @param {ArrayBuffer} glb @param {AbortSignal} signal */
  async _load(glb, signal) {
    const { viewer } = this.box;
    if (!viewer?.ready || signal.aborted) return;
    await viewer.setDeformed(glb, { keepCamera: true });
    if (signal.aborted) return;
    viewer.setMorph(this.strength);
    this._see(this._tag(), this._key());
  }

  /** Ask for designs with the seeds from one on, and picture each as it comes. @param {string} goal @param {number} first @param {AbortSignal} signal */
  async _others(goal, first, signal) {
    this.of = goal;
    this.members = [];
    fill(this.strip);
    for (let k = 0; k < MEMBERS; k++) {
      const { change, shapes } = readPreview(await this.ask("positions", [first + k], signal));
      // A change in plain words is the same with every seed.
      if (signal.aborted || change) return;
      const [{ seed, primitives, member }] = shapes;
      const places = new Map(primitives.map(({ mesh, primitive, positions }) => [`${mesh}/${primitive}`, positions]));
      await this._add({ seed, places, name: [member.pose, member.form].filter(Boolean).join(" ") });
    }
  }

  /** @param {Member} member */
  async _add(member) {
    this.members.push(member);
    const element = this._button(member, this.members.length);
    this.strip.append(element);
    this._press();
    const picture = await this.box.viewer?.pictureOf(member.places, { width: PICTURE, height: PICTURE }).catch(() => null);
    const image = element.querySelector("img");
    if (picture && image) image.src = this.scope.url(picture);
  }

  /** @param {Member} member @param {number} k */
  _button(member, k) {
    const label = `Design ${k}${member.name ? `: ${member.name}` : ""}`;
    return h("button", { type: "button", class: "live-member", "aria-pressed": "false", "aria-label": label, title: label, data: { seed: String(member.seed) }, on: { click: () => this._choose(member) } }, h("img", { alt: "", width: PICTURE / 2, height: PICTURE / 2 }));
  }

  /** @param {Member} member */
  _choose(member) {
    const { viewer } = this.box;
    // Its places are here already; its file, with the normals that the job gives it, comes after the pause.
    if (this.shown && viewer) {
      viewer.setShape(member.places);
      viewer.setMorph(this.strength);
      this.reshaped();
    }
    this.take(member.seed);
  }

  _press() {
    for (const each of this.strip.children) {
      const own = each instanceof HTMLElement && this.of === this.goal && Number(each.dataset.seed) === this.seed;
      each.setAttribute("aria-pressed", String(own));
    }
  }

  /** @param {string} tag What the view shows, if it is not the asset. @param {string} [key] */
  _see(tag, key = "") {
    this.shown = key;
    say(this.box.tag, tag);
    this.reshaped();
  }

  /** @param {unknown} error */
  _failed(error) {
    if (!(error instanceof MeshdeformError)) return say(this.note, "The view cannot show this file changed. The job changes it all the same.");
    if (error.code === "dependency_missing" || error.code === "not_found") this.able = false;
    // Of what is wrong with the form, its check says what.
    if (!this.able || error.status === 422) return this.clear();
    if (error.code !== "rate_limited") return say(this.note, error.message);
    say(this.note, "Waiting for its turn…");
    const { goal } = this;
    this.scope.sleep(1000 * (error.retryAfterS ?? AGAIN_S)).then((there) => there && goal === this.goal && this.show());
  }
}
