// @ts-check
/**
 * What `report.json` says about the result, in words; its figures stay in the file. What the report lacks is left out, not
 * guessed. Why the result is worth what it is stands elsewhere.
 *
 * @typedef {{tone: "good" | "warn" | "plain", text: string, note: string}} Finding
 *
 * @typedef {object} Fit An entry of `exemplars`, as far as it is said here.
 * @property {{noun?: string, form?: string, pose?: string, attributes?: string[], way?: string}} [member] The shape. `way`: "mould",
 *   of an asset without parts, or else how it was fitted.
 * @property {string | null} [target] The part with the target mesh that was taken.
 * @property {number} [kept] Share of the way that was left when folds and cuts were mended.
 * @property {string[]} [left_over] Parts that only the asset has.
 * @property {string[]} [missing] Parts that only the shape has.
 */
import { count, counted, figure, percent } from "./format.js";
import { plainWords } from "./plain.js";
import { isWorthLess } from "./verdict.js";
import { withArticle } from "./vocabulary.js";

const POSES = /** @type {Record<string, string>} */ ({ folded: "wings folded", spread: "wings spread" });
// Texels that are more than twice as long as before are seen.
const MAGNIFIED = 2;
// How warnings of `meshdeform/geometry/quality.py` begin that the figures here say as well.
const DAMAGED = "Damaged faces";

/**
 * Of a result that is not good nothing is marked as good.
 * @param {any} report
 * @param {Record<string, {filename: string}>} [files] Of the job, by their names in it.
 * @returns {Finding[]}
 */
export function findings(report, files = {}) {
  const worthLess = isWorthLess(report);
  const found = [...likeness(report?.likeness), ...fits(report, files), ...met(report), ...warned(report), ...mesh(report)];
  return found.map((each) => (worthLess && each.tone === "good" ? plain(each.text, each.note) : each));
}

/** What the result looks like to a judge of pictures. @param {any} judged */
function likeness(judged) {
  const share = number(judged?.probability);
  if (typeof judged?.noun !== "string" || share === null) return [];
  const named = (/** @type {any} */ one) => `${withArticle(one.noun)} ${percent(one.probability)}`;
  const next = typeof judged.next?.noun === "string" ? judged.next : null;
  if (judged.matches === false && next) return [warn(`Looks more like ${named(next)} than ${named(judged)}`)];
  return [good(`Looks like: ${named(judged)}`, "As the prompt says, judged from pictures.")];
}

/** To what shapes the asset was fitted. @param {any} report @param {Record<string, {filename: string}>} files */
function fits(report, files) {
  /** @type {Fit[]} */
  const all = Array.isArray(report?.exemplars) ? report.exemplars : [];
  return all.map((fit) => {
    const { member = {}, target, kept, left_over: left = [], missing = [] } = fit;
    const shape = target ? (files[target]?.filename ?? "a target mesh") : memberWords(member);
    const way = typeof kept === "number" ? `: ${percent(kept)} of the way` : "";
    const notes = [left.length ? `Only your asset has: ${[...new Set(left)].join(", ")}.` : "", missing.length ? `Only that shape has: ${[...new Set(missing)].join(", ")}.` : ""];
    return plain(`${member.way === "mould" ? "Moulded into" : "Fitted to"} ${shape}${way}`, notes.filter(Boolean).join(" "));
  });
}

/** "a fat giraffe, lying". @param {NonNullable<Fit["member"]>} member */
function memberWords({ noun = "shape", form = noun, pose, attributes = [] }) {
  const kind = form.replaceAll("-", " ");
  // Attributes of parts are two words.
  const words = withArticle([...attributes.filter((each) => !each.includes(" ")), kind.endsWith(noun) ? kind : noun].join(" "));
  return pose ? `${words}, ${POSES[pose] ?? pose}` : words;
}

/** How well a target, or the source of a surface fit, is met. @param {any} report */
function met(report) {
  const within = number(report?.fit?.within);
  const far = number(report?.levels?.at?.(-1)?.distance?.mean);
  return [
    ...(within === null ? [] : [(within >= 0.95 ? good : plain)(`Fits the target: ${percent(within)}`, "The share of the target that is within 1% of its diagonal of the result.")]),
    ...(far === null ? [] : [plain(`Distance from your file ${figure(100 * far)}%`, "The mean at the finest level, of the diagonal.")]),
  ];
}

/** @param {any} report */
function warned(report) {
  const own = (Array.isArray(report?.warnings) ? report.warnings : []).map(String).filter((/** @type {string} */ text) => !text.startsWith(DAMAGED));
  const file = plainWords(Array.isArray(report?.input?.warnings) ? report.input.warnings.join(" ") : "");
  return [...own.map((/** @type {string} */ text) => warn(text)), ...(file ? [plain("About your file", file)] : [])];
}

/** The mesh that viewers show: a skin's in the pose of its file, not in its bind pose. @param {any} report */
function mesh(report) {
  const quality = report?.posed_quality ?? report?.quality ?? {};
  const [flipped, crossing] = [number(quality.flipped_faces), number(quality.self_intersecting_faces_after)];
  const before = number(quality.self_intersecting_faces_before);
  const added = number(quality.self_intersections_added) ?? Math.max(0, (crossing ?? 0) - (before ?? 0));
  const texture = number(report?.texture_stretch?.p95) ?? 0;
  /** @type {Finding[]} */
  const found = [];
  if (flipped !== null) found.push(flipped ? warn(counted(flipped, "flipped face"), "They fold over their neighbours.") : good("No flipped faces"));
  if (crossing === 0) found.push(good("No self-intersections"));
  else if (crossing !== null) found.push((added ? warn : plain)(counted(crossing, "self-intersecting face"), before === null ? "" : `Your asset had ${count(before)}.`));
  if (texture > MAGNIFIED) found.push(warn(`Texture stretched ${figure(texture)}×`));
  if (report?.mesh?.same_faces === true) found.push(good(`Same triangles${report.mesh.same_uvs === true ? " and UVs" : ""} as before`));
  return found;
}

/** What of a new shape of a family hangs apart, and which member it is most like. @param {any} shape */
export function shapeWords({ nearest_members: nearest, loose = [], parts = [] }) {
  const gap = Math.max(0, ...parts.map((/** @type {any} */ part) => number(part.gap) ?? 0));
  return [
    loose.length ? `loose: ${loose.join(", ")}` : "",
    gap > 0.01 ? `parts up to ${percent(gap)} apart` : "",
    `most like ${nearest[0].name}`,
  ].filter(Boolean).join("; ");
}

/** @param {unknown} value */
function number(value) {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}

/** @type {(text: string, note?: string) => Finding} */
const good = (text, note = "") => ({ tone: "good", text, note });
/** @type {(text: string, note?: string) => Finding} */
const warn = (text, note = "") => ({ tone: "warn", text, note });
/** @type {(text: string, note?: string) => Finding} */
const plain = (text, note = "") => ({ tone: "plain", text, note });
