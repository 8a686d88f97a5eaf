// @ts-check
/** Announcements to screen readers (changes of state, not every percent), short notes, and a line about waiting. */
import { button, h } from "./dom.js";

const UNDO_MS = 10_000;

/** @type {HTMLElement | null} */
let region = null;
/** @type {HTMLElement | null} */
let toasts = null;

/** @param {HTMLElement} parent */
export function mountAnnouncer(parent) {
  region = h("div", { class: "visually-hidden", role: "status", "aria-live": "polite" });
  toasts = h("div", { class: "toasts" });
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

/** Say it to everybody: aloud, and on the screen for a few seconds. @param {string} text */
export function toast(text) {
  announce(text);
  const note = h("div", { class: "toast", "aria-hidden": "true" }, text);
  toasts?.append(note);
  setTimeout(() => note.remove(), 4000);
}

/**
 * Say what will be done, with a button that prevents it. The time stops while the pointer or the focus is on it.
 * @param {string} text
 * @param {() => void} undo
 * @param {() => void} act called once the time is over
 * @returns {() => void} Takes the note away; neither function is called any more.
 */
export function toastWithUndo(text, undo, act) {
  announce(`${text}. Undo is possible for ${UNDO_MS / 1000} seconds.`);
  let timer = 0;
  const close = () => (clearTimeout(timer), note.remove());
  const note = h("div", { class: "toast toast-undo" }, text, button("Undo", () => (close(), announce("Undone"), undo()), {}));
  const start = () => {
    clearTimeout(timer);
    if (note.isConnected) timer = window.setTimeout(() => (close(), act()), UNDO_MS);
  };
  for (const type of ["pointerenter", "focusin"]) note.addEventListener(type, () => clearTimeout(timer));
  for (const type of ["pointerleave", "focusout"]) note.addEventListener(type, start);
  toasts?.append(note);
  start();
  return close;
}
