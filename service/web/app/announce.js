// @ts-check
/** Announcements to screen readers (changes of state, not every percent), short notes, and a line about waiting. */
import { h } from "./dom.js";

/** @type {HTMLElement | null} */
let region = null;
/** @type {HTMLElement | null} */
let toasts = null;

/** @param {HTMLElement} parent */
export function mountAnnouncer(parent) {
  region = h("div", { class: "visually-hidden", role: "status", "aria-live": "polite" });
  toasts = h("div", { class: "toasts", "aria-hidden": "true" });
  const waiting = h("p", { class: "waiting", hidden: true });
  parent.append(region, waiting, toasts);
  let until = 0;
  const count = () => {
    const left = Math.ceil((until - Date.now()) / 1000);
    waiting.hidden = left <= 0;
    if (left <= 0) return;
    waiting.textContent = `Rate limit reached. Trying again by itself in ${left} s.`;
    setTimeout(count, 500);
  };
  document.addEventListener("ratelimited", (event) => {
    const started = until > Date.now();
    until = Math.max(until, Date.now() + 1000 * /** @type {CustomEvent} */ (event).detail);
    if (started) return;
    count();
    announce(waiting.textContent ?? "");
  });
}

/** @param {string} text */
export function announce(text) {
  if (!region) return;
  // The same words twice are news, too.
  region.textContent = region.textContent === text ? text + "\u00a0" : text;
}

/**
 * Say it to everybody: aloud, and on the screen for a few seconds.
 *
 * @param {string} text
 */
export function toast(text) {
  announce(text);
  const note = h("div", { class: "toast" }, text);
  toasts?.append(note);
  setTimeout(() => note.remove(), 4000);
}
