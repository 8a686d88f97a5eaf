// @ts-check
/** Which side of the asset is its front: an arrow in the view, a slider, a search, and a way back to "automatic". */
import { announce } from "../announce.js";
import { isAbort, MeshdeformError } from "../client.js";
import { button, h, say } from "../dom.js";
import { slider } from "../job/stage-controls.js";
import { isFrontSure } from "./parts/reading.js";

const STEP = 5;

/**
 * The angle that a value of the parameter `orientation` means.
 * @param {string} value "auto", "keep", an angle in degrees, or empty
 * @returns {number | null} 0 to 359; null where the model decides
 */
export function angleOf(value) {
  if (value === "keep") return 0;
  const angle = Number(value);
  return value === "" || value === "auto" || !Number.isFinite(angle) ? null : ((angle % 360) + 360) % 360;
}

export class FrontControl {
  /**
   * @param {import("../viewer-box.js").ViewerBox} box
   * @param {(value: string) => void} onChange With a value for `orientation`; empty: as the quality says.
   * @param {(signal: AbortSignal) => Promise<{turn_deg: number, source: string}>} search Asks the server for the front
   *   of the asset as it is in the form.
   */
  constructor(box, onChange, search) {
    this.box = box;
    this.onChange = onChange;
    this.search = search;
    /** What the search said about the form as it is now. @type {number | null} */
    this.found = null;
    /** As the asset is read. @type {import("./parts/reading.js").Reading | null} */
    this.reading = null;
    /** Whether this server can search: that of a stack may have no torch. */
    this.able = true;
    /** Whether it is searched for: a fit takes the front that the asset is read with. */
    this.searched = true;
    this.searching = new AbortController();
    this.value = "";
    this.resolved = "auto";
    const { input, value, row } = slider("front-slider", "Front", 360 - STEP, () => this.choose(input.value));
    this.input = input;
    this.output = value;
    input.step = String(STEP);
    this.reset = button("Automatic", () => this.choose(""), { class: "chip chip-small" });
    this.find = button("Find", () => this._find(), { class: "chip chip-small", title: "Ask the model which side it would take" });
    this.note = h("p", { class: "small muted front-note", "aria-live": "polite", hidden: true });
    this.element = h("div", { class: "row front-control", hidden: true }, row, this.find, this.reset, this.note);
    row.hidden = false;
    box.ready.then(() => {
      box.viewer?.addEventListener("frontchange", (/** @type {CustomEvent<{degrees: number}>} */ event) => this.choose(String(event.detail.degrees)));
      this._draw();
    });
  }

  /** Offer the choice, or no more: a target mesh leaves no front to find. @param {boolean} on @param {boolean} searched Whether the search is offered too. */
  offer(on, searched = true) {
    this.element.hidden = !on;
    this.searched = searched;
    this._draw();
  }

  /** @param {string} value Of `orientation`, as it is in the form. */
  show(value) {
    this.value = value;
    this._draw();
  }

  /** @param {unknown} value Of `orientation`, as the server would take it where the form leaves it open. */
  resolve(value) {
    this.resolved = String(value ?? "keep");
    this._draw();
  }

  /** Show the front that the asset is read with, where nobody chose another. @param {import("./parts/reading.js").Reading | null} reading */
  read(reading) {
    this.reading = reading;
    this._draw();
  }

  /** Forget what the search said: the asset, the prompt or a setting is another. */
  forget() {
    this.searching.abort();
    this.found = null;
    this._say("");
    this._draw();
  }

  async _find() {
    this.forget();
    const asked = (this.searching = new AbortController());
    this._say("Looking at the asset from all sides…");
    this.find.disabled = true;
    try {
      const { turn_deg: turn, source } = await this.search(asked.signal);
      if (asked.signal.aborted) return;
      this.found = ((Math.round(turn) % 360) + 360) % 360;
      this._say(source === "found" ? "" : "No side is clearly the front. Check the arrow.");
      announce(`Front: the side at ${this.found} degrees`);
    } catch (error) {
      if (asked.signal.aborted || isAbort(error)) return;
      this.able = !(error instanceof MeshdeformError && error.code === "dependency_missing");
      const words = error instanceof Error ? error.message : String(error);
      this._say(this.able ? words : "Here the front is found only when the job starts. To decide it yourself, turn the arrow.");
    } finally {
      if (this.searching === asked) this.find.disabled = false;
      this._draw();
    }
  }

  /** @param {string} text */
  _say(text) {
    say(this.note, text);
  }

  /** @param {string} value */
  choose(value) {
    this.show(value);
    this.onChange(value);
  }

  _draw() {
    const chosen = angleOf(this.value || this.resolved);
    const angle = chosen ?? this.found;
    const words = angle === null ? "Automatic" : chosen === null ? `${angle}°, found` : `${angle}°`;
    this.input.value = String(angle ?? 0);
    this.output.textContent = words;
    this.input.setAttribute("aria-valuetext", angle === null ? "Automatic: found by what the asset is" : `${angle} degrees from +Z towards +X`);
    this.reset.hidden = this.value === "";
    this.find.hidden = chosen !== null || !this.able || !this.searched;
    const read = angleOf(this.value) === null && this.found === null ? (this.reading?.front_azimuth_deg ?? null) : null;
    this.box.viewer?.setFront(this.element.hidden ? null : (read ?? angle ?? 0), read === null ? angle === null : !(this.reading && isFrontSure(this.reading)));
  }
}
