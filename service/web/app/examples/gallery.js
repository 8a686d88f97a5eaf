// @ts-check
/**
 * The examples that come with the page: assets, what was asked of them, and what became of them. They need no API key.
 *
 * @typedef {object} Example
 * @property {string} id
 * @property {string} asset The source, a file below `web/examples/`.
 * @property {string} label What the source is.
 * @property {string} result A file below `web/examples/`, as is `picture`.
 * @property {string} picture
 * @property {{prompt: string, params: Record<string, any>, output: Record<string, any>}} document The request that made the result.
 * @property {Record<string, any>} report What the report of the result says about it.
 */
import { client } from "../client.js";
import { h } from "../dom.js";
import { goalWords } from "../format.js";
import { routeHash } from "../router.js";

/** Full rows of three, two or one. */
const SHOWN = 6;

/** @param {AbortSignal} signal @returns {Promise<Example[]>} */
export async function gallery(signal) {
  return (await client.json("web/examples/gallery.json", { signal })).examples;
}

/** @param {string} id @param {AbortSignal} signal @returns {Promise<Example>} */
export async function exampleOf(id, signal) {
  const found = (await gallery(signal)).find((example) => example.id === id);
  if (!found) throw new Error(`There is no example ${id}.`);
  return found;
}

/** @param {Example} example */
function card({ id, label, picture, document }) {
  const image = h("img", { src: client.url(`web/examples/${picture}`), alt: "", loading: "lazy", width: 640, height: 320 });
  return h(
    "li",
    { class: "card" },
    h("div", { class: "card-picture" }, image),
    h(
      "div",
      { class: "card-text" },
      h("h3", null, h("a", { class: "card-link", href: routeHash({ name: "create", from: null, example: id }) }, goalWords(document))),
      h("div", { class: "row card-meta" }, h("span", { class: "small muted" }, label)),
    ),
  );
}

/** @param {Example[]} examples */
export function exampleCards(examples) {
  return h("ul", { class: "card-grid gallery" }, examples.map(card));
}

/** The examples below the form. @param {import("../scope.js").Scope} scope */
export function exampleSection(scope) {
  const element = h("section", { class: "recent", "aria-labelledby": "examples-title", hidden: true });
  gallery(scope.signal).then(
    (examples) => {
      if (scope.over) return;
      element.hidden = false;
      element.append(h("div", { class: "section-head" }, h("h2", { id: "examples-title" }, "Examples"), h("a", { href: "#/examples" }, "All examples")), exampleCards(examples.slice(0, SHOWN)));
    },
    () => {}, // The form works without them.
  );
  return element;
}
