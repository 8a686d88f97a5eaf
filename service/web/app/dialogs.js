// @ts-check
/** Questions in a dialog: the browser's own, which keeps the focus and closes by Escape. */
import { fill, h } from "./dom.js";
import { problemBox } from "./problem-box.js";

/**
 * @param {object} asked
 * @param {string} asked.title
 * @param {(Node | string)[]} asked.body
 * @param {string} asked.action Label of the button that does it.
 * @param {boolean} [asked.danger]
 * @param {() => Promise<void>} asked.act What it does; where that fails, the dialog stays and says why.
 * @param {(error: unknown, place: HTMLElement) => boolean} [asked.explain] Says an error in its own way; false: it does not.
 * @param {import("./scope.js").Scope} [scope] Of the view that goes with it.
 */
export function ask({ title, body, action, danger = false, act, explain }, scope) {
  const id = `dialog-${title.replace(/\W+/g, "-").toLowerCase()}`;
  const problem = h("div", { class: "dialog-problem", "aria-live": "polite" });
  const confirm = h("button", { type: "submit", class: `button ${danger ? "button-danger" : "button-primary"}` }, action);
  const form = h(
    "form",
    { class: "dialog-body" },
    h("h2", { id }, title),
    ...body,
    problem,
    h(
      "div",
      { class: "dialog-actions" },
      h("button", { type: "button", class: "button", on: { click: () => dialog.close() } }, "Cancel"),
      confirm,
    ),
  );
  const dialog = h("dialog", { class: "dialog", "aria-labelledby": id }, form);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    confirm.disabled = true;
    fill(problem);
    try {
      await act();
      dialog.close();
    } catch (error) {
      if (!explain?.(error, problem)) fill(problem, problemBox(error));
    } finally {
      confirm.disabled = false;
    }
  });
  dialog.addEventListener("close", () => dialog.remove());
  scope?.add(() => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  return dialog;
}
