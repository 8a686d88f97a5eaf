// @ts-check
/** Dialogs: the browser's own, which keep the focus and close by Escape. */
import { button, fill, h } from "./dom.js";
import { problemBox } from "./problem-box.js";

/**
 * Open one; once closed it is gone, and so it is when its view goes.
 * @param {string} title
 * @param {(Node | string)[]} body
 * @param {import("./scope.js").Scope} [scope] Of the view that goes with it.
 * @param {string} [style] A class of its own.
 */
export function openDialog(title, body, scope, style = "") {
  const id = `dialog-${title.replace(/\W+/g, "-").toLowerCase()}`;
  const dialog = h("dialog", { class: `dialog ${style}`, "aria-labelledby": id }, h("div", { class: "dialog-body" }, h("h2", { id }, title), body));
  dialog.addEventListener("close", () => dialog.remove());
  scope?.add(() => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}

/**
 * Ask before something is done.
 * @param {object} asked
 * @param {string} asked.title
 * @param {(Node | string)[]} asked.body
 * @param {string} asked.action Label of the button that does it.
 * @param {boolean} [asked.danger]
 * @param {() => Promise<void>} asked.act What it does; where that fails, the dialog stays and says why.
 * @param {import("./scope.js").Scope} [scope] Of the view that goes with it.
 */
export function ask({ title, body, action, danger = false, act }, scope) {
  const problem = h("div", { class: "dialog-problem", "aria-live": "polite" });
  const confirm = h("button", { type: "submit", class: `button ${danger ? "button-danger" : "button-primary"}` }, action);
  const form = h("form", null, ...body, problem, h("div", { class: "dialog-actions" }, button("Cancel", () => dialog.close()), confirm));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    confirm.disabled = true;
    fill(problem);
    try {
      await act();
      dialog.close();
    } catch (error) {
      fill(problem, problemBox(error));
    } finally {
      confirm.disabled = false;
    }
  });
  const dialog = openDialog(title, [form], scope);
  return dialog;
}
