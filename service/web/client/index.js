/** A client of Meshdeform, which reshapes 3D assets with a prompt. */
export { Client } from "./client.js";
export { MeshdeformError } from "./errors.js";
export { packMeshes } from "./meshes.js";
export { readPreview } from "./previews.js";
export * from "./types.js";
export { readVerdict } from "./verdicts.js";
