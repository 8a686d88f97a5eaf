/** The documents of the API, by their usual names. */
import type { components } from "./schema.js";

type Schemas = components["schemas"];

/** A request for a job, without its files. */
export type JobRequest = Omit<Schemas["JobDocument"], "asset" | "target" | "files">;
/** A request for a preview, without its files. */
export type PreviewRequest = Omit<Schemas["PreviewDocument"], "asset" | "target" | "files">;
/** A request for a job that begins with the shape of a checkpoint. */
export type BranchRequest = Schemas["BranchDocument"];
export type Job = Schemas["JobView"];
/** Jobs, newest first, and where those before them begin. */
export type JobPage = Schemas["JobList"];
export type JobState = Schemas["JobState"];
export type JobEvent = Schemas["EventView"];
export type Artifact = Schemas["ArtifactView"];
export type Checkpoint = Schemas["CheckpointView"];
export type Upload = Schemas["UploadView"];
export type Validation = Schemas["Validation"];
export type SignedUrl = Schemas["SignedUrl"];
export type Models = Schemas["ModelList"];
export type Limits = Schemas["LimitList"];
/** What was used in a month. */
export type UsageMonth = Schemas["UsageMonth"];
export type Parts = Schemas["FoundParts"];
export type SketchGuesses = Schemas["SketchGuesses"];
export type SketchGuess = Schemas["SketchGuess"];
/** A shape of a family, with its parameters by name. */
export type Sketch = Schemas["Sketch"];
/** A word of one's own. */
export type Word = Schemas["WordView"];
/** A word of one's own, with its meshes. */
export type WordDetail = Schemas["WordDetail"];
/** What a word of one's own is to be. */
export type WordRequest = Omit<Schemas["WordDocument"], "meshes">;
export type Params = Schemas["DeformParams"];

/** A file of the service: an upload, or an artifact of a job that has succeeded; or one that it fetches. */
export type FileReference = { upload_id: string } | { job_id: string; artifact?: string } | { url: string; filename?: string };

/** A file to send, or one that the service has. A `File` carries its own name. */
export type Asset = Blob | ArrayBuffer | Uint8Array<ArrayBuffer> | FileReference | Upload;

const TERMINAL: ReadonlySet<string> = new Set(["succeeded", "failed", "canceled", "expired"]);

/** Return whether nothing happens any more after this state, or after an event of this type. */
export function isTerminal(state: string): boolean {
  return TERMINAL.has(state);
}
