// @ts-check
/**
 * What was typed and chosen for a new job, kept over Back, a reload and a crash. The settings are in `sessionStorage`
 * and, the newest of all tabs, in `localStorage`, at once; with the asset they also go to IndexedDB, a record for each
 * tab, for a week. A write to IndexedDB that begins as the page goes is lost.
 *
 * @typedef {import("./assets.js").Asset} Asset
 * @typedef {{from: string | null, wish: any, asset: Asset | null, files?: Record<string, Asset>, stored?: boolean}} Draft `files`: by the
 *   names of their parts. `stored`: read back from the browser.
 */
import { Asset as AssetFile } from "./assets.js";

const NAME = "meshdeform.draft";
const STORE = "drafts";
const KEPT_MS = 7 * 86_400_000;
const KEPT_TABS = 5;
/** Larger files are not kept: choose them again after a reload. */
export const LARGEST_BYTES = 64 << 20;

/** @type {Draft | null} */
let held = null;
let timer = 0;

/** Remember a draft. @param {Draft} draft */
export function keepDraft(draft) {
  held = draft;
  try {
    const words = JSON.stringify({ tab: tabId(), at: Date.now(), from: draft.from, wish: draft.wish });
    sessionStorage.setItem(NAME, words);
    localStorage.setItem(NAME, words);
  } catch {
    // Full or forbidden: it is held while the page is open.
  }
  clearTimeout(timer);
  timer = window.setTimeout(store, 400);
}

/** Return the draft of this tab, or the newest one of any tab where this one has none. @returns {Promise<Draft | null>} */
export async function lastDraft() {
  if (held) return held;
  const own = stored("sessionStorage");
  const last = stored("localStorage");
  const records = await all().catch(() => []);
  const recent = [...records, ...(last ? [last] : [])].filter((record) => record.at > Date.now() - KEPT_MS);
  const words = own ?? recent.sort((a, b) => b.at - a.at)[0];
  if (!words) return null;
  const found = records.find((record) => record.tab === words.tab);
  const asset = found?.file ? new AssetFile(found.file, found.name) : null;
  // Who typed meanwhile has a newer one.
  const files = Object.fromEntries(Object.entries(found?.files ?? {}).map(([part, { file, name }]) => [part, new AssetFile(file, name)]));
  held ??= { from: words.from, wish: words.wish, asset, files, stored: true };
  return held;
}

/** Let the next form for this job begin with the job's own settings. @param {string} job */
export function forgetDraftOf(job) {
  if (held?.from === job) held.from = null;
}

/** Delete the drafts of every tab of this browser. */
export async function forgetDrafts() {
  clearTimeout(timer);
  held = null;
  try {
    sessionStorage.removeItem(NAME);
    localStorage.removeItem(NAME);
  } catch {
    // Nothing is kept.
  }
  await change((store) => store.clear()).catch(() => {});
}

/** @param {"sessionStorage" | "localStorage"} place @returns {{tab: string, at: number, from: string | null, wish: any} | null} */
function stored(place) {
  try {
    const found = JSON.parse(window[place].getItem(NAME) ?? "null");
    return found?.wish && found.tab ? found : null;
  } catch {
    return null;
  }
}

let tab = "";

function tabId() {
  tab ||= stored("sessionStorage")?.tab || crypto.getRandomValues(new Uint32Array(2)).join("-");
  return tab;
}

/** Write the draft to IndexedDB. */
async function store() {
  if (!held) return;
  const { from, wish, asset, files = {} } = held;
  const small = asset !== null && asset.size <= LARGEST_BYTES;
  const kept = Object.entries(files).filter(([, { size }]) => size <= LARGEST_BYTES);
  const others = Object.fromEntries(kept.map(([part, { blob, name }]) => [part, { file: blob, name }]));
  const record = { tab: tabId(), at: Date.now(), from, wish, file: small ? asset.blob : null, name: asset?.name ?? "", files: others };
  try {
    await change((store) => store.put(record));
    const records = (await all()).sort((a, b) => b.at - a.at);
    const old = records.filter((found, index) => index >= KEPT_TABS || found.at < Date.now() - KEPT_MS);
    if (old.length) await change((store) => old.forEach((found) => store.delete(found.tab)));
  } catch (error) {
    console.warn("The draft's file is not kept.", error);
  }
}

/** @returns {Promise<any[]>} */
function all() {
  return opened("readonly", (store) => store.getAll());
}

/** @param {(store: IDBObjectStore) => unknown} work */
function change(work) {
  return opened("readwrite", work);
}

/**
 * @param {IDBTransactionMode} mode
 * @param {(store: IDBObjectStore) => unknown} work May return a request, whose result is the answer.
 * @returns {Promise<any>}
 */
function opened(mode, work) {
  return new Promise((resolve, reject) => {
    const opening = indexedDB.open("meshdeform", 1);
    opening.onupgradeneeded = () => opening.result.createObjectStore(STORE, { keyPath: "tab" });
    opening.onerror = () => reject(opening.error);
    opening.onsuccess = () => {
      const database = opening.result;
      const transaction = database.transaction(STORE, mode);
      const request = work(transaction.objectStore(STORE));
      transaction.oncomplete = () => (database.close(), resolve(request instanceof IDBRequest ? request.result : null));
      transaction.onabort = transaction.onerror = () => (database.close(), reject(transaction.error));
    };
  });
}

// What was typed in the last moments before the page goes.
document.addEventListener("visibilitychange", () => document.hidden && void store());
