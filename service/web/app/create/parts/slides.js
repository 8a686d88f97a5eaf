// @ts-check
/** How each change moves the asset, learnt once: a slider then moves the mesh by itself, and the server makes the exact shape once it rests. */
import { readPreview } from "../../../client/index.js";
import { isAbort } from "../../client.js";
import { positionsOf } from "../live.js";
import { clause } from "./sentence.js";

/** @typedef {import("./sentence.js").Wanted} Wanted */

const LEARNT_AT = 40; // percent: far enough to be exact, and within what every part takes

export class Slides {
  /** @param {import("../../viewer-box.js").ViewerBox} box @param {(prompt: string, form: "glb" | "positions", signal: AbortSignal) => Promise<ArrayBuffer>} ask The server, about the asset. */
  constructor(box, ask) {
    this.box = box;
    this.ask = ask;
    /** By the change: offsets of the vertices, once they are here. @type {Map<string, Float32Array[] | null>} */
    this.offsets = new Map();
    this.learning = new AbortController();
  }

  /** Nothing that was learnt is of the asset that is shown now. */
  forget() {
    this.learning.abort();
    this.learning = new AbortController();
    this.offsets.clear();
  }

  /** Learn how a change moves the asset. @param {string} part @param {import("./sentence.js").Change} change */
  async learn(part, change) {
    const key = `${part} ${change.operation}`;
    if (this.offsets.has(key)) return;
    this.offsets.set(key, null);
    const { signal } = this.learning;
    const prompt = clause({ part, change, percent: LEARNT_AT });
    try {
      const { viewer } = this.box;
      if (!viewer?.ready) return void this.offsets.delete(key);
      // The first result has to come as a file, to lead to others from.
      if (!viewer.deformed) {
        const glb = await this.ask(prompt, "glb", signal);
        if (signal.aborted) return;
        if (!viewer.deformed) {
          await viewer.setDeformed(glb, { keepCamera: true });
          viewer.setMorph(0); // it leads there, and shows the asset
          return void this.offsets.set(key, viewer.offsets(null));
        }
      }
      const { shapes } = readPreview(await this.ask(prompt, "positions", signal));
      if (!signal.aborted && viewer.deformed && shapes[0]) this.offsets.set(key, viewer.offsets(positionsOf(shapes[0].primitives)));
    } catch (error) {
      this.offsets.delete(key);
      // The slider then moves the mesh when the server has answered.
      if (!isAbort(error)) console.info("The slider waits for the server:", error);
    }
  }

  /** Show what is wanted, if how all of it moves is known. @param {Wanted[]} wanted @returns {boolean} */
  show(wanted) {
    const { viewer } = this.box;
    if (!viewer?.deformed) return false;
    /** @type {[Float32Array[], number][]} */
    const shapes = [];
    for (const { part, change, percent } of wanted) {
      const offsets = this.offsets.get(`${part} ${change.operation}`);
      if (!offsets) return false;
      shapes.push([offsets, percent / LEARNT_AT]);
    }
    viewer.mix(shapes);
    viewer.setMorph(1);
    return true;
  }
}
