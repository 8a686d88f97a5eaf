import { MeshdeformError } from "./errors.js";
import { events } from "./events.js";
import { newKey, Transport } from "./transport.js";
import { isTerminal, } from "./types.js";
import { canUpload, upload } from "./uploads.js";
import { readVerdict } from "./verdicts.js";
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
    #transport;
    constructor(options = {}) {
        this.#transport = new Transport(options);
    }
    get baseUrl() {
        return this.#transport.baseUrl;
    }
    /** Return the address of a path of the service, as it names them itself. */
    url(path) {
        return this.#transport.url(path);
    }
    /**
     * Send a request to any path of the service, and return the successful response. It is repeated as all requests are, so it must be safe
     * to repeat: with an `Idempotency-Key` where it would do something twice, or with `once`.
     */
    request(path, call = {}) {
        return this.#transport.request(path, call);
    }
    /** Send a request to any path of the service, and return the document of the answer. */
    json(path, call = {}) {
        return this.#transport.json(path, call);
    }
    /** Send a request to any path of the service, and return the bytes of the answer. */
    bytes(path, call = {}) {
        return this.#transport.read(path, call, (response) => response.arrayBuffer());
    }
    /** Post a job. It is made once, even if the request has to be repeated. A job of a kind without an `asset` has null there and all in `options.files`. */
    async submit(asset, request, options = {}) {
        const body = await this.#body(asset, request, options);
        const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
        return this.#transport.json("v1/jobs", { method: "POST", ...body, headers, signal: options.signal });
    }
    /** Check a job without posting it: what the asset holds, all parameters, and an estimate of the time. */
    async validate(asset, request, options = {}) {
        const body = await this.#body(asset, request, options);
        return this.#transport.json("v1/jobs:validate", { method: "POST", ...body, signal: options.signal });
    }
    /** List the parts of an asset that words can name; with a prompt that is a change, those that it names and what it makes. */
    async parts(asset, request, options = {}) {
        const body = await this.#body(asset, request, options);
        return this.#transport.json("v1/jobs:parts", { method: "POST", ...body, signal: options.signal });
    }
    /**
     * Make what a job would, in seconds and without one. An asset that was sent with an earlier preview can be named by its hash, until that is
     * refused with `asset_not_kept`. The request is not repeated by itself: whoever looks on may want something else by then.
     */
    async preview(asset, request, options = {}) {
        const { as = "positions", draft = false, ...more } = options;
        const kept = "sha256" in asset && !("id" in asset);
        const body = kept && !more.files ? { json: { ...request, asset } } : await this.#body(kept ? null : asset, kept ? { ...request, asset } : request, more);
        const response = await this.#transport.request(`v1/jobs:preview?as=${as}&draft=${draft}`, { method: "POST", ...body, signal: options.signal, once: true });
        const { headers } = response;
        return { data: await response.arrayBuffer(), draft: headers.get("Meshdeform-Draft") === "true", asset: headers.get("Meshdeform-Asset") ?? "" };
    }
    /** Guess what a drawing shows: nouns with their sliders, and a mesh each as a GLB in base64. */
    async guessSketch(drawing, options = {}) {
        const query = options.noun ? `?noun=${encodeURIComponent(options.noun)}` : "";
        const headers = { "Content-Type": "application/octet-stream" };
        const body = named(drawing).blob;
        return this.#transport.json(`v1/sketches:guess${query}`, { method: "POST", body, headers, signal: options.signal });
    }
    /** Make a shape of a noun, as a GLB. */
    async makeSketchMesh(sketch, signal) {
        return this.bytes("v1/sketches:mesh", { method: "POST", json: sketch, signal });
    }
    /** Upload a file for any number of jobs. */
    async upload(file, options = {}) {
        const { blob, filename } = named(file, options.filename);
        return upload(this.#transport, blob, filename, options);
    }
    /** Read a job's state. */
    async get(job, signal) {
        return this.#transport.json(path(job), { signal });
    }
    /** Iterate over the jobs, newest first. */
    async *jobs(filter = {}) {
        for (let cursor; cursor !== null;) {
            const page = await this.jobPage({ ...filter, ...(cursor ? { cursor } : {}) });
            yield* page.jobs;
            cursor = page.next_cursor ?? null;
        }
    }
    /** List up to `limit` jobs, newest first, from the `next_cursor` of the page before on. */
    jobPage(options = {}) {
        const query = new URLSearchParams({ limit: String(options.limit ?? 50) });
        if (options.state)
            query.set("state", options.state);
        if (options.search)
            query.set("q", options.search);
        for (const [name, value] of Object.entries(options.metadata ?? {}))
            query.set(`metadata[${name}]`, value);
        if (options.cursor)
            query.set("cursor", options.cursor);
        return this.#transport.json(`v1/jobs?${query}`, { signal: options.signal });
    }
    /** Iterate over a job's events as they happen, each once and in order, reconnecting as needed, until the job has ended. */
    watch(job, options = {}) {
        return events(this.#transport, id(job), options);
    }
    /** Wait until a job has succeeded. A job that did not is thrown as an error. */
    async wait(job, options = {}) {
        const { timeoutMs, onEvent } = options;
        const late = timeoutMs === undefined ? null : AbortSignal.timeout(timeoutMs);
        const signals = [options.signal, late].filter((signal) => signal !== undefined && signal !== null);
        const signal = signals.length ? AbortSignal.any(signals) : undefined;
        try {
            if (onEvent)
                for await (const event of this.watch(job, signal ? { signal } : {}))
                    onEvent(event);
            for (;;) {
                const headers = { Prefer: `wait=${LONGEST_HOLD_S}` };
                const found = await this.#transport.json(path(job), { headers, signal });
                if (isTerminal(found.state))
                    return succeeded(found);
            }
        }
        catch (failure) {
            options.signal?.throwIfAborted();
            if (!late?.aborted || failure instanceof MeshdeformError)
                throw failure;
            const detail = `The job ${id(job)} has not finished in time.`;
            throw new MeshdeformError(0, { code: "wait_timeout", detail, advice: "It goes on: wait again, or cancel it.", job_id: id(job) });
        }
    }
    /** Post a job and wait until it has succeeded; then download what you need. */
    async deform(asset, request, options = {}) {
        return this.wait(await this.submit(asset, request, options), options);
    }
    /** Request cancellation. */
    async cancel(job, signal) {
        return this.#transport.json(path(job, "cancel"), { method: "POST", signal });
    }
    /** Delete a job that has ended, with its artifacts. */
    async delete(job, signal) {
        await this.#transport.request(path(job), { method: "DELETE", signal });
    }
    /** Try a job that did not succeed again, as a new job that continues from its last checkpoint and may run for `maxRunS` seconds; default: as for the old one. */
    async retry(job, options = {}) {
        const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
        const json = options.maxRunS === undefined ? undefined : { max_run_s: options.maxRunS };
        return this.#transport.json(path(job, "retry"), { method: "POST", json, headers, signal: options.signal });
    }
    /** Post a job on the same asset that begins with the shape of a checkpoint. */
    async branch(job, step, request, options = {}) {
        const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
        const call = { method: "POST", json: request, headers, signal: options.signal };
        return this.#transport.json(path(job, `checkpoints/${step}/branch`), call);
    }
    /** List the shapes from which a job can continue. */
    async checkpoints(job, signal) {
        return (await this.#transport.json(path(job, "checkpoints"), { signal })).checkpoints;
    }
    /** List a job's artifacts. */
    async artifacts(job, signal) {
        return (await this.#transport.json(path(job, "artifacts"), { signal })).artifacts;
    }
    /** Make `morph.glb`, `map.safetensors` or another format of the result; `warnings` says what that cannot hold. */
    async make(job, name, signal) {
        return this.#transport.json(path(job, `artifacts/${encodeURIComponent(name)}`), { method: "POST", signal });
    }
    /** Deform another file as a job's asset was: a level of detail, clothes, a prop. Returns a GLB. */
    async apply(job, file, options = {}) {
        const { blob, filename } = named(file, options.filename);
        const query = new URLSearchParams({ filename, outside: options.outside ?? "refuse" });
        const headers = { "Content-Type": "application/octet-stream" };
        return this.bytes(path(job, `apply?${query}`), { method: "POST", body: blob, headers, signal: options.signal });
    }
    /** Download an artifact; `result.glb` at any strength from 0 to 1.5, and it and its other formats in a pose, `CLIP@SECONDS`. */
    async download(job, name = "result.glb", options = {}) {
        const { strength, pose } = options;
        const asked = Object.entries({ strength, pose }).filter(([, value]) => value !== undefined);
        const query = asked.length ? `?${new URLSearchParams(asked.map(([key, value]) => [key, String(value)]))}` : "";
        return this.#blob(path(job, `artifacts/${encodeURIComponent(name)}${query}`), options.signal);
    }
    /** Return what the result of a deformation is worth by its report; null where the report does not say. */
    async verdict(job, signal) {
        return readVerdict(await this.json(path(job, "artifacts/report.json"), { signal }));
    }
    /** Download a file that was sent with a job. */
    async file(job, part = "asset", signal) {
        return this.#blob(path(job, `files/${encodeURIComponent(part)}`), signal);
    }
    /** Return a URL of an artifact that needs no key and expires. */
    async signedUrl(job, name = "result.glb", signal) {
        const found = await this.#transport.json(path(job, `artifacts/${encodeURIComponent(name)}/url`), { method: "POST", signal });
        return { ...found, url: this.url(found.url) };
    }
    /** Return a link to a job's page: whoever has it can watch this job and read its files, without a key, until it expires. */
    async jobLink(job, signal) {
        const found = await this.#transport.json(path(job, "url"), { method: "POST", signal });
        return { ...found, url: this.url(found.url) };
    }
    /** Make a word of your own of meshes, or of ZIPs of several; your prompts can name it at once. */
    async addWord(meshes, request, options = {}) {
        const form = new FormData();
        const stored = [];
        for (const [at, mesh] of meshes.entries()) {
            if (!isData(mesh))
                stored.push(reference(mesh));
            else {
                const { blob, filename } = named(mesh);
                form.append("meshes", blob, mesh instanceof Blob ? filename : `mesh-${at + 1}.glb`);
            }
        }
        const [word] = await this.#words(form, { ...request, meshes: stored }, options);
        return word;
    }
    /** Keep the words of a file that `exportWord` or the command line wrote, all or none. */
    async importWords(file, options = {}) {
        const form = new FormData();
        form.append("word", file, "some.word");
        return this.#words(form, { replace: options.replace ?? false }, options);
    }
    /** List your words. */
    async words(signal) {
        return (await this.#transport.json("v1/words", { signal })).words;
    }
    /** Read a word of yours, with its meshes. */
    async word(noun, signal) {
        return this.#transport.json(wordPath(noun), { signal });
    }
    /** Return a word's file. */
    async exportWord(noun, signal) {
        return this.#blob(`${wordPath(noun)}/content`, signal);
    }
    /** Return a PNG of a word's meshes, coloured by their parts. */
    async drawWord(noun, signal) {
        return this.#blob(`${wordPath(noun)}/picture.png`, signal);
    }
    /** Delete a word. Jobs that have it keep it. */
    async deleteWord(noun, signal) {
        await this.#transport.request(wordPath(noun), { method: "DELETE", signal });
    }
    /** Return what your jobs have used in each month, newest first. */
    async usage(signal) {
        return (await this.#transport.json("v1/usage", { signal })).months;
    }
    async models(signal) {
        return this.#transport.json("v1/models", { signal });
    }
    async limits(signal) {
        return this.#transport.json("v1/limits", { signal });
    }
    async #words(form, request, options) {
        form.append("request", new Blob([JSON.stringify(request)], { type: "application/json" }));
        const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
        const call = { method: "POST", body: form, headers, signal: options.signal };
        return (await this.#transport.json("v1/words", call)).words;
    }
    /** Upload a file before its job; null where the service takes uploads at a host that this client keeps away from. */
    async #ahead(blob, filename, signal) {
        try {
            return await upload(this.#transport, blob, filename, signal ? { signal } : {});
        }
        catch (failure) {
            if (failure instanceof MeshdeformError && failure.code === "upload_elsewhere")
                return null;
            throw failure;
        }
    }
    #blob(path, signal) {
        return this.#transport.read(path, { signal }, (response) => response.blob());
    }
    /** Return the body of a job: a form with the files, or a document that names files of the service. */
    async #body(asset, request, options) {
        const given = Object.entries({ ...(asset ? { asset } : {}), ...options.files });
        const sent = [];
        const known = {};
        for (const [part, file] of given) {
            if (!isData(file)) {
                known[part] = reference(file);
                continue;
            }
            const { blob, filename } = named(file, part === "asset" ? options.filename : undefined);
            const ahead = blob.size > UPLOAD_ABOVE && canUpload() ? await this.#ahead(blob, filename, options.signal) : null;
            if (ahead)
                known[part] = { upload_id: ahead.id };
            else
                sent.push([part, blob, filename]);
        }
        const document = Object.keys(known).length ? { ...request, files: known } : request;
        if (!sent.length)
            return { json: document };
        const form = new FormData();
        for (const [part, blob, filename] of sent)
            form.append(part, blob, filename);
        form.append("request", new Blob([JSON.stringify(document)], { type: "application/json" }));
        return { body: form };
    }
}
function id(job) {
    const found = typeof job === "string" ? job : job.id;
    if (!found)
        throw new TypeError("A job needs an id.");
    return encodeURIComponent(found);
}
function path(job, rest = "") {
    return `v1/jobs/${id(job)}${rest && `/${rest}`}`;
}
function wordPath(noun) {
    if (!noun)
        throw new TypeError("A word needs a noun.");
    return `v1/words/${encodeURIComponent(noun)}`;
}
function isData(file) {
    return file instanceof Blob || file instanceof ArrayBuffer || ArrayBuffer.isView(file);
}
function reference(file) {
    return "id" in file ? { upload_id: file.id } : file;
}
function named(file, filename) {
    const blob = file instanceof Blob ? file : new Blob([file]);
    return { blob, filename: filename ?? (typeof File !== "undefined" && file instanceof File ? file.name : "asset.glb") };
}
function succeeded(job) {
    if (job.state === "succeeded")
        return job;
    const problem = job.error ?? { code: `job_${job.state}`, detail: `The job ${job.id} was ${job.state === "expired" ? "not finished in time" : "canceled"}.` };
    throw new MeshdeformError(0, { ...problem, job_id: job.id });
}
