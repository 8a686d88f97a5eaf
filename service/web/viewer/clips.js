// @ts-check
/**
 * What moves below a view: its clips, played in step with those of the views beside it, and a turntable to save.
 *
 *     const { dispose } = mountClips(host, [before, after], { save: (file, ending) => saveBytes(file, `chair.${ending}`) });
 *
 * From the keyboard, also while a view has the focus: space plays and pauses, comma and full stop go back and on by a
 * frame. Nothing starts by itself.
 */
import { ClipPlayer } from "./player.js";
import { movingKinds } from "./turntable.js";

/** @typedef {import("./viewer.js").MeshViewer} MeshViewer */
/** @typedef {import("./turntable.js").Moving} Moving */

const NO_VIDEO = "This browser records no video.";

/**
 * @param {HTMLElement} host gets the buttons
 * @param {MeshViewer[]} viewers of which the last is what a turntable shows
 * @param {{ save?: (file: Blob, ending: Moving) => void, failed?: (error: unknown) => void }} [options] without `save` there is no turntable
 * @returns {{ player: ClipPlayer, dispose: () => void }}
 */
export function mountClips(host, viewers, { save, failed = console.error } = {}) {
  const clips = Object.assign(document.createElement("div"), { className: "clips", hidden: true });
  const player = new ClipPlayer(clips, viewers);
  const turntable = save ? new Turntable(viewers[viewers.length - 1], player, save, failed) : null;
  host.replaceChildren(clips, ...(turntable ? [turntable.element] : []));
  return {
    player,
    dispose() {
      turntable?.stop.abort();
      player.dispose();
      host.replaceChildren();
    },
  };
}

class Turntable {
  stop = new AbortController();

  /** @param {MeshViewer} viewer @param {ClipPlayer} player @param {(file: Blob, ending: Moving) => void} save @param {(error: unknown) => void} failed */
  constructor(viewer, player, save, failed) {
    this.viewer = viewer;
    this.player = player;
    this.said = Object.assign(document.createElement("span"), { className: "small muted" });
    this.said.setAttribute("role", "status");
    const kinds = movingKinds();
    this.buttons = kinds.map((kind) => {
      const button = Object.assign(document.createElement("button"), { type: "button", className: "chip chip-small", textContent: kind === "gif" ? "GIF" : kind === "mp4" ? "MP4" : "WebM" });
      button.setAttribute("aria-label", `Save a turntable as ${button.textContent}`);
      button.addEventListener("click", () => this.#record(kind, save, failed));
      return button;
    });
    const label = Object.assign(document.createElement("span"), { className: "small muted", textContent: "Turntable" });
    this.element = Object.assign(document.createElement("div"), { className: "turntable" });
    this.element.setAttribute("role", "group");
    this.element.setAttribute("aria-label", "Turntable");
    this.element.append(label, ...this.buttons, this.said);
    if (kinds.length === 1) this.said.textContent = NO_VIDEO;
    const ready = () => (this.element.hidden = !viewer.ready);
    for (const event of ["ready", "clips"]) viewer.addEventListener(event, ready, { signal: this.stop.signal });
    ready();
  }

  /** @param {Moving} kind @param {(file: Blob, ending: Moving) => void} save @param {(error: unknown) => void} failed */
  async #record(kind, save, failed) {
    const { viewer, player } = this;
    if (this.element.getAttribute("aria-busy") === "true") return;
    const told = this.said.textContent;
    this.#busy(true);
    const { moment, done } = player.film();
    try {
      const background = getComputedStyle(viewer.surface.container).backgroundColor;
      const progress = (/** @type {number} */ share) => (this.said.textContent = `Recording, ${Math.round(100 * share)}%`);
      save(await viewer.turntable({ kind, background, moment, progress, signal: this.stop.signal }), kind);
    } catch (error) {
      if (!this.stop.signal.aborted) failed(error);
    } finally {
      done();
      this.said.textContent = told;
      this.#busy(false);
    }
  }

  /** @param {boolean} busy */
  #busy(busy) {
    this.element.setAttribute("aria-busy", String(busy));
    for (const button of this.buttons) button.setAttribute("aria-disabled", String(busy)); // the focus stays
  }
}
