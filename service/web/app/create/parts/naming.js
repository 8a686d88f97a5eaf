// @ts-check
/**
 * What a person says of the parts of an asset: the name of those that were found, several as one, and the faces of one.
 * The faces lie in the list of all regions, so that the same tools edit them; the action of such a region names its part.
 * No elements here, so that node can test it.
 *
 * @typedef {{name: string, parts: string[]}} Naming What was found under the names of `parts` is `name`.
 * @typedef {import("../control/model.js").Region} Region
 */

const ACTION = "part:";
/** What a name may be, as a pattern of the browser. */
export const NAME = "[\\p{L}\\p{N}][\\p{L}\\p{N} _\\-]*";

/** The action of a region that is a part. @param {string} name */
export function partAction(name) {
  return ACTION + name;
}

/** The part that a region is; null where it is none. @param {string | undefined} action */
export function partOf(action) {
  return action?.startsWith(ACTION) ? action.slice(ACTION.length) : null;
}

/** The names under which a part was found. @param {Naming[]} names @param {string} name */
function foundAs(names, name) {
  return names.find((each) => each.name === name)?.parts ?? [name];
}

/**
 * Give parts one name.
 * @param {Naming[]} names
 * @param {string[]} parts As they are called now; with the one that has the name already, if there is one.
 * @param {string} name
 * @returns {Naming[]}
 */
export function joined(names, parts, name) {
  const others = names.filter((each) => each.name !== name && !parts.includes(each.name));
  const taken = new Set(others.flatMap((each) => each.parts));
  const found = [...new Set(parts.flatMap((part) => foundAs(names, part)))].filter((each) => !taken.has(each));
  return found.every((each) => each === name) ? others : [...others, { name, parts: found }];
}

/** The same regions, with those of some parts as one part. @param {Region[]} regions @param {string[]} parts @param {string} name @returns {Region[]} */
export function moved(regions, parts, name) {
  return regions.map((region) => (parts.includes(partOf(region.action) ?? "") ? { ...region, action: partAction(name) } : region));
}

/** `params.parts` of a request. @param {Naming[]} names @param {Region[]} regions Of all actions. @returns {Record<string, any>[]} */
export function partParams(names, regions) {
  const painted = regions.filter(({ action, faces }) => partOf(action) !== null && (!faces || faces.length));
  return [...names.map(({ name, parts }) => ({ name, parts })), ...painted.map(({ action, ...selection }) => ({ name: partOf(action), ...selection }))];
}

/** What a job said of its parts. @param {any[]} asked `params.parts`, without members that are null. @returns {{names: Naming[], regions: Region[]}} */
export function partsAsked(asked) {
  return {
    names: asked.filter(({ parts }) => parts).map(({ name, parts }) => ({ name, parts: [...parts] })),
    regions: asked.filter(({ parts }) => !parts).map(({ name, ...selection }) => ({ ...selection, action: partAction(name) })),
  };
}

/** @param {Naming} naming In words. */
export function namingWords({ name, parts }) {
  return parts.length > 1 ? `${parts.join(" and ")} together are “${name}”` : `${parts[0]} is “${name}”`;
}
