// @ts-check
/**
 * A result on any page, with a slider between what it was and what it became:
 *
 *     <script type="module" src="web/viewer/embed.js"></script>
 *     <meshdeform-result source="vase.glb" result="lamp.glb" label="A vase becomes a lamp"></meshdeform-result>
 *
 * Below it what the asset's clips are played with, if it has any. `source` and `result` are GLBs of the same triangles; `label` names the view for those who do not see it. With `usdz`, the result as USDZ, iPhones show it in the room, and Android does with the GLB. Events: `ready`,
 * and `failed`, whose `detail` is the error.
 */
import { arLink } from "./ar.js";
import { ClipPlayer, MeshViewer } from "./viewer.js";

const STYLE = new CSSStyleSheet();
STYLE.replaceSync(`
  :host { display: grid; grid-template: 1fr auto auto / minmax(0, 1fr); aspect-ratio: 4 / 3; font: 15px/1.4 system-ui, sans-serif; }
  .view { position: relative; min-height: 0; border-radius: 12px; overflow: hidden; }
  .bar, .clips { display: flex; gap: 12px; align-items: center; min-height: 44px; }
  input { flex: 1; min-width: 0; height: 44px; margin: 0; }
  button, select { min-width: 44px; min-height: 44px; font: inherit; }
  select { flex: 0 1 120px; }
  .icon { width: 1.25em; height: 1.25em; fill: none; stroke: currentcolor; stroke-width: 1.7; vertical-align: middle; }
  .clip-clock { font-variant-numeric: tabular-nums; }
  [hidden] { display: none; }
  [role=alert] { position: absolute; inset: 0; display: grid; place-content: center; padding: 24px; text-align: center; }
`);

class MeshdeformResult extends HTMLElement {
  /** @type {MeshViewer | null} */
  #viewer = null;
  /** @type {ClipPlayer | null} */
  #player = null;

  connectedCallback() {
    const root = this.shadowRoot ?? this.attachShadow({ mode: "open" });
    root.adoptedStyleSheets = [STYLE];
    const view = Object.assign(document.createElement("div"), { className: "view" });
    const slider = Object.assign(document.createElement("input"), { type: "range", max: "100", value: "100" });
    slider.setAttribute("aria-label", "From the source to the result");
    slider.addEventListener("input", () => this.#viewer?.setMorph(Number(slider.value) / 100));
    const bar = Object.assign(document.createElement("div"), { className: "bar" });
    const clips = Object.assign(document.createElement("div"), { className: "clips", hidden: true });
    bar.append("Before", slider, "After");
    const [glb, usdz, title] = ["result", "usdz", "label"].map((name) => this.getAttribute(name) ?? "");
    const room = arLink({ glb, usdz, title });
    if (room) bar.append(room);
    root.replaceChildren(view, bar, clips);
    void this.#open(view, bar, clips);
  }

  disconnectedCallback() {
    this.#player?.dispose();
    this.#viewer?.dispose();
    this.#viewer = this.#player = null;
  }

  /** @param {HTMLElement} view @param {HTMLElement} bar @param {HTMLElement} clips */
  async #open(view, bar, clips) {
    try {
      const viewer = (this.#viewer = new MeshViewer(view, { label: this.getAttribute("label") ?? "3D model" }));
      this.#player = new ClipPlayer(clips, [viewer]);
      const files = ["source", "result"].map(async (name) => {
        const response = await fetch(this.getAttribute(name) ?? "");
        if (!response.ok) throw new Error(`The ${name} could not be loaded.`);
        return response.arrayBuffer();
      });
      const [source, result] = await Promise.all(files);
      await viewer.load(source);
      await viewer.setDeformed(result);
      viewer.setMorph(1);
      this.dispatchEvent(new Event("ready"));
    } catch (error) {
      if (!this.isConnected) return;
      bar.hidden = clips.hidden = true;
      const note = Object.assign(document.createElement("p"), { textContent: error instanceof Error ? error.message : String(error) });
      note.setAttribute("role", "alert");
      view.append(note);
      this.dispatchEvent(new CustomEvent("failed", { detail: error }));
    }
  }
}

customElements.define("meshdeform-result", MeshdeformResult);
