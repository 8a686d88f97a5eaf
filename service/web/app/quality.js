// @ts-check
/**
 * What `report.json` says about the mesh, in words. A figure that the report lacks is left out, not guessed.
 *
 * @typedef {{tone: "good" | "warn" | "plain", text: string, note: string}} Finding
 */
import { fitFindings } from "./exemplar.js";
import { count, counted, figure, percent } from "./format.js";
import { isWorthLess } from "./verdict.js";
import { withArticle } from "./vocabulary.js";

// What a sixfold stretch one way and as much pressure the other way come to: textures show it.
const STRONG = 20;

// Texels that are more than twice as long as before are seen.
const MAGNIFIED = 2;

// How warnings of `meshdeform/runs/text_report.py` begin, and their titles; others are about the source.
const TITLES = [["The mesh hardly moved", "Hardly moved"], ["The safeguard held back", "Held back"]];

// How the warnings of `meshdeform/geometry/quality.py` begin that the figures here say as well.
const DAMAGED = "Damaged faces";

/** The side that became the front, if there was a choice. @param {any} orientation @returns {Finding[]} */
function front(orientation) {
  const turn = number(orientation?.turn_deg);
  if (turn === null) return [];
  if (orientation.source === "given") return [plain(`Front: the side at ${figure(turn)}°`, "As you set it. 0° is +Z, 90° is +X.")];
  if (orientation.source === "undecided") return [plain(`Front: the side at ${figure(orientation.turn_deg)}°`, "0° is +Z, 90° is +X. No side is clearly the front.")];
  if (orientation.source === "unrecognised") return [plain("Front: +Z", "The asset was not recognised, so that nothing said where its front is.")];
  return orientation.source === "found" ? [plain(`Front: the side at ${figure(turn)}°`, "0° is +Z, 90° is +X.")] : [];
}

/** What the asset was taken for, and what of its structure was kept. @param {any} source @param {any} carrier @returns {Finding[]} */
function kept(source, carrier) {
  const what = [carrier?.mirror ? `mirror symmetry across ${[...carrier.mirror].join(" and ")}` : "", carrier?.level ? "level and upright" : ""].filter(Boolean).join(", ");
  const structure = what ? `Kept: ${what}.` : "";
  if (!source?.recognised) return structure ? [plain("Structure", structure)] : [];
  return [plain(`Taken for: ${source.noun} ${percent(source.probability)}`, structure)];
}

/** What the model saw, where that is not what was asked for. @param {any} appearance @returns {Finding[]} */
function seen(appearance) {
  return typeof appearance?.notice === "string" && appearance.notice ? [plain("Seen as clay", appearance.notice)] : [];
}

/**
 * What was measured. Of a result that is not good nothing is marked as good.
 * @param {any} report
 * @param {Record<string, {filename: string}>} [files] Of the job, by the names of their parts.
 * @returns {Finding[]}
 */
export function findings(report, files = {}) {
  const worthLess = isWorthLess(report);
  const others = measured(report, worthLess, files);
  return worthLess ? others.map((each) => (each.tone === "good" ? plain(each.text, each.note) : each)) : others;
}

/** What was measured. @param {any} report @param {boolean} worthLess Whether the result is not good. @param {Record<string, {filename: string}>} files @returns {Finding[]} */
function measured(report, worthLess, files) {
  const quality = shownQuality(report);
  const mesh = report?.mesh ?? {};
  /** @type {Finding[]} */
  const found = [...likeness(report?.likeness), ...fitFindings(report, files), ...(worthLess ? [] : stillYours(quality)), ...fitted(report), ...regional(report?.prompts), ...kept(report?.source_noun, report?.carrier), ...front(report?.orientation), ...seen(report?.appearance)];
  if (Array.isArray(report?.warnings)) {
    const others = report.warnings.map(String).filter((/** @type {string} */ text) => !text.startsWith(DAMAGED));
    found.push(...others.map((/** @type {string} */ text) => warn(TITLES.find(([start]) => text.startsWith(start))?.[1] ?? "The source", text)));
  }
  if (Array.isArray(report?.input?.warnings)) {
    found.push(...report.input.warnings.map((/** @type {unknown} */ text) => plain("About your file", String(text))));
  }
  const faces = number(mesh.welded_faces) ?? number(mesh.source_triangles);
  const of = faces === null ? "" : ` of ${count(faces)}`;
  const flipped = number(quality.flipped_faces);
  if (flipped !== null) {
    found.push(
      flipped === 0
        ? good("No flipped faces", "No triangle folds over its neighbours.")
        : warn(`${counted(flipped, "flipped face")}${of}`, "They fold over their neighbours. A safeguard or a lower learning rate helps."),
    );
  }
  found.push(...crossings(quality));
  const collapsed = number(quality.collapsed_faces);
  if (collapsed !== null && collapsed > 0) {
    found.push(warn(`${counted(collapsed, "collapsed face")}${of}`, "They have almost no area left."));
  }
  const stretch = number(quality.symmetric_dirichlet_p99);
  if (stretch !== null) {
    const note = "1 means none (symmetric Dirichlet energy, 99th percentile).";
    const strong = stretch >= STRONG;
    found.push(strong ? warn(`Strong distortion: ${figure(stretch)}`, `${note} “Stretch” shows where.`) : plain(`Distortion ${figure(stretch)}`, note));
  }
  const texture = number(report?.texture_stretch?.p95);
  if (texture !== null) {
    const note = "1 means as in your asset (95th percentile, free of scale). “Texture” shows where.";
    found.push(texture > MAGNIFIED ? warn(`Texture stretched ${figure(texture)}×`, note) : plain(`Texture stretch ${figure(texture)}×`, note));
  }
  const before = number(quality.min_angle_p1_deg_before);
  const after = number(quality.min_angle_p1_deg_after);
  if (before !== null && after !== null) {
    found.push(plain(`Sharpest corners ${figure(after)}°`, `${figure(before)}° before (smallest angles, 1st percentile).`));
  }
  const volume = number(quality.volume_ratio);
  const area = number(quality.area_ratio);
  if (area !== null) {
    // 0: the asset encloses no volume.
    const space = !volume ? "" : `, volume ${figure(volume)}×`;
    found.push(plain(`Surface ${figure(area)}×${space}`, "Compared with your asset."));
  }
  if (mesh.same_faces === true) {
    const uvs = mesh.same_uvs === true ? " and UVs" : "";
    found.push(good(`Same triangles${uvs} as before`, "Materials, textures and hierarchy are unchanged."));
  }
  return found;
}

/** The figures of the shape that viewers show: a skin's in the pose of its file, not in its bind pose. @param {any} report */
export function shownQuality(report) {
  return report?.posed_quality ?? report?.quality ?? {};
}

/** @param {any} quality @returns {Finding[]} */
function stillYours(quality) {
  const share = number(quality.kept_share);
  return share === null ? [] : [plain(`Still your asset: ${percent(share)}`, "The share of the surface that kept its shape, if not its size.")];
}

/** How well a target, or the source of a surface fit, is met. @param {any} report @returns {Finding[]} */
function fitted(report) {
  const within = number(report?.fit?.within);
  const far = number(report?.levels?.at?.(-1)?.distance?.mean);
  const found = [];
  if (within !== null) {
    const note = "The share of the target that is within 1% of its diagonal of the result.";
    found.push((within >= 0.95 ? good : plain)(`Fits the target: ${percent(within)}`, note));
  }
  if (far !== null) found.push(plain(`Distance from your file ${figure(100 * far)}%`, "The mean at the finest level, of the diagonal."));
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

/** What the result looks like to a judge that knows the nouns of the built-in model. @param {any} judged @returns {Finding[]} */
function likeness(judged) {
  const share = number(judged?.probability);
  if (typeof judged?.noun !== "string" || share === null) return [];
  const next = number(judged.next?.probability) ?? 0;
  const other = typeof judged.next?.noun === "string" && (judged.matches === false || next >= 0.01) ? judged.next : null;
  const named = (/** @type {any} */ one) => `${withArticle(one.noun)} ${percent(one.probability)}`;
  const nouns = number(judged.nouns);
  const judge = nouns === null ? "" : ` The judge knows ${count(nouns)} nouns.`;
  if (judged.matches === false && other !== null) {
    const note = `It does not look like its prompt.${judge}`;
    return [warn(`Looks more like ${named(other)} than ${named(judged)}`, note)];
  }
  return [good(`Looks like: ${named(judged)}${other === null ? "" : `; next: ${named(other)}`}`, `As the prompt says, judged from pictures.${judge}`)];
}

/** What the regions of further prompts look like, cut out. Never a warning: often only the whole shows the prompt. @param {any} prompts @returns {Finding[]} */
function regional(prompts) {
  const found = Array.isArray(prompts) ? prompts.filter((each) => each?.regions?.length && number(each.likeness?.probability) !== null) : [];
  return found.map(({ prompt, likeness: { probability, before } }) => {
    const earlier = number(before?.probability) === null ? "" : `, ${percent(before.probability)} before`;
    return plain(`The region of “${prompt}” looks like it: ${percent(probability)}${earlier}`, "Judged from pictures of the region cut out, which may show less than the whole.");
  });
}

/** @param {any} quality @returns {Finding[]} */
function crossings(quality) {
  const before = number(quality.self_intersecting_faces_before);
  const after = number(quality.self_intersecting_faces_after);
  const added = number(quality.self_intersections_added);
  if (after === null) return [];
  if (after === 0) return [good("No self-intersections", "The surface doesn't cut through itself.")];
  if (added === 0 || (added === null && before !== null && after <= before)) {
    return [plain(counted(after, "self-intersecting face"), before === null ? "None is new." : `Your asset had ${count(before)}.`)];
  }
  return [warn(counted(after, "self-intersecting face"), before === null ? "" : `Your asset had ${count(before)}.`)];
}

/** Defects of the asset that the deformation leaves out. @param {any} report @returns {string[]} */
export function skipped(report) {
  const found = report?.skipped ?? {};
  const words = /** @type {[string, string][]} */ ([
    ["unreferenced_vertices", "unused vertex|unused vertices"],
    ["degenerate_faces", "degenerate face|degenerate faces"],
    ["zero_area_faces", "zero-area face|zero-area faces"],
    ["non_manifold_edges", "non-manifold edge|non-manifold edges"],
    ["border_edges", "open edge|open edges"],
  ]);
  return words.flatMap(([name, text]) => {
    const value = number(found[name]);
    const [singular, plural] = text.split("|");
    return value ? [counted(value, singular, plural)] : [];
  });
}

/** @param {unknown} value */
function number(value) {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}

/** @type {(text: string, note: string) => Finding} */
const good = (text, note) => ({ tone: "good", text, note });
/** @type {(text: string, note: string) => Finding} */
const warn = (text, note) => ({ tone: "warn", text, note });
/** @type {(text: string, note: string) => Finding} */
const plain = (text, note) => ({ tone: "plain", text, note });
