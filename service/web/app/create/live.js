// @ts-check
/** What the asset becomes, while the words change: the shape in the view, and other designs of it, of which a click takes one. */
import { announce } from "../announce.js";
import { isAbort, MeshdeformError } from "../client.js";
import { readPreview } from "../../client/index.js";
import { fill, h, icon, say } from "../dom.js";
import { plainWords } from "../plain.js";
import { debounced } from "../scope.js";

/** @typedef {{seed: number, positions: Map<string, Float32Array>, name: string}} Member */
/**
 * @typedef {object} Shape One that the asset has.
 * @property {string} key What was asked for, as `shapeKey` has it; of others than the form's, a name of its own.
 * @property {string} label
 * @property {() => Promise<ArrayBuffer>} load Returns it as a GLB.
 * @property {number} strength Share of the way at which it is loaded.
 * @property {string} tag What the view says of it.
 * @property {string[]} [warnings] What was read otherwise, or made less of, in sentences.
 * @property {any} [wish] What the form held.
 * @property {{path: string, name: string, step: number | null}} [stored] Where a job has it. `name`: for downloaded files; empty: its result. `step`: from which another job may start.
 * @property {string} [href] The page of the job whose result it is.
 * @property {Blob} [picture]
 */
/**
 * @typedef {object} Asked What the form asks for.
 * @property {string} goal Without the seed and the strength; empty: there is nothing to show.
 * @property {number} seed
 * @property {number} strength From 0.
 * @property {boolean} possible Whether it can be seen before a job runs.
 */

const PAUSE_MS = 300;
const MEMBERS = 6;
export const PICTURE = 168; // pixels, twice as many as are seen
const AGAIN_S = 5;
const AGAIN_MS = 3000;
const KNOWN = 12;
const LARGE = 20_000; // triangles, above which the exact shape may take minutes

/** @param {string} goal @param {number} seed */
export function shapeKey(goal, seed) {
  return JSON.stringify([goal, seed]);
}

export class Live {
  /**
   * @param {import("../viewer-box.js").ViewerBox} box
   * @param {import("../scope.js").Scope} scope
   * @param {object} does
   * @param {(form: "glb" | "positions", seed: number, signal: AbortSignal, draft: boolean) => Promise<{data: ArrayBuffer, draft?: boolean}>} does.ask The server, about the form, at full strength. `draft`: whether a draft will do, and whether it is one.
   * @param {(seed: number) => void} does.take A design.
   * @param {() => void} does.reshaped What is shown has another shape.
   * @param {(shape: Shape | null) => void} does.shown A shape is shown as it is; null: the asset alone.
   * @param {() => string} does.label Words for what the form asks for.
   */
  constructor(box, scope, does) {
    this.box = box;
    this.scope = scope;
    this.does = does;
    /** @type {Asked} */
    this.asked = { goal: "", seed: 0, strength: 1, possible: false };
    /** What the members are of. */
    this.of = "";
    /** @type {Member[]} */
    this.members = [];
    /** What the shapes of that goal lack, by their seeds. @type {Map<number, string[]>} */
    this.warnings = new Map();
    /** Shapes that can be shown at once, by their keys, the newest last. @type {Map<string, Shape>} */
    this.known = new Map();
    /** What the view leads to; null: the asset alone. @type {Shape | null} */
    this.shape = null;
    /** Whether there is a way from the asset to it. */
    this.morphs = true;
    /** Whether this server makes previews. */
    this.able = true;
    this.asking = new AbortController();
    scope.add(() => this.asking.abort());
    /** Ends with the first shape under way, which is shown before it gives way to what is typed next. @type {Promise<void> | null} */
    this.first = null;
    this.turns = 0;
    this.show = debounced(() => this._ask(), PAUSE_MS, scope);
    this.note = h("p", { class: "small muted", role: "status", hidden: true });
    this.lacks = h("div", { class: "outlook", "aria-live": "polite", hidden: true });
    this.strip = h("div", { class: "live-strip", role: "group", "aria-label": "Designs" });
    this.element = h("div", { class: "live", hidden: true }, this.strip, this.note);
  }

  /** @param {Asked} asked */
  suit(asked) {
    const { goal, seed, strength, possible } = this.asked;
    const same = asked.goal === goal && asked.seed === seed && asked.possible === possible;
    if (same && asked.strength === strength) return;
    this.asked = asked;
    this._press();
    if (same) return this._blend();
    if (!this.first) this.asking.abort();
    const known = this.known.get(this.key);
    if (known && asked.goal) return void this.look(known);
    if (!asked.goal || !asked.possible || !this.able) return this.clear();
    this.show();
  }

  /** What the form asks for. */
  get key() {
    return shapeKey(this.asked.goal, this.asked.seed);
  }

  /** Whether the view shows what the form asks for. */
  get settled() {
    return this.shape?.key === this.key;
  }

  /** Learn of a shape; what the form asks for is shown at once. @param {Shape} shape */
  know(shape) {
    this.known.delete(shape.key);
    this.known.set(shape.key, shape);
    for (const key of this.known.keys()) if (this.known.size > KNOWN && key !== this.key) this.known.delete(key);
    if (shape.key === this.key && this.asked.goal) void this.look(shape);
  }

  /** Show a shape, whatever the form asks for. Until it is there, the asset must not pass for it. @param {Shape} shape */
  async look(shape) {
    this.asking.abort();
    const { signal } = (this.asking = new AbortController());
    if (this.of !== this.asked.goal) this.element.hidden = true;
    say(this.note, "");
    this.element.setAttribute("aria-busy", "false");
    const first = this.shape === null && shape.stored !== undefined;
    if (first) this.box.say("Loading the shape…", "", "", true);
    while (!signal.aborted) {
      try {
        await this._put(shape, await shape.load(), signal);
        return;
      } catch (error) {
        if (signal.aborted || isAbort(error)) return;
        // A step gives way to newer ones, which come by themselves.
        if (!shape.stored || (error instanceof MeshdeformError && error.status === 404)) return this._failed(error);
        console.warn(error);
        if (!this.shape) this.box.say("This shape could not be loaded", "Trying again…", "warn", true);
        if (!(await this.scope.sleep(AGAIN_MS))) return;
      }
    }
  }

  /** Show the asset as it is. */
  clear() {
    this.asking.abort();
    this.of = "";
    this.members = [];
    fill(this.strip);
    this.element.hidden = true;
    say(this.note, "");
    if (this.box.note.classList.contains("viewer-cover")) this.box.say("");
    if (!this.shape) return;
    this.box.viewer?.clearDeformed();
    this._see(null);
  }

  /** Show the share of the way, on straight lines: what breaks on them, the job mends. */
  _blend() {
    if (!this.shape) return;
    this.box.viewer?.setMorph(this.share);
    say(this.box.tag, this._tag(this.shape));
  }

  /** How far the view goes towards its shape. */
  get share() {
    return this.asked.strength / (this.shape?.strength || 1);
  }

  /** @param {Shape} shape */
  _tag({ tag, strength }) {
    return this.asked.strength === strength ? tag : `${tag} · ${Math.round(100 * this.asked.strength)}%`;
  }

  async _ask() {
    const turn = ++this.turns;
    await this.first;
    const { goal, seed, possible } = this.asked;
    if (turn !== this.turns || !goal || !possible) return;
    this.asking.abort();
    const { signal } = (this.asking = new AbortController());
    this.element.hidden = false;
    this.element.setAttribute("aria-busy", "true");
    const slow = setTimeout(() => signal.aborted || say(this.note, "Making the shape…"), 700);
    try {
      const isDraft = await this._first(this._make(goal, seed, signal, true));
      if (signal.aborted || this.key !== shapeKey(goal, seed)) return;
      clearTimeout(slow);
      say(this.note, isDraft ? "A draft; the exact shape follows." : "");
      announce("The preview is shown");
      const last = this.box.triangles > LARGE;
      if (isDraft && !last) await this._make(goal, seed, signal, false);
      if (signal.aborted) return;
      if (!last) say(this.note, "");
      if (this.of !== goal || !this.members.some((member) => member.seed === seed)) await this._others(goal, seed, signal);
      if (isDraft && last && !signal.aborted) await this._make(goal, seed, signal, false);
      if (!signal.aborted) say(this.note, "");
    } catch (error) {
      if (!signal.aborted && !isAbort(error) && this.key === shapeKey(goal, seed)) this._failed(error);
    } finally {
      clearTimeout(slow);
      if (!signal.aborted) this.element.setAttribute("aria-busy", "false");
    }
  }

  /** Let the first shape of a goal come, whatever is typed meanwhile. @param {Promise<boolean>} making */
  _first(making) {
    const over = making.then(() => {}, () => {}).then(() => {
      if (this.first === over) this.first = null;
    });
    this.first = over;
    return making;
  }

  /** Show what the server makes of a goal. @param {string} goal @param {number} seed @param {AbortSignal} signal @param {boolean} fast Whether a draft will do. @returns {Promise<boolean>} whether it is one */
  async _make(goal, seed, signal, fast) {
    const label = this.does.label();
    const { data, draft = false } = await this.does.ask("glb", seed, signal, fast);
    const shape = { key: shapeKey(goal, seed), label, load: async () => data, strength: 1, tag: draft ? "Draft" : "Preview", warnings: this.of === goal ? this.warnings.get(seed) : [] };
    await this._put(shape, data, signal, draft || this.key !== shape.key);
    return draft;
  }

  /** @param {Shape} shape @param {ArrayBuffer} glb @param {AbortSignal} signal @param {boolean} [passing] Whether another one takes its place at once. */
  async _put(shape, glb, signal, passing = false) {
    await this.box.ready;
    const { viewer } = this.box;
    if (!viewer?.ready || signal.aborted) return;
    // Where the vertices do not fit, the file is shown by itself.
    this.morphs = await this.box.deform(glb.slice(0));
    if (signal.aborted) return;
    this.box.say("");
    this._see(shape);
    this._blend();
    if (passing) return;
    this.known.set(shape.key, shape);
    if (!shape.picture) shape.picture = await viewer.snapshot({ width: PICTURE, height: PICTURE }).catch(() => undefined);
    if (!signal.aborted) this.does.shown(shape);
  }

  /** Ask for designs with the seeds from one on, and picture each as it comes. @param {string} goal @param {number} first @param {AbortSignal} signal */
  async _others(goal, first, signal) {
    this.of = goal;
    this.members = [];
    this.warnings.clear();
    fill(this.strip);
    for (let k = 0; k < MEMBERS; k++) {
      const { change, shapes } = readPreview((await this.does.ask("positions", first + k, signal, true)).data);
      if (signal.aborted) return;
      const [{ seed, primitives, member, warnings }] = shapes;
      this.warnings.set(seed, warnings);
      if (this.shape?.key === shapeKey(goal, seed)) this._warn(Object.assign(this.shape, { warnings }));
      // A change in plain words is the same with every seed.
      if (change) return;
      await this._add({ seed, positions: positionsOf(primitives), name: [member.pose, member.form].filter(Boolean).join(" ") });
    }
  }

  /** @param {Member} member */
  async _add(member) {
    this.members.push(member);
    const element = this._button(member, this.members.length);
    this.strip.append(element);
    this._press();
    const picture = await this.box.viewer?.pictureOf(member.positions, { width: PICTURE, height: PICTURE }).catch(() => null);
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
    // Its positions are here already; its file, with the normals that the job gives it, comes after the pause.
    if (this.shape && viewer) {
      viewer.setShape(member.positions);
      viewer.setMorph(this.asked.strength);
      this.does.reshaped();
    }
    this.does.take(member.seed);
  }

  _press() {
    for (const each of this.strip.children) {
      const own = each instanceof HTMLElement && this.of === this.asked.goal && Number(each.dataset.seed) === this.asked.seed;
      each.setAttribute("aria-pressed", String(own));
    }
  }

  /** @param {Shape | null} shape That the view leads to. */
  _see(shape) {
    this.shape = shape;
    say(this.box.tag, shape ? this._tag(shape) : "");
    this._warn(shape);
    this.does.reshaped();
    if (!shape) this.does.shown(null);
  }

  /** Say what the shape in the view lacks. @param {Shape | null} shape */
  _warn(shape) {
    const words = plainWords((shape?.warnings ?? []).join(" "));
    this.lacks.hidden = !words;
    fill(this.lacks, words ? h("p", null, icon("warn"), h("span", null, words)) : null);
  }

  /** @param {unknown} error */
  _failed(error) {
    this.element.hidden = false;
    if (!(error instanceof MeshdeformError)) return say(this.note, "The view cannot show this file changed. The job changes it all the same.");
    if (error.code === "dependency_missing" || error.code === "not_found") this.able = false;
    // Of what is wrong with the form, its check says what.
    if (!this.able || [404, 422].includes(error.status)) {
      this.clear();
      if (!this.able) this.does.shown(null); // a job is run from now on, not kept, also where no shape was shown
      return;
    }
    if (error.code !== "rate_limited") return say(this.note, plainWords(error.message) || error.title);
    say(this.note, "Waiting for its turn…");
    const { goal } = this.asked;
    this.scope.sleep(1000 * (error.retryAfterS ?? AGAIN_S)).then((there) => there && goal === this.asked.goal && this.show());
  }
}

/** The positions of a shape as a viewer takes them. @param {{mesh: number, primitive: number, positions: Float32Array}[]} primitives @returns {Map<string, Float32Array>} */
export function positionsOf(primitives) {
  return new Map(primitives.map(({ mesh, primitive, positions }) => [`${mesh}/${primitive}`, positions]));
}
