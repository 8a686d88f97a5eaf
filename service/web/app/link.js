// @ts-check
/** The link by which somebody without a key looks at one job. It takes the place of a key while its view is open. */
import { askForKey, currentKey } from "./key.js";

let held = "";

/** Hold the link of the view that opens; empty: the view is no shared one. @param {string} token */
export function holdLink(token) {
  held = token;
}

/** The token of the link; empty where the page is not shown by one. */
export function currentLink() {
  return held;
}

/** What requests of the page send. */
export function credential() {
  return held || currentKey();
}

/**
 * Ask for a key, but not those who came by a link, which no key mends.
 * @param {string} refused
 * @param {AbortSignal} [signal]
 */
export function askUnlessLinked(refused, signal) {
  // A request that was under way when the view changed is none of the view that there is now.
  return held || refused.startsWith("link.") ? Promise.resolve(false) : askForKey(refused, signal);
}
