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
import { count } from "../format.js";

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
