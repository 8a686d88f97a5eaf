// @ts-check
/** The animations of a file. */
import { AnimationMixer } from "../vendor/three/three.module.js";

const LONGEST_STEP_S = 0.1; // after a pause, an animation goes on where it was

export class Playback {
  /** @type {AnimationMixer | null} */ #mixer = null;
  #playing = false;
  #last = 0;

  /** @param {import("three").Object3D} root @param {import("three").AnimationClip[]} clips */
  constructor(root, clips) {
    this.root = root;
    this.clips = clips;
  }

  /** @returns {string[]} a name for each animation */
  get names() {
    return this.clips.map(({ name }, i) => name || `Animation ${i + 1}`);
  }

  /** Play an animation from its start instead of any other, or none. @param {number | null} index */
  play(index) {
    this.#mixer?.stopAllAction();
    const clip = index === null ? undefined : this.clips[index];
    this.#playing = clip !== undefined;
    if (!clip) return;
    this.#mixer ??= new AnimationMixer(this.root);
    this.#mixer.clipAction(clip).reset().play();
    this.#last = 0;
  }

  /**
   * Move what plays to a point in time.
   * @param {number} now in milliseconds
   * @returns {boolean} whether anything plays
   */
  advance(now) {
    if (!this.#playing) return false;
    this.#mixer?.update(this.#last ? Math.min((now - this.#last) / 1000, LONGEST_STEP_S) : 0);
    this.#last = now;
    return true;
  }
}
