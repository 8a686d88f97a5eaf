// @ts-check
/** Plays the clips of viewers, all in step: what stands side by side is seen at the same moment. Nothing starts by itself. */

/** @typedef {import("./viewer.js").MeshViewer} MeshViewer */

const PLAY = "M8 5.500v13l10.500-6.500z";
const PAUSE = "M8.500 5.500v13M15.500 5.500v13";
const STEPS = 100; // of the slider, for any length
const LONGEST_MS = 100; // between two pictures; after a longer pause it goes on where it was

export class ClipPlayer {
  /** @type {Map<string, number>} */ #lengths = new Map(); // seconds, by the clips' names
  #seconds = 0; // of the clip
  #time = 0;
  #frame = 0;
  #last = 0;
  #stop = new AbortController();

  /** @param {HTMLElement} element gets the controls; hidden while there is nothing to play @param {MeshViewer[]} viewers */
  constructor(element, viewers) {
    this.element = element;
    this.viewers = viewers;
    this.path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    this.button = Object.assign(document.createElement("button"), { type: "button", className: "button button-icon" });
    this.choice = document.createElement("select");
    this.slider = Object.assign(document.createElement("input"), { type: "range", max: String(STEPS) });
    this.clock = Object.assign(document.createElement("span"), { className: "clip-clock" });
    this.#build();
    const { signal } = this.#stop;
    for (const viewer of viewers) {
      viewer.addEventListener("clips", () => this.#offer(), { signal });
      viewer.addEventListener("rest", () => this.rest(), { signal });
    }
    this.#offer();
  }

  #build() {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    for (const [name, value] of [["viewBox", "0 0 24 24"], ["class", "icon"], ["aria-hidden", "true"]]) svg.setAttribute(name, value);
    svg.append(this.path);
    this.button.append(svg);
    this.choice.setAttribute("aria-label", "Clip");
    this.slider.setAttribute("aria-label", "Time");
    this.clock.setAttribute("aria-hidden", "true"); // the slider says it
    this.element.setAttribute("role", "group");
    this.element.setAttribute("aria-label", "Animation");
    this.element.replaceChildren(this.button, this.choice, this.slider, this.clock);
    this.button.addEventListener("click", () => (this.#frame ? this.pause() : this.#play()));
    this.choice.addEventListener("change", () => this.#choose());
    this.slider.addEventListener("input", () => this.#seek());
  }

  /** Offer the clips that any of the viewers has. */
  #offer() {
    this.#lengths = new Map(this.viewers.flatMap(({ clips }) => clips.map(({ name, seconds }) => [name, seconds])));
    const chosen = this.#lengths.has(this.choice.value) ? this.choice.value : "";
    this.element.hidden = this.#lengths.size === 0;
    this.choice.replaceChildren(new Option("At rest", ""), ...[...this.#lengths.keys()].map((name) => new Option(name)));
    this.choice.value = chosen;
    if (chosen) this.#show();
    else this.rest();
  }

  #choose() {
    this.#time = 0;
    this.pause();
    if (this.choice.value && !matchMedia("(prefers-reduced-motion: reduce)").matches) this.#play();
  }

  #play() {
    if (!this.choice.value) this.choice.selectedIndex = 1;
    this.#last = performance.now();
    this.#frame = requestAnimationFrame(this.#run);
    this.#show();
  }

  #run = (/** @type {number} */ now) => {
    this.#time = (this.#time + Math.min(Math.max(now - this.#last, 0), LONGEST_MS) / 1000) % this.#seconds || 0;
    this.#last = now;
    this.#frame = requestAnimationFrame(this.#run);
    this.#show();
  };

  pause() {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    this.#show();
  }

  /** Show the assets as they stand in their files. */
  rest() {
    this.choice.value = "";
    this.#time = 0;
    this.pause();
  }

  /** Someone moves the slider: the clip stands still there. */
  #seek() {
    this.#time = (this.#seconds * Number(this.slider.value)) / STEPS;
    this.pause();
  }

  /** Show the moment everywhere. */
  #show() {
    const clip = this.choice.value;
    this.#seconds = this.#lengths.get(clip) ?? 0;
    const share = this.#seconds ? this.#time / this.#seconds : 0;
    const [time, length] = [this.#time, this.#seconds].map((seconds) => seconds.toFixed(1));
    this.path.setAttribute("d", this.#frame ? PAUSE : PLAY);
    this.button.title = this.#frame ? "Pause" : "Play";
    this.button.setAttribute("aria-label", this.button.title);
    this.slider.disabled = !clip;
    this.slider.value = String(STEPS * share);
    // Read aloud where it stands still, not at every picture.
    if (!this.#frame) this.slider.setAttribute("aria-valuetext", clip ? `${time} of ${length} seconds` : "at rest");
    this.clock.textContent = clip ? `${time} / ${length} s` : "";
    for (const viewer of this.viewers) viewer.pose(clip || null, this.#time);
  }

  dispose() {
    cancelAnimationFrame(this.#frame);
    this.#stop.abort();
  }
}
