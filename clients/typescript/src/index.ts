/** A client of Meshdeform, which reshapes 3D assets with a prompt. */
export { Client, type JobFilter, type JobLike, type Preview, type PreviewOptions, type SubmitOptions, type WaitOptions } from "./client.js";
export { MeshdeformError, type Problem } from "./errors.js";
export type { WatchOptions } from "./events.js";
export { packMeshes } from "./meshes.js";
export { readPreview, type PreviewShape, type PreviewShapes, type PrimitivePositions } from "./previews.js";
export type { Call, Options, Retry } from "./transport.js";
export * from "./types.js";
export type { UploadOptions } from "./uploads.js";
export { readVerdict, type Verdict, type VerdictValue } from "./verdicts.js";
