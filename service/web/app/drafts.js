// @ts-check
/**
 * What was typed and chosen for a new job, kept over Back, a reload and a crash, for a week: the settings at once in
 * `localStorage`, the files a moment later in IndexedDB, where a write that begins as the page goes would be lost.
 *
 * @typedef {import("./assets.js").Asset} Asset
 * @typedef {{from: string | null, wish: any, asset: Asset | null, files?: Record<string, Asset>, stored?: boolean}} Draft `files`: by
 *   their names in a job. `stored`: read back from the browser.
 */
import { Asset as AssetFile } from "./assets.js";

const NAME = "meshdeform.draft";
const STORE = "files";
const KEPT_MS = 7 * 86_400_000;
/** Larger files are not kept: choose them again after a reload. */
export const LARGEST_BYTES = 64 << 20;

/** @type {Draft | null} */
let held = null;
let timer = 0;

/** Remember a draft. @param {Draft} draft */
export function keepDraft(draft) {
  held = draft;
  try {
    localStorage.setItem(NAME, JSON.stringify({ at: Date.now(), from: draft.from, wish: draft.wish }));
  } catch {
    // Full or forbidden: it is held while the page is open.
  }
  timer ||= window.setTimeout(store, 400); // soon after the first change, however many follow
}

/** @returns {Promise<Draft | null>} the last draft of this page, or else of this browser */
export async function lastDraft() {
  if (held) return held;
  const words = stored();
  if (!words) return null;
  const files = await opened("readonly", (files) => files.get(NAME)).catch(() => null);
  const { asset = null, ...others } = Object.fromEntries(Object.entries(files ?? {}).map(([role, { file, name }]) => [role, new AssetFile(file, name)]));
  // Who typed meanwhile has a newer one.
  held ??= { from: words.from, wish: words.wish, asset, files: others, stored: true };
  return held;
}

/** Let the next form for this job begin with the job's own settings. @param {string} job */
export function forgetDraftOf(job) {
  if (held?.from === job) held.from = null;
}

/** Delete the draft. */
export async function forgetDrafts() {
  clearTimeout(timer);
  timer = 0;
  held = null;
  try {
    localStorage.removeItem(NAME);
  } catch {
    // Nothing is kept.
  }
  await opened("readwrite", (files) => files.clear()).catch(() => {});
}

/** @returns {{at: number, from: string | null, wish: any} | null} */
function stored() {
  try {
    const found = JSON.parse(localStorage.getItem(NAME) ?? "null");
    return found?.wish && found.at > Date.now() - KEPT_MS ? found : null;
  } catch {
    return null;
  }
}

/** Write the files to IndexedDB. */
async function store() {
  timer = 0;
  const { asset = null, files = {} } = held ?? {};
  const kept = Object.entries({ ...(asset ? { asset } : {}), ...files }).filter(([, { size }]) => size <= LARGEST_BYTES);
  const record = Object.fromEntries(kept.map(([role, { blob, name }]) => [role, { file: blob, name }]));
  await opened("readwrite", (all) => all.put(record, NAME)).catch((error) => console.warn("The draft's files are not kept.", error));
}

/** @param {IDBTransactionMode} mode @param {(store: IDBObjectStore) => IDBRequest} work @returns {Promise<any>} what the request finds */
function opened(mode, work) {
  return new Promise((resolve, reject) => {
    const opening = indexedDB.open("meshdeform", 2);
    opening.onupgradeneeded = () => opening.result.createObjectStore(STORE);
    opening.onerror = () => reject(opening.error);
    opening.onsuccess = () => {
      const database = opening.result;
      const transaction = database.transaction(STORE, mode);
      const request = work(transaction.objectStore(STORE));
      transaction.oncomplete = () => (database.close(), resolve(request.result));
      transaction.onabort = transaction.onerror = () => (database.close(), reject(transaction.error));
    };
  });
}

// What was typed in the last moments before the page goes.
document.addEventListener("visibilitychange", () => document.hidden && held && void store());
