// @ts-check
/** Files that a user chooses, or drops on the page. */
import { h } from "./dom.js";
import { routeHash } from "./router.js";

/** @typedef {{path: string, blob: Blob}} Found A file, where it lay. */

/** A field that was given to another view. @type {File | null} */
let handed = null;

/** Files that were given to another view. @type {Promise<Found[]> | null} */
let handedMany = null;

/** Of folders, before anything is known of what they hold. */
const MOST_ENTRIES = 5000;

/** @param {File} file */
export function isField(file) {
  return /\.ndf$/i.test(file.name);
}

/** Show a `.ndf` in the view for it. @param {File} field */
export function openField(field) {
  handed = field;
  location.hash = routeHash({ name: "field" });
}

/** @returns {File | null} The field with which that view opens. */
export function takeHanded() {
  const file = handed;
  handed = null;
  return file;
}

/**
 * A field for files, which a button opens.
 * @param {string} id
 * @param {string} label
 * @param {string} accept
 * @param {(files: File[]) => void} take
 * @param {boolean} [multiple]
 */
export function fileInput(id, label, accept, take, multiple = false) {
  const input = h("input", { type: "file", class: "visually-hidden", id, tabindex: "-1", "aria-label": label, accept, multiple });
  input.addEventListener("change", () => {
    const files = [...(input.files ?? [])];
    input.value = ""; // the same file can be chosen again
    if (files.length) take(files);
  });
  return input;
}

/**
 * Take what is dropped anywhere on the page; while something is over it, the element shows that it would.
 * @param {import("./scope.js").Scope} scope
 * @param {HTMLElement} element
 * @param {(files: File[], target: EventTarget | null, transfer: DataTransfer) => void} take
 */
export function takeDrops(scope, element, take) {
  scope.listen(document, "dragover", (event) => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    element.classList.add("dropping");
  });
  scope.listen(document, "dragleave", (event) => event.relatedTarget ?? element.classList.remove("dropping"));
  scope.listen(document, "drop", (event) => {
    element.classList.remove("dropping");
    const files = [...(event.dataTransfer?.files ?? [])];
    if (!files.length) return;
    event.preventDefault();
    take(files, event.target, event.dataTransfer);
  });
}

/** Let several files, or a folder, that are dropped on a view for one asset hang in the view for many. @param {import("./scope.js").Scope} scope */
export function handMany(scope) {
  const take = (/** @type {DragEvent} */ event) => {
    const { target, dataTransfer: transfer } = event;
    const elsewhere = target instanceof Element && target.closest("[data-drop='guide'], dialog");
    if (!transfer || elsewhere || !areMany(transfer)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    handedMany = droppedFiles(transfer);
    location.hash = routeHash({ name: "many" });
  };
  document.addEventListener("drop", take, { capture: true, signal: scope.signal });
}

/** @returns {Promise<Found[]> | null} The files with which the view for many opens. */
export function takeHandedMany() {
  const files = handedMany;
  handedMany = null;
  return files;
}

/** @param {DataTransfer} transfer */
function areMany({ items, files }) {
  if ([...items].some((item) => item.webkitGetAsEntry?.()?.isDirectory)) return true;
  return files.length > 1 && ![...files].some(({ type }) => type.startsWith("image/"));
}

/** What was dropped, folders with all that is in them. To be called while the event is handled. @param {DataTransfer} transfer @returns {Promise<Found[]>} */
export async function droppedFiles(transfer) {
  const entries = [...transfer.items].flatMap((item) => item.webkitGetAsEntry?.() ?? []);
  if (!entries.length) return [...transfer.files].map(chosenFile);
  /** @type {Found[]} */
  const found = [];
  for (const entry of entries) await walk(entry, found);
  return found;
}

/** @param {File} file Of an input, of files or of a folder. @returns {Found} */
export function chosenFile(file) {
  return { path: file.webkitRelativePath || file.name, blob: file };
}

/** @param {any} entry Of a file system. @param {Found[]} found */
async function walk(entry, found) {
  if (found.length >= MOST_ENTRIES) return;
  const path = entry.fullPath.replace(/^\//, "");
  if (entry.isFile) found.push({ path, blob: await new Promise((resolve, reject) => entry.file(resolve, reject)) });
  if (!entry.isDirectory) return;
  const reader = entry.createReader();
  // A reader gives a folder in pieces, the last of which is empty.
  for (;;) {
    const inside = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!inside.length) return;
    for (const each of inside) await walk(each, found);
  }
}
