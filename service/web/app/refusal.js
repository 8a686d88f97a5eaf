// @ts-check
/** A prompt that the model does not understand: what it did not, and prompts near it that it does. */
import { MeshdeformError } from "./client.js";
import { chip, fill, h } from "./dom.js";
import { plainWords } from "./plain.js";
import { described } from "./problem-box.js";

/** @param {unknown} error */
export function isAboutPrompt(error) {
  return error instanceof MeshdeformError && error.code.startsWith("prompt_");
}

/** What was not understood, in one line. @param {MeshdeformError} error */
function refusalText(error) {
  const { unknown } = error.problem;
  if (Array.isArray(unknown) && unknown.length) return `Not understood: ${unknown.map((word) => `“${word}”`).join(", ")}.`;
  // The first sentence says what is wrong.
  return plainWords(error.message.split(/(?<=[.!?])\s/)[0]) || error.title;
}

/** Whether the server's prompts are near the one that was refused, and not merely examples. @param {MeshdeformError} error */
function isNear({ problem: { corrections, nearest } }) {
  return [corrections, nearest].some((found) => found && typeof found === "object" && Object.keys(found).length > 0);
}

/**
 * Say what is wrong with a prompt, with buttons that repair it.
 * @param {HTMLElement} element
 * @param {unknown} error A problem of the server, or a sentence.
 * @param {(prompt: string) => void} use
 */
export function showRefusal(element, error, use) {
  const found = error instanceof MeshdeformError ? error : null;
  const text = found ? refusalText(found) : typeof error === "string" ? error : described(error).title;
  const offers = /** @type {string[]} */ (found?.problem.suggestions ?? []).slice(0, 3);
  const near = found !== null && isNear(found);
  fill(
    element,
    h("strong", null, text),
    near ? h("span", null, " Did you mean:") : null,
    offers.length
      ? h("div", { class: "chips", role: "group", "aria-label": "Prompts that work" }, offers.map((offer) => chip(`Use “${offer}”`, () => use(offer), { small: false })))
      : null,
  );
}
