// @ts-check
/** What went wrong, and what to do about it. */
import { toast } from "./announce.js";
import { isAbort, isOffline, MeshdeformError } from "./client.js";
import { h, icon } from "./dom.js";
import { currentLink } from "./key.js";
import { plainWords } from "./plain.js";

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

/** What is wrong with a link, in place of what a key would be told; any other error stays. @param {unknown} error */
export function linkProblem(error) {
  if (!currentLink() || !(error instanceof MeshdeformError) || error.status !== 401) return error;
  return { title: error.message, detail: "", advice: error.advice };
}

/** Return whether the same request may succeed a little later. @param {unknown} error */
export function temporary(error) {
  return isOffline(error) || (error instanceof MeshdeformError && (error.status === 429 || error.status >= 500));
}

/** Do something, and say it where that fails; a view that goes says nothing. @param {string} failed @param {() => unknown} work */
export async function orToast(failed, work) {
  try {
    await work();
  } catch (error) {
    const { title, detail } = described(error);
    if (!isAbort(error)) toast(`${failed}. ${plainWords(detail) || title}`);
  }
}

/** @param {unknown} error Or a job's `error`, which has the same members. @param {...(Node | null)} actions */
export function problemBox(error, ...actions) {
  const isJobError = typeof error === "object" && error !== null && "advice" in error && !(error instanceof Error);
  const { title, detail, advice, id } = isJobError ? jobError(error) : described(error);
  const [said, help] = [plainWords(detail), plainWords(advice)];
  const more = [detail, advice].filter((text) => text && text !== said && text !== help).map((text) => h("p", null, text));
  return h(
    "div",
    { class: "problem", role: "alert" },
    icon("warn"),
    h(
      "div",
      null,
      h("p", { class: "problem-title" }, title),
      said ? h("p", null, said) : null,
      help ? h("p", { class: "muted" }, help) : null,
      more.length || id ? h("details", { class: "small muted" }, h("summary", null, "Details"), more, id ? h("p", null, "Request ", h("code", null, id)) : null) : null,
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
