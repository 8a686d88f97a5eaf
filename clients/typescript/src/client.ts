import { MeshdeformError } from "./errors.js";
import { events, type WatchOptions } from "./events.js";
import { type Call, newKey, type Options, Transport } from "./transport.js";
import {
  type Artifact, type Asset, type BranchRequest, type Checkpoint, type FileReference, isTerminal, type Job, type JobEvent, type JobPage, type JobRequest,
  type JobState, type Limits, type Models, type Parts, type PreviewRequest, type SignedUrl, type Sketch, type SketchGuesses, type Upload, type UsageMonth, type Validation, type Word,
  type WordDetail, type WordRequest,
} from "./types.js";
import { canUpload, upload, type UploadOptions } from "./uploads.js";
import { readVerdict, type Verdict } from "./verdicts.js";

/** A job, or its id. */
export type JobLike = string | { id: string };

export interface SubmitOptions {
  /** More files of the job, by the names of its kind's parts: `target`, `silhouette_1` and so on. */
  files?: Record<string, Asset>;
  /** The name to send with an asset that is no `File`; its extension tells OBJ, PLY and STL apart. */
  filename?: string;
  /** Requests with the same key within a day make one job, also from another process. */
  idempotencyKey?: string;
  signal?: AbortSignal;
}

export interface PreviewOptions extends Omit<SubmitOptions, "idempotencyKey"> {
  /** `positions` (the default) of all seeds, for `readPreview`; or `glb`: the `result.glb` of one seed. */
  as?: "positions" | "glb";
  /** Whether a draft will do, before it is mended; `draft` of the answer says whether it is one. */
  draft?: boolean;
}

export interface Preview {
  data: ArrayBuffer;
  /** Whether a simplified surface was fitted in place of a large asset's. */
  draft: boolean;
  /** SHA-256 of the asset, by which the next preview can name it: `{ sha256 }`. */
  asset: string;
}

/** Which jobs to list. */
export interface JobFilter {
  state?: JobState;
  /** Words that all occur in the prompt, a file's name or a label. */
  search?: string;
  metadata?: Record<string, string>;
  signal?: AbortSignal;
}

export interface WaitOptions {
  /** Longest wait in milliseconds. Default: no limit. */
  timeoutMs?: number;
  /** Called with every event as it happens. */
  onEvent?: (event: JobEvent) => void;
  signal?: AbortSignal;
}

/** Larger files are uploaded before their job, in pieces. */
const UPLOAD_ABOVE = 1 << 20;
const LONGEST_HOLD_S = 30;

/**
 * A client of one service, for browsers and Node.js. Every method throws a `MeshdeformError`, or the reason of its `signal`.
 *
 * ```ts
 * const client = new Client({ baseUrl: "https://meshdeform.example", apiKey });
 * const job = await client.submit(file, { prompt: "a mushroom" });
 * for await (const event of client.watch(job)) console.log(event.type, event.data);
 * const glb = await client.download(job, "result.glb");
 * ```
 */
export class Client {
  readonly #transport: Transport;

  constructor(options: Options = {}) {
    this.#transport = new Transport(options);
  }

  get baseUrl(): string {
    return this.#transport.baseUrl;
  }

  /** Return the address of a path of the service, as it names them itself. */
  url(path: string): string {
    return this.#transport.url(path);
  }

  /**
   * Send a request to any path of the service, and return the successful response. It is repeated as all requests are, so it must be safe
   * to repeat: with an `Idempotency-Key` where it would do something twice, or with `once`.
   */
  request(path: string, call: Call = {}): Promise<Response> {
    return this.#transport.request(path, call);
  }

  /** Send a request to any path of the service, and return the document of the answer. */
  json<T = any>(path: string, call: Call = {}): Promise<T> {
    return this.#transport.json<T>(path, call);
  }

  /** Send a request to any path of the service, and return the bytes of the answer. */
  bytes(path: string, call: Call = {}): Promise<ArrayBuffer> {
    return this.#transport.read(path, call, (response) => response.arrayBuffer());
  }

  /** Post a job. It is made once, even if the request has to be repeated. A job of a kind without an `asset` has null there and all in `options.files`. */
  async submit(asset: Asset | null, request: JobRequest, options: SubmitOptions = {}): Promise<Job> {
    const body = await this.#body(asset, request, options);
    const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
    return this.#transport.json<Job>("v1/jobs", { method: "POST", ...body, headers, signal: options.signal });
  }

  /** Check a job without posting it: what the asset holds, all parameters, and an estimate of the time. */
  async validate(asset: Asset | null, request: JobRequest, options: SubmitOptions = {}): Promise<Validation> {
    const body = await this.#body(asset, request, options);
    return this.#transport.json<Validation>("v1/jobs:validate", { method: "POST", ...body, signal: options.signal });
  }

  /** List the parts of an asset that words can name; with a prompt that is a change, those that it names and what it makes. */
  async parts(asset: Asset, request: JobRequest, options: SubmitOptions = {}): Promise<Parts> {
    const body = await this.#body(asset, request, options);
    return this.#transport.json<Parts>("v1/jobs:parts", { method: "POST", ...body, signal: options.signal });
  }

  /**
   * Make what a job would, in seconds and without one. An asset that was sent with an earlier preview can be named by its hash, until that is
   * refused with `asset_not_kept`. The request is not repeated by itself: whoever looks on may want something else by then.
   */
  async preview(asset: Asset | { sha256: string; filename?: string }, request: PreviewRequest, options: PreviewOptions = {}): Promise<Preview> {
    const { as = "positions", draft = false, ...more } = options;
    const kept = "sha256" in asset && !("id" in asset);
    const body = kept && !more.files ? { json: { ...request, asset } } : await this.#body(kept ? null : asset, kept ? ({ ...request, asset } as PreviewRequest) : request, more);
    const response = await this.#transport.request(`v1/jobs:preview?as=${as}&draft=${draft}`, { method: "POST", ...body, signal: options.signal, once: true });
    const { headers } = response;
    return { data: await response.arrayBuffer(), draft: headers.get("Meshdeform-Draft") === "true", asset: headers.get("Meshdeform-Asset") ?? "" };
  }

  /** Guess what a drawing shows: nouns with their sliders, and a mesh each as a GLB in base64. */
  async guessSketch(drawing: Blob | ArrayBuffer | Uint8Array<ArrayBuffer>, options: { noun?: string; signal?: AbortSignal } = {}): Promise<SketchGuesses> {
    const query = options.noun ? `?noun=${encodeURIComponent(options.noun)}` : "";
    const headers = { "Content-Type": "application/octet-stream" };
    const body = named(drawing).blob;
    return this.#transport.json<SketchGuesses>(`v1/sketches:guess${query}`, { method: "POST", body, headers, signal: options.signal });
  }

  /** Make a shape of a noun, as a GLB. */
  async makeSketchMesh(sketch: Sketch, signal?: AbortSignal): Promise<ArrayBuffer> {
    return this.bytes("v1/sketches:mesh", { method: "POST", json: sketch, signal });
  }

  /** Upload a file for any number of jobs. */
  async upload(file: Blob | ArrayBuffer | Uint8Array<ArrayBuffer>, options: UploadOptions = {}): Promise<Upload> {
    const { blob, filename } = named(file, options.filename);
    return upload(this.#transport, blob, filename, options);
  }

  /** Read a job's state. */
  async get(job: JobLike, signal?: AbortSignal): Promise<Job> {
    return this.#transport.json<Job>(path(job), { signal });
  }

  /** Iterate over the jobs, newest first. */
  async *jobs(filter: JobFilter = {}): AsyncGenerator<Job> {
    for (let cursor: string | null | undefined; cursor !== null; ) {
      const page: JobPage = await this.jobPage({ ...filter, ...(cursor ? { cursor } : {}) });
      yield* page.jobs;
      cursor = page.next_cursor ?? null;
    }
  }

  /** List up to `limit` jobs, newest first, from the `next_cursor` of the page before on. */
  jobPage(options: JobFilter & { limit?: number; cursor?: string } = {}): Promise<JobPage> {
    const query = new URLSearchParams({ limit: String(options.limit ?? 50) });
    if (options.state) query.set("state", options.state);
    if (options.search) query.set("q", options.search);
    for (const [name, value] of Object.entries(options.metadata ?? {})) query.set(`metadata[${name}]`, value);
    if (options.cursor) query.set("cursor", options.cursor);
    return this.#transport.json<JobPage>(`v1/jobs?${query}`, { signal: options.signal });
  }

  /** Iterate over a job's events as they happen, each once and in order, reconnecting as needed, until the job has ended. */
  watch(job: JobLike, options: WatchOptions = {}): AsyncGenerator<JobEvent> {
    return events(this.#transport, id(job), options);
  }

  /** Wait until a job has succeeded. A job that did not is thrown as an error. */
  async wait(job: JobLike, options: WaitOptions = {}): Promise<Job> {
    const { timeoutMs, onEvent } = options;
    const late = timeoutMs === undefined ? null : AbortSignal.timeout(timeoutMs);
    const signals = [options.signal, late].filter((signal) => signal !== undefined && signal !== null);
    const signal = signals.length ? AbortSignal.any(signals) : undefined;
    try {
      if (onEvent) for await (const event of this.watch(job, signal ? { signal } : {})) onEvent(event);
      for (;;) {
        const headers = { Prefer: `wait=${LONGEST_HOLD_S}` };
        const found = await this.#transport.json<Job>(path(job), { headers, signal });
        if (isTerminal(found.state)) return succeeded(found);
      }
    } catch (failure) {
      options.signal?.throwIfAborted();
      if (!late?.aborted || failure instanceof MeshdeformError) throw failure;
      const detail = `The job ${id(job)} has not finished in time.`;
      throw new MeshdeformError(0, { code: "wait_timeout", detail, advice: "It goes on: wait again, or cancel it.", job_id: id(job) });
    }
  }

  /** Post a job and wait until it has succeeded; then download what you need. */
  async deform(asset: Asset | null, request: JobRequest, options: SubmitOptions & WaitOptions = {}): Promise<Job> {
    return this.wait(await this.submit(asset, request, options), options);
  }

  /** Request cancellation. */
  async cancel(job: JobLike, signal?: AbortSignal): Promise<Job> {
    return this.#transport.json<Job>(path(job, "cancel"), { method: "POST", signal });
  }

  /** Delete a job that has ended, with its artifacts. */
  async delete(job: JobLike, signal?: AbortSignal): Promise<void> {
    await this.#transport.request(path(job), { method: "DELETE", signal });
  }

  /** Try a job that did not succeed again, as a new job that continues from its last checkpoint and may run for `maxRunS` seconds; default: as for the old one. */
  async retry(job: JobLike, options: { maxRunS?: number; idempotencyKey?: string; signal?: AbortSignal } = {}): Promise<Job> {
    const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
    const json = options.maxRunS === undefined ? undefined : { max_run_s: options.maxRunS };
    return this.#transport.json<Job>(path(job, "retry"), { method: "POST", json, headers, signal: options.signal });
  }

  /** Post a job on the same asset that begins with the shape of a checkpoint. */
  async branch(job: JobLike, step: number, request: BranchRequest, options: { idempotencyKey?: string; signal?: AbortSignal } = {}): Promise<Job> {
    const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
    const call = { method: "POST", json: request, headers, signal: options.signal };
    return this.#transport.json<Job>(path(job, `checkpoints/${step}/branch`), call);
  }

  /** List the shapes from which a job can continue. */
  async checkpoints(job: JobLike, signal?: AbortSignal): Promise<Checkpoint[]> {
    return (await this.#transport.json<{ checkpoints: Checkpoint[] }>(path(job, "checkpoints"), { signal })).checkpoints;
  }

  /** List a job's artifacts. */
  async artifacts(job: JobLike, signal?: AbortSignal): Promise<Artifact[]> {
    return (await this.#transport.json<{ artifacts: Artifact[] }>(path(job, "artifacts"), { signal })).artifacts;
  }

  /** Make `morph.glb`, `map.safetensors` or another format of the result; `warnings` says what that cannot hold. */
  async make(job: JobLike, name: string, signal?: AbortSignal): Promise<Artifact> {
    return this.#transport.json<Artifact>(path(job, `artifacts/${encodeURIComponent(name)}`), { method: "POST", signal });
  }

  /** Deform another file as a job's asset was: a level of detail, clothes, a prop. Returns a GLB. */
  async apply(job: JobLike, file: Blob | ArrayBuffer | Uint8Array<ArrayBuffer>, options: { filename?: string; outside?: "refuse" | "rigid"; signal?: AbortSignal } = {}): Promise<ArrayBuffer> {
    const { blob, filename } = named(file, options.filename);
    const query = new URLSearchParams({ filename, outside: options.outside ?? "refuse" });
    const headers = { "Content-Type": "application/octet-stream" };
    return this.bytes(path(job, `apply?${query}`), { method: "POST", body: blob, headers, signal: options.signal });
  }

  /** Download an artifact; `result.glb` at any strength from 0 to 1.5, and it and its other formats in a pose, `CLIP@SECONDS`. */
  async download(job: JobLike, name = "result.glb", options: { strength?: number; pose?: string; signal?: AbortSignal } = {}): Promise<Blob> {
    const { strength, pose } = options;
    const asked = Object.entries({ strength, pose }).filter(([, value]) => value !== undefined);
    const query = asked.length ? `?${new URLSearchParams(asked.map(([key, value]) => [key, String(value)]))}` : "";
    return this.#blob(path(job, `artifacts/${encodeURIComponent(name)}${query}`), options.signal);
  }

  /** Return what the result of a deformation is worth by its report; null where the report does not say. */
  async verdict(job: JobLike, signal?: AbortSignal): Promise<Verdict | null> {
    return readVerdict(await this.json(path(job, "artifacts/report.json"), { signal }));
  }

  /** Download a file that was sent with a job. */
  async file(job: JobLike, part = "asset", signal?: AbortSignal): Promise<Blob> {
    return this.#blob(path(job, `files/${encodeURIComponent(part)}`), signal);
  }

  /** Return a URL of an artifact that needs no key and expires. */
  async signedUrl(job: JobLike, name = "result.glb", signal?: AbortSignal): Promise<SignedUrl> {
    const found = await this.#transport.json<SignedUrl>(path(job, `artifacts/${encodeURIComponent(name)}/url`), { method: "POST", signal });
    return { ...found, url: this.url(found.url) };
  }

  /** Return a link to a job's page: whoever has it can watch this job and read its files, without a key, until it expires. */
  async jobLink(job: JobLike, signal?: AbortSignal): Promise<SignedUrl> {
    const found = await this.#transport.json<SignedUrl>(path(job, "url"), { method: "POST", signal });
    return { ...found, url: this.url(found.url) };
  }

  /** Make a word of your own of meshes, or of ZIPs of several; your prompts can name it at once. */
  async addWord(meshes: Asset[], request: WordRequest, options: { idempotencyKey?: string; signal?: AbortSignal } = {}): Promise<Word> {
    const form = new FormData();
    const stored: FileReference[] = [];
    for (const [at, mesh] of meshes.entries()) {
      if (!isData(mesh)) stored.push(reference(mesh));
      else {
        const { blob, filename } = named(mesh);
        form.append("meshes", blob, mesh instanceof Blob ? filename : `mesh-${at + 1}.glb`);
      }
    }
    const [word] = await this.#words(form, { ...request, meshes: stored }, options);
    return word!;
  }

  /** Keep the words of a file that `exportWord` or the command line wrote, all or none. */
  async importWords(file: Blob, options: { replace?: boolean; idempotencyKey?: string; signal?: AbortSignal } = {}): Promise<Word[]> {
    const form = new FormData();
    form.append("word", file, "some.word");
    return this.#words(form, { replace: options.replace ?? false }, options);
  }

  /** List your words. */
  async words(signal?: AbortSignal): Promise<Word[]> {
    return (await this.#transport.json<{ words: Word[] }>("v1/words", { signal })).words;
  }

  /** Read a word of yours, with its meshes. */
  async word(noun: string, signal?: AbortSignal): Promise<WordDetail> {
    return this.#transport.json<WordDetail>(wordPath(noun), { signal });
  }

  /** Return a word's file. */
  async exportWord(noun: string, signal?: AbortSignal): Promise<Blob> {
    return this.#blob(`${wordPath(noun)}/content`, signal);
  }

  /** Return a PNG of a word's meshes, coloured by their parts. */
  async drawWord(noun: string, signal?: AbortSignal): Promise<Blob> {
    return this.#blob(`${wordPath(noun)}/picture.png`, signal);
  }

  /** Delete a word. Jobs that have it keep it. */
  async deleteWord(noun: string, signal?: AbortSignal): Promise<void> {
    await this.#transport.request(wordPath(noun), { method: "DELETE", signal });
  }

  /** Return what your jobs have used in each month, newest first. */
  async usage(signal?: AbortSignal): Promise<UsageMonth[]> {
    return (await this.#transport.json<{ months: UsageMonth[] }>("v1/usage", { signal })).months;
  }

  async models(signal?: AbortSignal): Promise<Models> {
    return this.#transport.json<Models>("v1/models", { signal });
  }

  async limits(signal?: AbortSignal): Promise<Limits> {
    return this.#transport.json<Limits>("v1/limits", { signal });
  }

  async #words(form: FormData, request: object, options: { idempotencyKey?: string; signal?: AbortSignal }): Promise<Word[]> {
    form.append("request", new Blob([JSON.stringify(request)], { type: "application/json" }));
    const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
    const call = { method: "POST", body: form, headers, signal: options.signal };
    return (await this.#transport.json<{ words: Word[] }>("v1/words", call)).words;
  }

  /** Upload a file before its job; null where the service takes uploads at a host that this client keeps away from. */
  async #ahead(blob: Blob, filename: string, signal: AbortSignal | undefined): Promise<Upload | null> {
    try {
      return await upload(this.#transport, blob, filename, signal ? { signal } : {});
    } catch (failure) {
      if (failure instanceof MeshdeformError && failure.code === "upload_elsewhere") return null;
      throw failure;
    }
  }

  #blob(path: string, signal?: AbortSignal): Promise<Blob> {
    return this.#transport.read(path, { signal }, (response) => response.blob());
  }

  /** Return the body of a job: a form with the files, or a document that names files of the service. */
  async #body(asset: Asset | null, request: JobRequest, options: SubmitOptions): Promise<{ json: unknown } | { body: FormData }> {
    const given = Object.entries({ ...(asset ? { asset } : {}), ...options.files });
    const sent: [string, Blob, string][] = [];
    const known: Record<string, FileReference> = {};
    for (const [part, file] of given) {
      if (!isData(file)) {
        known[part] = reference(file);
        continue;
      }
      const { blob, filename } = named(file, part === "asset" ? options.filename : undefined);
      const ahead = blob.size > UPLOAD_ABOVE && canUpload() ? await this.#ahead(blob, filename, options.signal) : null;
      if (ahead) known[part] = { upload_id: ahead.id };
      else sent.push([part, blob, filename]);
    }
    const document = Object.keys(known).length ? { ...request, files: known } : request;
    if (!sent.length) return { json: document };
    const form = new FormData();
    for (const [part, blob, filename] of sent) form.append(part, blob, filename);
    form.append("request", new Blob([JSON.stringify(document)], { type: "application/json" }));
    return { body: form };
  }
}

function id(job: JobLike): string {
  const found = typeof job === "string" ? job : job.id;
  if (!found) throw new TypeError("A job needs an id.");
  return encodeURIComponent(found);
}

function path(job: JobLike, rest = ""): string {
  return `v1/jobs/${id(job)}${rest && `/${rest}`}`;
}

function wordPath(noun: string): string {
  if (!noun) throw new TypeError("A word needs a noun.");
  return `v1/words/${encodeURIComponent(noun)}`;
}

function isData(file: Asset): file is Blob | ArrayBuffer | Uint8Array<ArrayBuffer> {
  return file instanceof Blob || file instanceof ArrayBuffer || ArrayBuffer.isView(file);
}

function reference(file: FileReference | Upload): FileReference {
  return "id" in file ? { upload_id: file.id } : file;
}

function named(file: Blob | ArrayBuffer | Uint8Array<ArrayBuffer>, filename?: string): { blob: Blob; filename: string } {
  const blob = file instanceof Blob ? file : new Blob([file]);
  return { blob, filename: filename ?? (typeof File !== "undefined" && file instanceof File ? file.name : "asset.glb") };
}

function succeeded(job: Job): Job {
  if (job.state === "succeeded") return job;
  const problem = job.error ?? { code: `job_${job.state}`, detail: `The job ${job.id} was ${job.state === "expired" ? "not finished in time" : "canceled"}.` };
  throw new MeshdeformError(0, { ...problem, job_id: job.id });
}
