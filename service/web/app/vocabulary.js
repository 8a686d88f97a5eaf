// @ts-check
/**
 * The words that a model knows.
 *
 * @typedef {{nouns: string[], attributes: string[], parts: Record<string, string[]>, examples: string[], groups: [string, string[]][]}} Vocabulary
 * @typedef {{id: string, title: string, description: string, available: boolean, vocabulary: Vocabulary | null}} Model
 * @typedef {{default: string, models: Model[], shapes: Vocabulary | null}} Catalogue `shapes`: what there are shapes of, whatever the model; the user's own words first.
 */

/** What `GET /v1/models` says; nothing, where it could not be asked. @param {any} document @returns {Catalogue} */
export function catalogue({ models = [], default: standard = "", shapes = null }) {
  const words = (/** @type {any} */ vocabulary) => vocabulary && { ...vocabulary, groups: Object.entries(vocabulary.groups) };
  const read = (/** @type {any} */ model) => ({
    ...model,
    available: model.available !== false, // null: the server cannot tell
    vocabulary: words(model.vocabulary),
  });
  return { default: standard, models: models.map(read), shapes: words(shapes) };
}

/** Words of the user's own. @param {Vocabulary} known */
export function ownNouns(known) {
  return known.groups.find(([group]) => group === "yours")?.[1] ?? [];
}

/** @param {string} word */
export function withArticle(word) {
  return `${/^[aeiou]/.test(word) ? "an" : "a"} ${word}`;
}
