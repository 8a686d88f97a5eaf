// @ts-check
/** The form for a family: a collection of assets, of which a job finds the parts, the correspondences and a model. */
import { client, errorsOf, isAbort, MeshdeformError } from "../client.js";
import { intro, JobForm, showForm } from "../create/form.js";
import { NumberRows } from "../create/field-rows.js";
import { fill, h } from "../dom.js";
import { recentJobs } from "../jobs/card.js";
import { MeshZone } from "../mesh-zone.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";

export const KIND = "family_fit";
/** What most collections need; the others stand under Advanced. */
const FIRST = ["points", "parts"];

export class FamilyView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {string | null} from A job to begin with. */
  constructor(root, scope, from) {
    this.scope = scope;
    this.zone = new MeshZone(scope, {
      id: "family-files",
      hint: "10 to 3,000 GLB, OBJ, PLY or STL, each a whole asset, upright; or one ZIP of them. Or drop them on this page. A labels.json names the parts of some.",
      empty: "Ten labelled assets are enough to name the parts of all.",
      further: ["labels.json"],
      sample: "chairs.zip",
    });
    this.numbers = new NumberRows(KIND, FIRST, () => {});
    this.turn = h("input", { id: "family-turn", type: "checkbox", ".checked": true });
    this.problem = h("div", { class: "problem-slot" });
    this.form = new JobForm(scope, "New family", "Find the family", { ready: () => this._ready(), send: () => this._send(), refuse: (error) => this._refuse(error) });
    this.form.element.append(
      this.numbers.first,
      h("label", { class: "check", for: "family-turn" }, this.turn, "Turn assets until all face one way"),
      this.problem,
      this.numbers.advanced,
      this.form.bar("A minute for some dozens of assets. The page may be closed meanwhile."),
    );
    showForm(root, "family", intro("What they have", "in common", "Parts and matching points on all assets of a collection, and new assets made of their parts."), this.zone, this.form, recentJobs(scope));
    this._begin(from);
  }

  /** @param {string | null} from */
  async _begin(from) {
    try {
      const [job] = await Promise.all([from ? this._again(from) : null, this.numbers.load(this.scope.signal)]);
      if (this.scope.over || !job) return;
      this.numbers.fill(job.params);
      this.turn.checked = job.params.turn;
    } catch (error) {
      if (!this.scope.over && !isAbort(error)) fill(this.problem, problemBox(error));
    }
  }

  /** @param {string} id @returns {Promise<any>} the job whose collection is used again; null where it is of another kind */
  async _again(id) {
    const job = await client.get(id, this.scope.signal);
    if (job.kind !== KIND) return null;
    this.zone.add([new File([await client.file(id, "collection", this.scope.signal)], job.files.collection.filename)]);
    return job;
  }

  _ready() {
    fill(this.problem);
    const settled = this.numbers.settle();
    if (!this.zone.files.length) this.zone.refuse("Choose the assets first.");
    else if (!settled) this.form.focusProblem();
    return settled && this.zone.files.length > 0;
  }

  async _send() {
    // The assets with their parts are what new shapes are made of.
    const params = { ...this.numbers.values(), turn: this.turn.checked, embed_labels: true };
    const job = await client.submit(null, { kind: KIND, params }, { files: { collection: await this.zone.packed("collection.zip") } });
    return routeHash({ name: "job", id: job.id });
  }

  /** @param {unknown} error */
  _refuse(error) {
    const found = error instanceof MeshdeformError ? error : null;
    if (found?.code.startsWith("asset_")) return this.zone.refuse([found.message, found.advice].filter(Boolean).join(" "));
    if (!this.numbers.refuse(errorsOf(error))) fill(this.problem, problemBox(error));
  }
}
