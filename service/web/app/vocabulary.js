// @ts-check
/**
 * Prompts put together from the words that a model knows.
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

/** Attributes that stand before a noun; those of parts ("long neck") are two words. @param {Vocabulary} known */
export function adjectives(known) {
  return known.attributes.filter((attribute) => /^[a-z]+$/.test(attribute));
}

/** Words of the user's own. @param {Vocabulary} known */
export function ownNouns(known) {
  return known.groups.find(([group]) => group === "yours")?.[1] ?? [];
}

/** @param {string} word */
export function withArticle(word) {
  return `${/^[aeiou]/.test(word) ? "an" : "a"} ${word}`;
}

/**
 * The prompt with another noun, its adjectives kept: "a tall vase" becomes "a tall lamp".
 * @param {string} prompt
 * @param {string} noun
 * @param {Vocabulary} known
 */
export function withNoun(prompt, noun, known) {
  const kept = used(prompt, known);
  return withArticle([...kept, noun].join(" "));
}

/** The noun that a prompt names, and where; of several the longest: "a dragon fruit" is no dragon. @param {string} prompt @param {Vocabulary} known */
export function nounIn(prompt, known) {
  const text = ` ${prompt.toLowerCase().replace(/[^a-z]/g, " ")} `;
  const found = known.nouns.map((noun) => ({ noun, at: text.indexOf(` ${noun.replaceAll("-", " ")} `) })).filter(({ at }) => at >= 0);
  return found.sort((one, other) => other.noun.length - one.noun.length)[0] ?? null;
}

/** The prompt with an adjective more, or without it where it has it. @param {string} prompt @param {string} adjective @param {Vocabulary} known */
export function withAdjective(prompt, adjective, known) {
  const found = nounIn(prompt, known);
  const before = used(prompt, known);
  const kept = before.includes(adjective) ? before.filter((word) => word !== adjective) : [...before, adjective];
  if (!found) return prompt.trim() ? `${prompt.trim()} ${adjective}` : adjective;
  const tail = prompt.slice(found.at + found.noun.length);
  return withArticle([...kept, found.noun].join(" ")) + tail;
}

/** @param {string} prompt @param {Vocabulary} known */
function used(prompt, known) {
  const plain = new Set(adjectives(known));
  // What follows "with" sizes parts: "a giraffe with a long neck" is not a long giraffe.
  const front = prompt.toLowerCase().split(/\bwith\b/)[0];
  return (front.match(/[a-z]+/g) ?? []).filter((word) => plain.has(word));
}

/** A prompt by chance, of a noun and now and then an adjective. @param {Vocabulary} known @param {() => number} [random] */
export function surprise(known, random = Math.random) {
  const pick = (/** @type {string[]} */ list) => list[Math.floor(random() * list.length)];
  const words = adjectives(known);
  const noun = pick(known.nouns);
  return withArticle(words.length && random() < 0.5 ? `${pick(words)} ${noun}` : noun);
}
