// @ts-check
/** The contact sheet of a group: a row for each finished variation, a column for each strength. */
import { announce } from "../announce.js";
import { client, isAbort, MeshdeformError } from "../client.js";
import { button, fill, h, invalid, labelled, say } from "../dom.js";
import { saveBytes } from "../job/files.js";
import { stemOf } from "../names.js";
import { described } from "../problem-box.js";

const MOST_STRENGTHS = 6;

/** Strengths in percent from what was typed; null where it is no list of them. @param {string} text Such as "50, 100, 130". */
export function strengthsOf(text) {
  const values = text.split(/[\s,]+/).filter(Boolean).map((item) => (/^\d+%?$/.test(item) ? parseInt(item, 10) : NaN));
  const good = values.length > 0 && values.length <= MOST_STRENGTHS && values.every((value) => value >= 0 && value <= 150);
  return good ? [...new Set(values)] : null;
}

export class SheetPanel {
  /** @param {import("../scope.js").Scope} scope @param {() => any[]} jobs The finished ones, in order. */
  constructor(scope, jobs) {
    this.scope = scope;
    this.jobs = jobs;
    this.input = h("input", { type: "text", id: "sheet-strengths", value: "50, 100, 130", autocomplete: "off", "aria-describedby": "sheet-help" });
    this.make = button("Make the sheet", () => this._make(), { icon: "grid" });
    this.problem = h("p", { class: "field-problem", role: "alert", hidden: true });
    this.progress = h("p", { class: "small muted", role: "status" });
    this.result = h("div", { class: "sheet-result" });
    this.element = h(
      "details",
      { class: "panel panel-fold sheet", hidden: true },
      h("summary", null, h("h2", null, "Contact sheet")),
      h(
        "div",
        { class: "row sheet-form" },
        labelled("sheet-strengths", "Strengths in percent", this.input, h("p", { class: "small muted", id: "sheet-help" }, "100 is the result, 0 the asset, up to 150.")),
        this.make,
      ),
      this.problem,
      this.progress,
      this.result,
    );
  }

  /** Offer it, or no more. */
  show() {
    this.element.hidden = !this.jobs().length;
  }

  async _make() {
    const strengths = strengthsOf(this.input.value);
    this._refuse(strengths ? "" : `Enter one to ${MOST_STRENGTHS} whole numbers from 0 to 150, such as 50, 100, 130.`);
    if (!strengths || this.make.disabled) return;
    this.make.disabled = true;
    fill(this.result);
    try {
      await this._draw(strengths);
    } catch (error) {
      if (this.scope.over || isAbort(error)) return;
      const away = error instanceof MeshdeformError && error.code === "dependency_missing";
      this._refuse(away ? "This server makes no other strengths: only 100 can be drawn." : described(error).detail || (error instanceof Error ? error.message : "The sheet could not be made."));
    } finally {
      this.make.disabled = false;
      this.progress.textContent = "";
    }
  }

  /** @param {number[]} strengths */
  async _draw(strengths) {
    const { drawSheet } = await import("../../viewer/sheet.js");
    const jobs = this.jobs();
    const rows = [];
    for (const job of jobs) {
      const shapes = [];
      for (const strength of strengths) {
        this.progress.textContent = `Shape ${rows.length * strengths.length + shapes.length + 1} of ${jobs.length * strengths.length}…`;
        const query = strength === 100 ? "" : `?strength=${strength / 100}`;
        shapes.push(await client.bytes(`v1/jobs/${job.id}/artifacts/result.glb${query}`, { signal: this.scope.signal }));
      }
      rows.push({ label: `Variation ${job.params?.seed ?? 0}`, shapes });
    }
    this.progress.textContent = "Drawing…";
    const style = getComputedStyle(document.documentElement);
    const [background, ink, font] = ["--surface", "--ink", "--sans"].map((name) => style.getPropertyValue(name).trim());
    const dark = style.colorScheme === "dark";
    const sheet = await drawSheet(strengths.map((strength) => `${strength}%`), rows, { background, ink, font, dark, signal: this.scope.signal });
    if (this.scope.over) return;
    const name = `${stemOf(jobs[0]).replace(/-seed\d+$/, "")}-variants.png`;
    const words = `${jobs.length} variations, each at ${strengths.map((strength) => `${strength}%`).join(", ")}`;
    fill(this.result, h("img", { src: this.scope.url(sheet), alt: words }), button("Save the sheet", () => saveBytes(sheet, name), { icon: "download" }));
    announce("The sheet is there");
  }

  /** @param {string} text */
  _refuse(text) {
    say(this.problem, text);
    invalid(this.input, text !== "");
  }
}
