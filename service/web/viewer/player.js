// @ts-check
/**
 * Plays the clips of viewers, all in step: what stands side by side is seen at the same moment. Nothing starts by itself.
 * `clips.js` puts it below a view.
 */

/** @typedef {import("./viewer.js").MeshViewer} MeshViewer */

const PLAY = "M8 5.500v13l10.500-6.500z";
const PAUSE = "M8.500 5.500v13M15.500 5.500v13";
const FRAME_S = 1 / 30; // of the slider, and of the keys that go by a frame
const LONGEST_MS = 100; // between two pictures; after a longer pause it goes on where it was

export class ClipPlayer {
  /** @type {Map<string, number>} */ #lengths = new Map(); // seconds, by the clips' names
  #seconds = 0; // of the clip
  #time = 0;
  #frame = 0;
  #last = 0;
  #stop = new AbortController();

  /** @param {HTMLElement} element gets the buttons; hidden while there is nothing to play @param {MeshViewer[]} viewers */
  constructor(element, viewers) {
    this.element = element;
    this.viewers = viewers;
    this.path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    this.button = Object.assign(document.createElement("button"), { type: "button", className: "button button-icon" });
    this.choice = document.createElement("select");
    this.slider = Object.assign(document.createElement("input"), { type: "range", min: "0", max: "0", step: "any" });
    this.clock = Object.assign(document.createElement("span"), { className: "clip-clock" });
    this.#build();
    const { signal } = this.#stop;
    for (const viewer of viewers) {
      viewer.addEventListener("clips", () => this.#offer(), { signal });
      viewer.addEventListener("rest", () => this.rest(), { signal });
    }
    for (const element of [this.element, ...viewers.map(({ surface }) => surface.container)]) element.addEventListener("keydown", this.#key, { signal });
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
    this.button.addEventListener("click", () => this.#toggle());
    this.choice.addEventListener("change", () => this.#choose());
    this.slider.addEventListener("input", () => this.#seek());
  }

  #toggle() {
    if (this.#frame) this.pause();
    else this.#play();
  }

  /** Keys that the element which has the focus does not take itself. @param {KeyboardEvent} event */
  #key = (event) => {
    const { target, currentTarget, key } = event;
    if (this.element.hidden || event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    if (currentTarget !== this.element && target !== currentTarget) return; // a field over the view
    const by = { ",": -1, ".": 1 }[key] ?? (target === this.slider ? { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[key] : undefined);
    if (key === " " && target !== this.button && target !== this.choice) this.#toggle();
    else if (by) this.#step(by);
    else return;
    event.preventDefault();
  };

  /** @param {number} frames forwards */
  #step(frames) {
    if (!this.choice.value) this.choice.selectedIndex = 1;
    const { value } = this.choice;
    this.#time = Math.min(Math.max(this.#time + frames * FRAME_S, 0), this.#lengths.get(value) ?? 0);
    this.pause();
  }

  /** Let someone else turn the pages: `moment` shows the clip that many seconds after the moment that is shown, `done` goes on as before. @returns {{ moment: (seconds: number) => void, done: () => void }} */
  film() {
    const [playing, from] = [this.#frame > 0, this.#time];
    cancelAnimationFrame(this.#frame);
    const clip = this.choice.value;
    const show = (/** @type {number} */ time) => this.viewers.forEach((viewer) => viewer.pose(clip || null, time));
    return {
      moment: (seconds) => clip && playing && show((from + seconds) % this.#seconds || 0),
      done: () => (playing ? this.#play() : this.#show()),
    };
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

  /** Play a clip from its beginning, or let it stand there where motion is unwanted. @param {string} name empty: the first; where there is none of the name, all is at rest */
  choose(name) {
    const [first = ""] = this.#lengths.keys();
    this.choice.value = this.#lengths.has(name || first) ? name || first : "";
    this.#choose();
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
    this.#time = Number(this.slider.value);
    this.pause();
  }

  /** Show the moment everywhere. */
  #show() {
    const clip = this.choice.value;
    this.#seconds = this.#lengths.get(clip) ?? 0;
    const [time, length] = [this.#time, this.#seconds].map((seconds) => seconds.toFixed(1));
    this.path.setAttribute("d", this.#frame ? PAUSE : PLAY);
    this.button.title = this.#frame ? "Pause" : "Play";
    this.button.setAttribute("aria-label", this.button.title);
    this.slider.disabled = !clip;
    this.slider.max = String(this.#seconds);
    this.slider.value = String(this.#time);
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
