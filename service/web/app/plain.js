// @ts-check
/** The words of people: what a server says without the names that only programs use. The rest stands under Details. */

/** Names of parameters that are no words. @type {Set<string>} */
const NAMES = new Set();

/** Learn the names of parameters. @param {any} schema A JSON schema, or a part of one. */
export function learnNames(schema) {
  if (!schema || typeof schema !== "object") return;
  for (const [name, member] of Object.entries(schema.properties ?? {})) {
    if (name.includes("_")) NAMES.add(name);
    learnNames(member);
  }
  for (const member of Object.values(schema.$defs ?? {})) learnNames(member);
}

/** Whether a sentence names what only programs name: in backticks, a parameter, a setting of the environment. @param {string} sentence */
function isCode(sentence) {
  return /`|\bMESHDEFORM_|\b(?:output|params|guidance|control)\.[a-z]/.test(sentence) || (sentence.match(/\b[a-z]+(?:_[a-z0-9]+)+\b/g) ?? []).some((word) => NAMES.has(word));
}

/** The sentences of a text that people read; empty where there is none. @param {string} text */
export function plainWords(text) {
  return text.split(/(?<=[.!?])\s+/).filter((sentence) => !isCode(sentence)).join(" ");
}
