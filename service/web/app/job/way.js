// @ts-check
/**
 * The way from the source to the result, through shapes that the server makes: some that the view needs to bend along it,
 * and exactly the one at which the slider stops. Where the server makes none, straight lines remain.
 */
import { isAbort, MeshdeformError } from "../client.js";
import { currentLink } from "../key.js";

const ALONG = [50, 25, 75];
const BEYOND = [150, 125];
const BUSY = [429, 502, 503, 504];

export class Way {
  /**
   * @param {string} path of the result
   * @param {import("./shapes.js").ShapeCache} cache
   * @param {import("../viewer-box.js").ViewerBox} box
   * @param {() => void} onChange
   */
  constructor(path, cache, box, onChange) {
    this.path = path;
    this.cache = cache;
    this.box = box;
    this.onChange = onChange;
    this.on = !currentLink(); // the server makes shapes, but not for a link
    /** @type {Map<number, Promise<ArrayBuffer | null>>} Under way. */
    this.asked = new Map();
    /** @type {Set<number>} Shapes that the view has. */
    this.passed = new Set();
    this.along = false;
    this.beyond = false;
  }

  /** Load what the view needs on the way to a share, once. @param {number} share in percent */
  async open(share) {
    // First what is missing most.
    const wanted = [...(share > 100 && !this.beyond ? BEYOND : []), ...(this.along ? [] : ALONG)];
    this.along = true;
    this.beyond ||= share > 100;
    await Promise.resolve(); // where the slider has stopped, that shape is asked for first
    for (const each of wanted) {
      await Promise.all(this.asked.values()); // shapes that someone waits for come first
      await this.reach(each);
    }
  }

  /**
   * Have the exact shape at a share on the way.
   * @param {number} share in percent
   * @returns {Promise<ArrayBuffer | null>} its file; null where the server makes none
   */
  reach(share) {
    if (!this.on || share === 100) return Promise.resolve(null);
    const asked = this.asked.get(share) ?? this._reach(share).finally(() => this.asked.delete(share));
    this.asked.set(share, asked);
    return asked;
  }

  /** @param {number} share @returns {Promise<ArrayBuffer | null>} */
  async _reach(share) {
    try {
      const file = await this.cache.get(`${this.path}?strength=${share / 100}`);
      if (!this.passed.has(share)) await this.box.viewer?.addWaypoint(file.slice(0), share / 100);
      this.passed.add(share);
      this.onChange();
      return file;
    } catch (error) {
      if (!isAbort(error) && error instanceof MeshdeformError && !error.unanswered && !BUSY.includes(error.status)) {
        console.info("The way is straight:", error);
        this.on = false;
        this.onChange();
      }
      return null;
    }
  }
}
