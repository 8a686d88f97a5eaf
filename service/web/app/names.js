// @ts-check
/** Names of downloaded files that say what is in them. */

/** Words as they may stand in the name of a file. @param {string} text @param {number} longest */
export function slug(text, longest) {
  const plain = text.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "-");
  return plain.slice(0, longest + 1).replace(/^-+|-+$/g, "").slice(0, longest);
}

/** "duck-a-tall-vase-seed7": the asset, the prompt and the seed. @param {any} job */
export function stemOf(job) {
  const asset = slug(String(job.asset?.filename ?? "").replace(/\.[^.]*$/, ""), 30);
  const kinds = /** @type {Record<string, string>} */ ({ surface_fit: "field", family_fit: "family" });
  const prompt = slug(String(job.prompt ?? ""), 40) || (kinds[job.kind] ?? "target");
  return [asset || "asset", prompt, `seed${job.params?.seed ?? 0}`].join("-");
}

const ARTIFACTS = /** @type {Record<string, string>} */ ({
  "result.glb": ".glb",
  "result.stl": ".stl",
  "result.3mf": ".3mf",
  "result.usdz": ".usdz",
  "result.obj.zip": ".obj.zip",
  "morph.glb": "-animated.glb",
  "surface.ndf": ".ndf",
  "report.json": "-report.json",
  "preview.png": "-preview.png",
});

/** @param {any} job @param {string} artifact */
export function artifactName(job, artifact) {
  return stemOf(job) + (ARTIFACTS[artifact] ?? `-${artifact}`);
}

/**
 * "duck-a-tall-vase-seed7-step120-morph50.glb".
 * @param {any} job
 * @param {string} step Empty: the result.
 * @param {number} share In percent, of the way from the source to that step.
 */
export function shapeName(job, step, share) {
  const way = share === 100 ? "" : `${step ? "morph" : "strength"}${share}`;
  return `${[stemOf(job), step, way].filter(Boolean).join("-")}.glb`;
}
