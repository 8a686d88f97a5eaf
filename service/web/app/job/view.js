// @ts-check
/** The address of a job: a deformation is shown on the workbench with its state, any other kind beside a view of its own. */
import { client, isAbort } from "../client.js";
import { fill, h } from "../dom.js";
import { currentLink } from "../key.js";
import { linkProblem, problemBox, temporary } from "../problem-box.js";
import { JobPanel } from "./panel.js";
import { isDeformation } from "./shapes.js";

const AGAIN_MS = 3000;

/** Show a job. @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {string} id @param {string} [against] A job whose result it is compared with. */
export async function openJob(root, scope, id, against = "") {
  fill(root, h("p", { class: "loading", role: "status" }, "Loading the job…"));
  const job = await read(root, scope, id);
  if (!job || scope.over) return;
  try {
    if (!isDeformation(job)) return await showOther(root, scope, job);
    const { Workbench } = await import("../create/view.js");
    if (!scope.over) new Workbench(root, scope, { job, against });
  } catch (error) {
    // A module did not arrive.
    if (!scope.over) fill(root, h("h1", null, "Job"), problemBox(error, h("button", { type: "button", class: "button", on: { click: () => location.reload() } }, "Reload")));
  }
}

/** @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {string} id @returns {Promise<any>} null where it cannot be read, which is said */
async function read(root, scope, id) {
  while (!scope.over) {
    try {
      return await client.get(id, scope.signal);
    } catch (error) {
      if (isAbort(error) || scope.over) return null;
      fill(root, h("h1", { class: "visually-hidden" }, "Job"), currentLink() ? problemBox(linkProblem(error)) : problemBox(error, h("a", { class: "button", href: "#/jobs" }, "All jobs")));
      if (!temporary(error)) return null;
    }
    await scope.sleep(AGAIN_MS);
  }
  return null;
}

/** A job of another kind. @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {any} job */
async function showOther(root, scope, job) {
  const stage = await stageOf(job, scope);
  if (scope.over) return;
  const finished = async (/** @type {any} */ report, /** @type {any[]} */ artifacts) => {
    const names = artifacts.map(({ name }) => name);
    stage.job = panel.job;
    if (report && stage.finished) await stage.finished(report, names, panel.results);
    await stage.ready;
    if (stage.flat && names.includes("preview.png")) stage.showPicture(await client.download(job.id, "preview.png", { signal: scope.signal }));
  };
  const panel = new JobPanel(job, scope, { offer: (...shapes) => stage.offer(...shapes), finished });
  fill(root, panel.head, h("div", { class: "job" }, stage.element, h("div", { class: "job-side" }, panel.top, panel.results, panel.settings)));
  panel.follow();
}

/** What shows the result. @param {any} job @param {import("../scope.js").Scope} scope @returns {Promise<any>} */
async function stageOf(job, scope) {
  if (!job.unreadable && job.kind.startsWith("family_")) return new (await import("./family-stage.js")).FamilyStage(job, scope);
  if (!job.unreadable && job.kind === "surface_fit") return new (await import("./field-stage.js")).FieldStage(job, scope);
  return new (await import("./picture-stage.js")).PictureStage(job, scope);
}
