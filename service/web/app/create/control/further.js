// @ts-check
/**
 * Further prompts of a request, as the form edits them. Their regions lie in the list of all regions, so that the same
 * tools edit them; the action of such a region names its prompt. No elements here, so that node can test it.
 *
 * @typedef {{id: number, prompt: string, weight: number, where: "all" | "in" | "out"}} Further `where` it pulls: everywhere, in its
 *   regions, or outside of them. `id` stays the same while others come and go.
 * @typedef {import("./model.js").Region} Region
 */
import { partOf } from "../parts/naming.js";

export const MOST_PROMPTS = 8;
const MOST_WEIGHT = 100;
const ACTION = "prompt:";

/** The action of a region at which a prompt pulls. @param {number} id */
export function promptAction(id) {
  return ACTION + id;
}

/** Whether a region is for a prompt or a part, and says nothing about what may move. @param {string | undefined} action */
export function isAimed(action) {
  return (action?.startsWith(ACTION) ?? false) || partOf(action) !== null;
}

/** @param {Region[]} regions @param {number} id @returns {Region[]} those of a prompt */
export function regionsOf(regions, id) {
  return regions.filter(({ action }) => action === promptAction(id));
}

/** @param {Region[]} regions @returns {Region[]} those that say what may move */
export function unaimed(regions) {
  return regions.filter(({ action }) => !isAimed(action));
}

/** Those that are sent: an empty row asks for nothing. @param {Further[]} prompts */
export function written(prompts) {
  return prompts.filter(({ prompt }) => prompt.trim());
}

/** `params.prompts` of a request. @param {Further[]} prompts @param {Region[]} regions Of all actions. @returns {Record<string, any>[]} */
export function furtherParams(prompts, regions) {
  return written(prompts).map(({ id, prompt, weight, where }) => {
    const own = where === "all" ? [] : regionsOf(regions, id).filter(({ faces }) => !faces || faces.length);
    return {
      prompt: prompt.trim(),
      ...(weight === 1 ? {} : { weight }),
      ...(own.length ? { regions: own.map(({ action: _, ...selection }) => selection) } : {}),
      ...(own.length && where === "out" ? { outside: true } : {}),
    };
  });
}

/**
 * The prompts of a job and, as the list of all regions has them, their regions.
 * @param {any[]} asked `params.prompts`.
 * @returns {{prompts: Further[], regions: Region[]}}
 */
export function furtherOf(asked) {
  const prompts = asked.map(({ prompt, weight, regions, outside }, i) => ({
    id: i + 1,
    prompt: String(prompt),
    weight: Number(weight ?? 1),
    where: /** @type {Further["where"]} */ (!regions?.length ? "all" : outside ? "out" : "in"),
  }));
  const regions = asked.flatMap(({ regions: own }, i) => (own ?? []).map((/** @type {Region} */ region) => ({ ...region, action: promptAction(i + 1) })));
  return { prompts, regions };
}

/** The name of a prompt; that of the request is the first. @param {Further[]} prompts @param {number} id */
export function promptName(prompts, id) {
  return `Prompt ${prompts.findIndex((each) => each.id === id) + 2}`;
}

/**
 * Give prompts of an earlier state the words and weights that they have now: those are not what is undone.
 * @param {Further[]} now
 * @param {Further[]} earlier
 */
export function keepWords(now, earlier) {
  for (const each of earlier) {
    const { prompt, weight } = now.find(({ id }) => id === each.id) ?? each;
    Object.assign(each, { prompt, weight });
  }
}

/** What of the prompts cannot be sent, in a sentence; empty where all is fine. @param {Further[]} prompts @param {Region[]} regions */
export function furtherProblem(prompts, regions) {
  for (const { id, prompt, weight, where } of prompts) {
    const name = promptName(prompts, id);
    const own = regionsOf(regions, id).filter(({ faces }) => !faces || faces.length);
    if (!(weight >= 0 && weight <= MOST_WEIGHT)) return `The weight of ${name.toLowerCase()} must be from 0 to ${MOST_WEIGHT}.`;
    if (where !== "all" && !own.length) return `${name} has no region yet: add one, or let it act everywhere.`;
    if (!prompt.trim() && own.length) return `${name} has a region and no words: write it, or remove it.`;
  }
  return "";
}
