// @ts-check
/** Announcements to screen readers (changes of state, not every percent) and short notes. */
import { h } from "./dom.js";

/** @type {HTMLElement | null} */
let region = null;
/** @type {HTMLElement | null} */
let toasts = null;

/** @param {HTMLElement} parent */
export function mountAnnouncer(parent) {
  region = h("div", { class: "visually-hidden", role: "status", "aria-live": "polite" });
  toasts = h("div", { class: "toasts" });
  parent.append(region, toasts);
  document.addEventListener("ratelimited", (event) => {
    toast(`Rate limit reached. Trying again by itself in ${/** @type {CustomEvent} */ (event).detail} s.`);
  });
}

/** @param {string} text */
export function announce(text) {
  if (!region) return;
  // The same words twice are news, too.
  region.textContent = region.textContent === text ? text + "\u00a0" : text;
}

/** Say it to everybody: aloud, and on the screen for a few seconds. @param {string} text */
export function toast(text) {
  announce(text);
  const note = h("div", { class: "toast", "aria-hidden": "true" }, text);
  toasts?.append(note);
  setTimeout(() => note.remove(), 4000);
}
