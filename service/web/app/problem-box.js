// @ts-check
/** What went wrong, and what to do about it. */
import { toast } from "./announce.js";
import { isAbort, isOffline, MeshdeformError } from "./client.js";
import { h, icon } from "./dom.js";

/** @param {unknown} error @returns {{title: string, detail: string, advice: string, id: string}} */
export function described(error) {
  if (isOffline(error)) {
    const advice = "Check your connection and that the server is running. Nothing is lost.";
    return { title: "The server does not answer.", detail: "", advice, id: "" };
  }
  if (error instanceof MeshdeformError) {
    const detail = error.message === error.title ? "" : error.message;
    // The advice about a prompt lists every word there is; the form offers them.
    const advice = error.code === "prompt_unknown_words" ? "" : error.advice;
    return { title: error.title, detail, advice, id: error.requestId };
  }
  return { title: "Something went wrong on this page", detail: error instanceof Error ? error.message : String(error), advice: "", id: "" };
}

/** Do something, and say it where that fails; a view that goes says nothing. @param {string} failed @param {() => unknown} work */
export async function orToast(failed, work) {
  try {
    await work();
  } catch (error) {
    const { title, detail } = described(error);
    if (!isAbort(error)) toast(`${failed}. ${detail || title}`);
  }
}

/** @param {unknown} error Or a job's `error`, which has the same members. @param {...(Node | null)} actions */
export function problemBox(error, ...actions) {
  const isJobError = typeof error === "object" && error !== null && "advice" in error && !(error instanceof Error);
  const { title, detail, advice, id } = isJobError ? jobError(error) : described(error);
  return h(
    "div",
    { class: "problem", role: "alert" },
    icon("warn"),
    h(
      "div",
      null,
      h("p", { class: "problem-title" }, title),
      detail ? h("p", null, detail) : null,
      advice ? h("p", { class: "muted" }, advice) : null,
      id ? h("p", { class: "small muted" }, "Request ", h("code", null, id)) : null,
      actions.length ? h("div", { class: "row" }, ...actions) : null,
    ),
  );
}

/** @param {any} error */
function jobError(error) {
  const title = String(error.title ?? "The job failed");
  const detail = String(error.detail ?? "");
  return { title, detail: detail === title ? "" : detail, advice: String(error.advice ?? ""), id: "" };
}
