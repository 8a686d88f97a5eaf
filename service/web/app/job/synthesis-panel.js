// @ts-check
/** New shapes of a family that was found: what kind, of which members, and the job that makes them. */
import { client, errorsOf, isAbort } from "../client.js";
import { NumberRows } from "../create/field-rows.js";
import { JobForm } from "../create/form.js";
import { fill, h, panel, uniqueId } from "../dom.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { segmented } from "../widgets.js";

/** Mode, its name, and what choosing members is for. */
const MODES = /** @type {[string, string, string[]][]} */ ([
  ["sample", "New", []],
  ["interpolate", "Between two", ["From", "To"]],
  ["complete", "Keep parts", ["Of"]],
  ["search", "Find alike", ["Like"]],
]);
const FAMILY = "family.safetensors";
const LABELLED = "labelled.zip";

export class SynthesisPanel {
  /**
   * @param {any} job
   * @param {any} report
   * @param {string[]} artifacts Their names.
   * @param {import("../scope.js").Scope} scope
   * @param {(names: string[]) => void} onMembers Called with the members that are chosen.
   */
  constructor(job, report, artifacts, scope, onMembers) {
    this.job = job;
    this.report = report;
    this.artifacts = artifacts;
    this.scope = scope;
    this.onMembers = onMembers;
    this.mode = "sample";
    this.turn = 0; // which of two members a click chooses
    this.numbers = new NumberRows("family_synthesize", ["count"], () => {});
    this.members = [0, 1].map((number) => this._select(number));
    this.keep = h("fieldset", { class: "row synthesis-keep" }, h("legend", { class: "field-label" }, "Parts to keep"));
    this.problem = h("div", { class: "problem-slot" });
    this.hint = h("p", { class: "small muted" }, "Or click a shape on the wall.");
    this.form = new JobForm(scope, "New shapes", "Make shapes", {
      ready: () => this.numbers.settle(),
      send: () => this._send(),
      refuse: (error) => this.numbers.refuse(errorsOf(error)) || fill(this.problem, problemBox(error)),
    });
    this.form.element.className = "synthesis";
    this.form.button.classList.remove("button-large");
    this.form.button.removeAttribute("aria-describedby");
    this.form.element.append(
      segmented("Kind of shapes", MODES.map(([mode, label]) => /** @type {[string, string]} */ ([mode, label])), this.mode, (mode) => this._choose(mode)),
      ...this.members.map(({ row }) => row),
      this.hint,
      this.keep,
      this.numbers.first,
      this.numbers.advanced,
      this.problem,
      h("div", { class: "row" }, this.form.button),
    );
    this.element = panel("synthesis-title", "New shapes", this.form.element);
    this._choose(this.mode);
    this.numbers.load(scope.signal).catch((error) => !isAbort(error) && fill(this.problem, problemBox(error)));
  }

  /** Take a member that was clicked. @param {string} name */
  take(name) {
    const wanted = this._wanted().length;
    if (!wanted || !this.report.assets.some((/** @type {any} */ asset) => asset.name === name)) return;
    this.members[this.turn % wanted].select.value = name;
    this.turn += 1;
    this._changed();
  }

  /** @param {number} number */
  _select(number) {
    const id = uniqueId("member");
    const select = h("select", { id, on: { change: () => this._changed() } }, this.report.assets.map((/** @type {any} */ { name }) => h("option", { value: name }, name)));
    select.selectedIndex = number;
    const label = h("label", { class: "field-label", for: id });
    return { select, label, row: h("div", { class: "field" }, label, select) };
  }

  _wanted() {
    return MODES.find(([mode]) => mode === this.mode)?.[2] ?? [];
  }

  /** @param {string} mode */
  _choose(mode) {
    this.mode = mode;
    this.turn = 0;
    const wanted = this._wanted();
    for (const [number, { row, label }] of this.members.entries()) {
      row.hidden = number >= wanted.length;
      fill(label, wanted[number] ?? "");
    }
    this.hint.hidden = !wanted.length;
    this.keep.hidden = mode !== "complete";
    this.form.rename(mode === "search" ? "Find shapes" : "Make shapes");
    this._changed();
  }

  _changed() {
    const chosen = this._members();
    this.onMembers(chosen);
    if (this.mode !== "complete") return;
    const kept = this._kept();
    const { parts } = this.report.assets.find((/** @type {any} */ asset) => asset.name === chosen[0]);
    const boxes = parts.map((/** @type {string} */ part) => h("label", { class: "check" }, h("input", { type: "checkbox", value: part, ".checked": kept.includes(part) }), part));
    fill(this.keep, /** @type {HTMLElement} */ (this.keep.firstElementChild), boxes);
  }

  /** @returns {string[]} */
  _members() {
    return this._wanted().map((_, number) => this.members[number].select.value);
  }

  /** @returns {string[]} */
  _kept() {
    return [...this.keep.querySelectorAll("input")].filter(({ checked }) => checked).map(({ value }) => value);
  }

  async _send() {
    fill(this.problem);
    const keep = this.mode === "complete" ? { keep: this._kept() } : {};
    const params = { ...this.numbers.values(), mode: this.mode, members: this._members(), ...keep };
    const files = { family: { job_id: this.job.id, artifact: FAMILY }, collection: await this._collection() };
    const job = await client.submit(null, { kind: "family_synthesize", params }, { files, signal: this.scope.signal });
    return routeHash({ name: "job", id: job.id });
  }

  /** The assets with their parts, if the job wrote them; else the collection again. */
  async _collection() {
    if (this.artifacts.includes(LABELLED)) return { job_id: this.job.id, artifact: LABELLED };
    return new File([await client.file(this.job.id, "collection", this.scope.signal)], "collection.zip");
  }
}
