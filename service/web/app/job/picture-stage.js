// @ts-check
/** The result of a job of a kind that has no shape to be turned: the picture that it made. */
import { fill, h } from "../dom.js";
import { drawnPicture } from "../widgets.js";

export class PictureStage {
  /** @param {any} job @param {import("../scope.js").Scope} scope */
  constructor(job, scope) {
    this.job = job;
    this.scope = scope;
    this.flat = true;
    this.ready = Promise.resolve();
    this.frame = h("div", { class: "stage pair-stage" }, h("p", { class: "viewer-note" }, job.state === "succeeded" ? "Loading the picture…" : "The picture comes with the result"));
    this.element = h("section", { class: "job-stage", "aria-label": "Result" }, this.frame);
  }

  /** Shapes on the way are not shown. @param {...any} _ @returns {any} */
  offer(..._) {}

  /** @param {Blob} picture */
  showPicture(picture) {
    fill(this.frame, drawnPicture(this.scope, picture, "The result, as the job drew it"));
  }
}
