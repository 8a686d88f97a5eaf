// @ts-check
/** Files that a user chooses, or drops on the page. */
import { h } from "./dom.js";
import { routeHash } from "./router.js";

/** A field that was given to another view. @type {File | null} */
let handed = null;

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
