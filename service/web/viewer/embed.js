// @ts-check
/**
 * A result on any page, with a slider between what it was and what it became:
 *
 *     <script type="module" src="web/viewer/embed.js"></script>
 *     <meshdeform-result source="vase.glb" result="lamp.glb" label="A vase becomes a lamp"></meshdeform-result>
 *
 * `source` and `result` are GLBs of the same triangles; `label` names the view for those who do not see it. Further
 * attributes: `poster`, a picture until they are there, which is when the element is first seen; `animation`, the clip
 * that plays then, by its name or empty for the first (it stands still where motion is unwanted); `theme`, `light` or
 * `dark` where it should not be that of the page. It fills the box that the page's CSS gives it, else it is as wide as its
 * place and no higher than the window, in the font and the colours of the text around it; `--viewer-background` and
 * `accent-color` change those. With `usdz`, the result as USDZ, iPhones show it in the room, and Android does with the
 * GLB. Events: `ready`, and `failed`, whose `detail` is the error.
 */
import { arLink } from "./ar.js";
import { mountClips, MeshViewer } from "./viewer.js";

const STYLE = new CSSStyleSheet();
STYLE.replaceSync(`
  :host { display: grid; grid-template: minmax(0, 1fr) auto auto / minmax(0, 1fr); box-sizing: border-box; aspect-ratio: 4 / 3; max-block-size: 100svh; max-inline-size: 100%; accent-color: currentcolor; }
  :host([hidden]), [hidden] { display: none; }
  :host([theme=light]) { color-scheme: light; color: #1d1b18; }
  :host([theme=dark]) { color-scheme: dark; color: #f0ece4; }
  .view { position: relative; min-height: 0; border-radius: 12px; overflow: hidden; --viewer-background: color-mix(in srgb, currentcolor 7%, transparent); --viewer-background-edge: color-mix(in srgb, currentcolor 16%, transparent); }
  .view > img { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: contain; }
  .bar, .clips { display: flex; gap: 12px; align-items: center; min-height: 44px; }
  input { flex: 1; min-width: 0; height: 44px; margin: 0; }
  button, select { min-width: 44px; min-height: 44px; font: inherit; color: inherit; background: transparent; border: 1px solid color-mix(in srgb, currentcolor 45%, transparent); border-radius: 8px; }
  select { flex: 0 1 140px; min-width: 0; }
  option { color: canvastext; background: canvas; }
  .icon { width: 1.25em; height: 1.25em; fill: none; stroke: currentcolor; stroke-width: 1.7; vertical-align: middle; }
  .clip-clock { font-variant-numeric: tabular-nums; }
  [role=alert] { position: absolute; inset: 0; display: grid; place-content: center; margin: 0; padding: 24px; text-align: center; }
`);

class MeshdeformResult extends HTMLElement {
  static observedAttributes = ["source", "result", "animation", "theme"];
  /** @type {MeshViewer | null} */
  #viewer = null;
  /** @type {ReturnType<typeof mountClips> | null} */
  #moving = null;
  #seen = new IntersectionObserver((entries) => entries.some(({ isIntersecting }) => isIntersecting) && this.#begin());

  connectedCallback() {
    const root = this.shadowRoot ?? this.attachShadow({ mode: "open" });
    root.adoptedStyleSheets = [STYLE];
    this.view = Object.assign(document.createElement("div"), { className: "view" });
    const slider = Object.assign(document.createElement("input"), { type: "range", max: "100", value: "100" });
    slider.setAttribute("aria-label", "From the source to the result");
    slider.addEventListener("input", () => this.#viewer?.setMorph(Number(slider.value) / 100));
    this.slider = slider;
    this.bar = Object.assign(document.createElement("div"), { className: "bar" });
    this.clips = document.createElement("div");
    this.bar.append("Before", slider, "After");
    const [glb, usdz, title] = ["result", "usdz", "label"].map((name) => this.getAttribute(name) ?? "");
    const room = arLink({ glb, usdz, title });
    if (room) this.bar.append(room);
    const poster = this.getAttribute("poster");
    if (poster) this.view.append(Object.assign(document.createElement("img"), { src: poster, alt: this.getAttribute("label") ?? "" }));
    root.replaceChildren(this.view, this.bar, this.clips);
    this.#seen.observe(this);
  }

  disconnectedCallback() {
    this.#seen.disconnect();
    this.#end();
  }

  /** @param {string} name @param {string | null} before @param {string | null} now */
  attributeChangedCallback(name, before, now) {
    if (before === now || !this.#viewer) return; // before the first look there is nothing to change
    if (name === "animation") this.#animate();
    else if (name === "theme") this.#viewer.surface.retheme();
    else this.#begin();
  }

  #end() {
    this.#moving?.dispose();
    this.#viewer?.dispose();
    this.#viewer = this.#moving = null;
  }

  /** Load what the attributes say, instead of what was there. */
  #begin() {
    this.#seen.disconnect();
    this.#end();
    this.view?.querySelector("[role=alert]")?.remove();
    if (this.bar) this.bar.hidden = false;
    void this.#open();
  }

  async #open() {
    const { view, clips } = /** @type {{ view: HTMLElement, clips: HTMLElement }} */ (this);
    try {
      const viewer = (this.#viewer = new MeshViewer(view, { label: this.getAttribute("label") ?? "3D model" }));
      this.#moving = mountClips(clips, [viewer]);
      const files = ["source", "result"].map(async (name) => {
        const response = await fetch(this.getAttribute(name) ?? "");
        if (!response.ok) throw new Error(`The ${name} could not be loaded.`);
        return response.arrayBuffer();
      });
      const [source, result] = await Promise.all(files);
      await viewer.load(source);
      await viewer.setDeformed(result);
      if (viewer !== this.#viewer) return;
      viewer.setMorph(Number(this.slider?.value ?? 100) / 100);
      view.querySelector("img")?.remove();
      this.#animate();
      this.dispatchEvent(new Event("ready"));
    } catch (error) {
      // It has gone, or loads something else.
      if (!this.isConnected || (error instanceof DOMException && error.name === "AbortError")) return;
      if (this.bar) this.bar.hidden = true;
      this.#end();
      const note = Object.assign(document.createElement("p"), { textContent: error instanceof Error ? error.message : String(error) });
      note.setAttribute("role", "alert");
      view.append(note);
      this.dispatchEvent(new CustomEvent("failed", { detail: error }));
    }
  }

  #animate() {
    const name = this.getAttribute("animation");
    if (name === null) this.#moving?.player.rest();
    else this.#moving?.player.choose(name);
  }
}

customElements.define("meshdeform-result", MeshdeformResult);
