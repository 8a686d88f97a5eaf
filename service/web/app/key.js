// @ts-check
/** The API key: asked for when the server wants one, kept for this tab, or in this browser where the user says so. */
import { ask } from "./dialogs.js";
import { h } from "./dom.js";

const NAME = "meshdeform.key";
/** @type {Promise<boolean> | null} */
let asking = null;
/** Whether what a view asks for by itself, before anybody has done anything, asks for no key. */
let resting = false;

/** What the browser keeps; null where it keeps nothing. @param {"localStorage" | "sessionStorage"} kind @returns {Storage | null} */
export function storage(kind) {
  try {
    return window[kind];
  } catch {
    return null;
  }
}

let held = "";

export function currentKey() {
  return held || storage("sessionStorage")?.getItem(NAME) || storage("localStorage")?.getItem(NAME) || "";
}

export function forgetKey() {
  held = "";
  storage("sessionStorage")?.removeItem(NAME);
  storage("localStorage")?.removeItem(NAME);
  document.dispatchEvent(new Event("keychange"));
}

/** @param {string} key @param {boolean} remember */
function keep(key, remember) {
  forgetKey();
  held = key;
  try {
    storage(remember ? "localStorage" : "sessionStorage")?.setItem(NAME, key);
  } catch {
    // Full or forbidden: it is held while the page is open.
  }
  document.dispatchEvent(new Event("keychange"));
}

/**
 * Ask the user for a key, once for all requests that want one.
 * @param {string} refused The key that the server did not take; empty where none was sent.
 * @param {AbortSignal} [signal]
 * @returns {Promise<boolean>} Whether there is another key to try.
 */
export function askForKey(refused, signal) {
  if (signal?.aborted) return Promise.resolve(false);
  if (resting && !refused) return Promise.resolve(false);
  // Another request's question was answered while this one was under way.
  if (currentKey() !== refused) return Promise.resolve(true);
  asking ??= askUser(refused !== "").finally(() => (asking = null));
  return asking;
}

/**
 * Ask for no key until something is done in a view; call `again` once there is one.
 * @param {HTMLElement} root @param {import("./scope.js").Scope} scope @param {() => void} again
 */
export function restUntilUsed(root, scope, again) {
  resting = !currentKey();
  if (!resting) return;
  const wake = (/** @type {Event} */ { target }) => (resting &&= target instanceof Element && !target.closest("button, input, select, textarea"));
  for (const type of ["click", "input"]) root.addEventListener(type, wake, { capture: true, signal: scope.signal });
  scope.add(() => (resting = false));
  scope.listen(document, "keychange", () => currentKey() && again());
}

/** @param {boolean} wrong @returns {Promise<boolean>} */
function askUser(wrong) {
  const note = wrong ? "The server did not accept this key. Enter another one." : "This server requires an API key. Enter the one you were given.";
  const field = h("input", {
    id: "api-key", type: "password", autocomplete: "off", spellcheck: "false", required: true, maxlength: 500, pattern: "\\s*[\\x21-\\x7e]+\\s*",
    title: "A key has no spaces and only plain characters.", "aria-describedby": "api-key-note", autofocus: true,
  });
  const remember = h("input", { type: "checkbox" });
  let answer = false;
  const dialog = ask({
    title: "API key",
    body: [
      h("p", { id: "api-key-note", class: wrong ? "note-warn" : "muted" }, note),
      h("label", { class: "field-label", for: "api-key" }, "Key"),
      field,
      h("label", { class: "check" }, remember, "Remember in this browser"),
    ],
    action: "Use key",
    act: async () => {
      keep(field.value.trim(), remember.checked);
      answer = true;
    },
  });
  return new Promise((resolve) => dialog.addEventListener("close", () => resolve(answer)));
}

// The link by which somebody without a key looks at one job takes the place of a key while its view is open.
let link = "";

/** Hold the link of the view that opens; empty: the view is no shared one. @param {string} token */
export function holdLink(token) {
  link = token;
}

/** The token of the link; empty where the page is not shown by one. */
export function currentLink() {
  return link;
}

/** What requests of the page send. */
export function credential() {
  return link || currentKey();
}

/** Ask for a key, but not those who came by a link, which no key mends. @param {string} refused @param {AbortSignal} [signal] */
export function askUnlessLinked(refused, signal) {
  // A request that was under way when the view changed is none of the view that there is now.
  return link || refused.startsWith("link.") ? Promise.resolve(false) : askForKey(refused, signal);
}
