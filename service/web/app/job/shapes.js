// @ts-check
/**
 * The shapes that a job has had, oldest first: where it began, its checkpoints and its result.
 *
 * @typedef {object} Shape
 * @property {number} step
 * @property {string} path
 * @property {string} label What the slider says.
 * @property {string} name What a downloaded file says; empty: the result.
 */
import { client } from "../client.js";
import { count } from "../format.js";

const CACHE_BYTES = 96 << 20;

/** Whether a job deforms an asset: jobs of other kinds have files, but no result that stands for the asset. @param {any} job */
export function isDeformation(job) {
  return (job.kind ?? "text_deform") === "text_deform" && !job.unreadable;
}

/**
 * @param {any} job
 * @param {number[]} checkpoints Steps whose mesh is kept.
 * @param {number | null} lastStep Of the result; null where there is none.
 * @returns {Shape[]}
 */
export function shapesOf(job, checkpoints, lastStep) {
  const base = `v1/jobs/${job.id}`;
  const shapes = checkpoints
    .filter((step) => lastStep === null || !isDeformation(job) || step < lastStep)
    .map((step) => ({ step, path: `${base}/checkpoints/${step}/mesh.glb`, label: `Step ${count(step)}`, name: `step${step}` }));
  if (lastStep !== null && isDeformation(job)) shapes.push({ step: lastStep, path: `${base}/artifacts/result.glb`, label: "Result", name: "" });
  const { job_id: origin, step } = job.origin ?? {};
  if (!step) return shapes;
  const begin = { step: -1, path: `v1/jobs/${origin}/checkpoints/${step}/mesh.glb`, label: "Start", name: "start" };
  return [begin, ...shapes];
}

/** The bytes of shapes, as many as fit. */
export class ShapeCache {
  /** @param {import("../scope.js").Scope} scope */
  constructor(scope) {
    this.scope = scope;
    /** @type {Map<string, ArrayBuffer>} */
    this.known = new Map();
    scope.add(() => this.known.clear());
  }

  /** @param {string} path @returns {Promise<ArrayBuffer>} Not to be changed: others read it too. */
  async get(path) {
    return this.known.get(path) ?? this._keep(path, await client.bytes(path, { signal: this.scope.signal }));
  }

  /** @param {string} path @param {ArrayBuffer} mesh */
  _keep(path, mesh) {
    let held = mesh.byteLength;
    for (const buffer of this.known.values()) held += buffer.byteLength;
    for (const [old, buffer] of this.known) {
      if (held <= CACHE_BYTES) break;
      this.known.delete(old);
      held -= buffer.byteLength;
    }
    this.known.set(path, mesh);
    return mesh;
  }
}

