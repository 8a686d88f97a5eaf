// @ts-check
/**
 * Whether an asset can become what its prompt says, and what would work better; known once the asset has been read.
 *
 * @typedef {object} Outlook As `POST /v1/jobs:validate` has it.
 * @property {boolean} doubtful
 * @property {string[]} reasons Sentences.
 * @property {string[]} suggestions Prompts.
 */
import { chip, fill, h, icon } from "./dom.js";
import { plainWords } from "./plain.js";

/** Warn of what can hardly be, with buttons for what would work. @param {HTMLElement} element @param {Outlook | null} outlook @param {(prompt: string) => void} use */
export function showOutlook(element, outlook, use) {
  element.hidden = !outlook?.doubtful;
  if (!outlook?.doubtful) return void fill(element);
  const { reasons = [], suggestions = [] } = outlook;
  const chips = suggestions.map((prompt) => chip(`Use “${prompt}”`, () => use(prompt), { small: false }));
  fill(
    element,
    h("p", null, icon("warn"), h("span", null, h("strong", null, "This may not work well."), ` ${plainWords(reasons.join(" "))}`)),
    chips.length ? h("div", { class: "chips", role: "group", "aria-label": "Prompts that would work better" }, chips) : null,
  );
}
