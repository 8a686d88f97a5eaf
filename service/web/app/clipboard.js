// @ts-check
/** Copies a text for the user. */
import { toast } from "./announce.js";
import { h } from "./dom.js";

/** @param {string} text @param {string} done Said once it is copied. */
export async function copyText(text, done) {
  try {
    await navigator.clipboard.writeText(text);
    toast(done);
  } catch {
    // Without TLS browsers have no clipboard.
    const field = h("textarea", { class: "visually-hidden", ".value": text });
    document.body.append(field);
    field.select();
    const copied = document.execCommand("copy");
    field.remove();
    toast(copied ? done : "This browser does not let the page copy.");
  }
}
