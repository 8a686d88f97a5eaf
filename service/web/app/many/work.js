// @ts-check
/** What is done with many files, one after the other: the server reads and changes one of an owner at a time. */
import { Asset } from "../assets.js";
import { client, isAbort, MeshdeformError } from "../client.js";
import { described } from "../problem-box.js";

/** @typedef {import("./item.js").Item} Item */

const PICTURE = { width: 360, height: 360 };
const AGAIN_S = 3;
/** Answers that say that it was too much at once. */
const LATER = ["rate_limited", "too_many_jobs"];
const PARAMS = { seed: 0, guidance: { kind: "exemplar" } };

export class ManyWork {
  /** @param {import("../scope.js").Scope} scope @param {(item: Item, pictures: (Blob | null)[]) => void} done Something became of one. @param {() => void} idle All is done. */
  constructor(scope, done, idle) {
    this.scope = scope;
    this.done = done;
    this.idle = idle;
    /** @type {Item[]} */
    this.items = [];
    this.sentence = "";
    this.busy = this.drawing = false;
    this.asking = new AbortController();
    /** @type {"" | "read" | "change" | "look"} */
    this.task = "";
    /** @type {Item | null} */
    this.at = null;
    scope.add(() => this.asking.abort());
  }

  /** Do all that is to be done. @param {Item[]} items @param {string} sentence */
  go(items, sentence) {
    this.items = items;
    this.sentence = sentence;
    if (!this.busy) void this._run();
    if (!this.drawing) void this._draw();
  }

  /** Draw files as they are while the server reads them. */
  async _draw() {
    this.drawing = true;
    let item;
    while (!this.scope.over && (item = this.items.find(({ drawn, asset }) => asset && !drawn))) {
      item.drawn = true;
      const [picture] = await pictures([/** @type {Asset} */ (item.asset)]);
      if (!this.scope.over && !item.made) this.done(item, [picture, null]);
    }
    this.drawing = false;
  }

  /** Stop what is under way if it is of a kind. @param {string} task */
  stop(task) {
    if (this.task === task) this.asking.abort();
  }

  /** @param {Item} item That has gone. */
  forget(item) {
    if (this.at === item) this.asking.abort();
  }

  async _run() {
    this.busy = true;
    // What was asked for comes first; what nobody waits for, such as reading them all, after it.
    const next = () => this.items.find((each) => each.next(this.sentence) === "change") ?? this.items.find((each) => each.next(this.sentence));
    let item;
    while (!this.scope.over && (item = next())) {
      this.asking = new AbortController();
      this.task = item.next(this.sentence);
      this.at = item;
      const { sentence } = this;
      let pictures = /** @type {(Blob | null)[]} */ ([null, null]);
      try {
        item.doing = this.task === "change" ? "changing" : "reading";
        this.done(item, pictures);
        if (this.task === "look") pictures = await this._look(item, sentence);
        else if (this.task === "read") pictures = await this._read(item);
        else pictures = await this._change(item, sentence);
      } catch (error) {
        if (this.scope.over) return;
        if (!isAbort(error) && !(await this._wait(error))) this._refuse(item, error, this.task === "change" ? sentence : null);
      }
      item.doing = "";
      this.at = null;
      this.task = "";
      if (!this.scope.over) this.done(item, pictures);
    }
    this.busy = false;
    if (!this.scope.over) this.idle();
  }

  /** @param {unknown} error @returns {Promise<boolean>} whether it is worth another try, after a while: the server is not there, or has too much to do */
  async _wait(error) {
    if (!(error instanceof MeshdeformError) || !(error.unanswered || LATER.includes(error.code))) return false;
    return this.scope.sleep(1000 * (error.retryAfterS ?? AGAIN_S));
  }

  /** @param {Item} item @param {unknown} error @param {string | null} sentence */
  _refuse(item, error, sentence) {
    const { title, detail, advice } = described(error);
    item.why = { title: detail || title, advice, sentence };
    item.unseen = false;
  }

  /** @param {Item} item */
  async _read(item) {
    const asset = await this._asset(item);
    const { signal } = this.asking;
    const found = await client.parts(...(await asset.submission({}, {}, signal)));
    item.reading = found.reading ?? {};
    return [null, null];
  }

  /** @param {Item} item @param {string} sentence */
  async _change(item, sentence) {
    const asset = await this._asset(item);
    const { signal } = this.asking;
    const document = { prompt: sentence, params: PARAMS };
    const [sent, , more] = await asset.submission(document, {}, signal);
    const { data } = await client.preview(sent, document, { ...more, as: "glb", signal });
    const blob = new Blob([data], { type: "model/gltf-binary" });
    item.made = { sentence, blob };
    item.why = null;
    return pictures([asset, new Asset(blob, "result.glb")]);
  }

  /** Draw what a job has kept, and read it. @param {Item} item @param {string} sentence */
  async _look(item, sentence) {
    const [asset, result] = await this.files(item, sentence);
    item.unseen = false;
    if (!item.verdict) await this.judge(item);
    return pictures([asset, new Asset(/** @type {Blob} */ (result), "result.glb")]);
  }

  /** @param {Item} item Whose job has succeeded. */
  async judge(item) {
    item.verdict = await client.verdict(item.job.id, this.scope.signal).catch(() => null);
  }

  /** @param {Item} item @returns {Promise<Asset>} also that which only its job has */
  async _asset(item) {
    item.asset ??= new Asset(await client.file(item.job.id, "asset", this.scope.signal), item.job.asset.filename);
    return item.asset;
  }

  /** @param {Item} item @param {string} sentence @returns {Promise<[Asset, Blob | null]>} the asset, and its result if there is one */
  async files(item, sentence) {
    const asset = await this._asset(item);
    if (item.keeps(sentence) && item.job.state === "succeeded") return [asset, await client.download(item.job.id, "result.glb", { signal: this.scope.signal })];
    return [asset, item.has(sentence) ? (item.made?.blob ?? null) : null];
  }

  /** Make a job of what a sentence makes of a file. @param {Item} item @param {string} sentence @param {string} group */
  async keep(item, sentence, group) {
    const asset = await this._asset(item);
    item.doing = "sending";
    const document = { prompt: sentence, params: PARAMS, metadata: { group, path: item.path.slice(-200) } };
    try {
      item.job = await this._submitted(asset, document);
      item.verdict = null;
    } catch (error) {
      if (!isAbort(error)) this._refuse(item, error, sentence);
    } finally {
      item.doing = "";
    }
  }

  /** Post a job as soon as the server takes one more. @param {Asset} asset @param {any} document @returns {Promise<any>} */
  async _submitted(asset, document) {
    for (;;) {
      try {
        return await client.submit(...(await asset.submission(document)));
      } catch (error) {
        if (isAbort(error) || !(await this._wait(error))) throw error;
      }
    }
  }
}

/** Pictures of assets in the same frame; none where nothing can be drawn. @param {Asset[]} assets @returns {Promise<(Blob | null)[]>} */
async function pictures(assets) {
  try {
    const { snapshotAssets } = await import("../../viewer/snapshot.js");
    return await snapshotAssets(await Promise.all(assets.map(async (asset) => ({ buffer: await asset.bytes(), format: /** @type {any} */ (asset.format || "gltf") }))), PICTURE);
  } catch (error) {
    console.warn(error);
    return assets.map(() => null);
  }
}
