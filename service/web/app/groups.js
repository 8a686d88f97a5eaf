// @ts-check
/**
 * The groups of a request's parameters. The page knows each by its name alone, as reports and the answers to checks do;
 * `guidance` is then the kind of guidance, and left out for that by a prompt.
 *
 * @typedef {object} Groups The parameters of each group, as the server declares them.
 * @property {Record<string, any>} control
 * @property {Record<string, any>} input
 * @property {Record<string, Record<string, any>>} guidance By its kind.
 * @property {Record<string, string[]>} unused Parameters outside of the groups that a kind of guidance does without.
 */

/** @param {any} schema The JSON schema of a job's parameters; null: none are known. @returns {Groups} */
export function groupsOf(schema) {
  const members = (/** @type {{$ref: string}} */ { $ref }) => schema.$defs[/** @type {string} */ ($ref.split("/").at(-1))].properties;
  const { control, input, guidance } = schema?.properties ?? {};
  const named = (guidance?.oneOf ?? []).map(members).filter((/** @type {any} */ { kind }) => kind);
  const kinds = named.map((/** @type {any} */ { kind, ...others }) => [kind.const, others]);
  return { control: control ? members(control) : {}, input: input ? members(input) : {}, guidance: Object.fromEntries(kinds), unused: schema?.["x-unused"] ?? {} };
}

/** Parameters by their names alone. @param {any} params Of a job. @returns {Record<string, any>} */
export function plainParams(params) {
  const { guidance, control, input, ...others } = params ?? {};
  const { kind, ...members } = typeof guidance === "string" ? { kind: guidance } : (guidance ?? {});
  return { ...others, ...members, ...control, ...input, ...(kind && kind !== "sds" ? { guidance: kind } : {}) };
}

/**
 * Parameters in their groups, as a request has them; without those that its kind of guidance does not have.
 * @param {Record<string, any>} params By their names alone.
 * @param {Groups} groups
 * @returns {Record<string, any>}
 */
export function groupedParams({ guidance: kind = "sds", ...params }, groups) {
  /** @type {Record<string, any>} */
  const guidance = { kind };
  /** @type {[Record<string, any>, Record<string, any>, Record<string, any>]} */
  const [control, input, others] = [{}, {}, {}];
  for (const [name, value] of Object.entries(params)) {
    if (name in groups.control) control[name] = value;
    else if (name in groups.input) input[name] = value;
    else if (name in (groups.guidance[kind] ?? {})) guidance[name] = value;
    else if (!isUnused(name, kind, groups)) others[name] = value;
  }
  return { ...others, guidance, ...(Object.keys(control).length ? { control } : {}), ...(Object.keys(input).length ? { input } : {}) };
}

/** Whether a parameter is for other kinds of guidance alone. @param {string} name @param {string} kind @param {Groups} groups */
export function isUnused(name, kind, { guidance, unused }) {
  if (unused[kind]?.includes(name)) return true;
  return !(name in (guidance[kind] ?? {})) && Object.values(guidance).some((members) => name in members);
}

/** Which of the parameters the server refuses, and where in it, without its group. @param {any} error Of a problem document. @returns {any[]} */
export function fieldOf({ loc = [] }) {
  return loc.length > 2 && ["guidance", "control", "input"].includes(loc[1]) ? loc.slice(2) : loc.slice(1);
}
