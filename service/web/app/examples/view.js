// @ts-check
/** The examples; and without a server one of them, with what was recorded of it. With one, the workbench shows it. */
import { exampleAsset } from "../assets.js";
import { readVerdict } from "../../client/index.js";
import { client, isAbort } from "../client.js";
import { AssetPanel } from "../create/asset-panel.js";
import { Comparison } from "../create/comparison.js";
import { ShareSlider } from "../create/share-slider.js";
import { DEMO } from "../demo.js";
import { fill, h, icon } from "../dom.js";
import { goalWords } from "../format.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { verdictBadge, verdictWords } from "../verdict.js";
import { movingTools } from "../viewer-box.js";
import { exampleCards, exampleOf, gallery } from "./gallery.js";
import { Moves } from "./moves.js";

/** @typedef {import("./gallery.js").Example} Example */

/** Show all examples. @param {HTMLElement} root @param {import("../scope.js").Scope} scope */
export async function showExamples(root, scope) {
  const lead = h("p", { class: "lead" }, DEMO ? "Look at a result, or at a job as it ran. To deform your own files, install Meshdeform." : "Look at a result, then say what else it should become.");
  fill(root, h("h1", null, "Examples"), lead);
  try {
    const examples = await gallery(scope.signal);
    // Below the page's title the cards are one level further up.
    if (!scope.over) root.append(h("h2", { class: "visually-hidden" }, "Prompts"), exampleCards(examples));
  } catch (error) {
    if (!isAbort(error)) root.append(problemBox(error));
  }
}

export class ExampleView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {string} id */
  constructor(root, scope, id) {
    this.root = root;
    this.scope = scope;
    this.assets = new AssetPanel(scope, () => {}, false);
    this.comparison = new Comparison(this.assets, scope);
    this.strength = new ShareSlider("strength", () => this._strengthen());
    this.strength.exaggerate(true);
    /** What the slider leads to, where it is not the result. */
    this.label = "";
    /** @type {Moves | null} */
    this.moves = null;
    fill(root, h("p", { class: "loading", role: "status" }, "Loading the example…"));
    this._open(id);
  }

  /** @param {string} id */
  async _open(id) {
    try {
      const example = await exampleOf(id, this.scope.signal);
      if (!this.scope.over) await this._build(example);
    } catch (error) {
      const back = h("a", { class: "button", href: routeHash({ name: "examples" }) }, "All examples");
      if (!this.scope.over && !isAbort(error)) fill(this.root, h("h1", { class: "visually-hidden" }, "Example"), problemBox(error, back));
    }
  }

  /** @param {Example} example */
  async _build(example) {
    const { assets, comparison, scope } = this;
    const title = goalWords(example.document);
    const verdict = readVerdict(example.report);
    comparison.choices([]);
    assets.addBelow(comparison.element);
    assets.addBelow(movingTools(scope, [comparison.box, assets.box], (ending) => `turntable.${ending}`));
    const head = h(
      "header",
      { class: "job-head" },
      h("a", { class: "back", href: routeHash({ name: "examples" }) }, icon("back"), "Examples"),
      h("h1", { class: "prompt-title" }, `“${title}”`),
      h("p", { class: "row meta" }, verdict ? verdictBadge(verdict) : null, example.label),
    );
    this.column = h("div", { class: "create-form" }, head, verdict ? h("div", { class: "verdict" }, verdictWords(verdict)) : null, this.strength.element);
    fill(this.root, h("div", { class: "bench" }, assets.element, this.column));
    document.title = `${title} · Meshdeform`;
    const [source, result] = await Promise.all([example.asset, example.result].map((name) => exampleAsset(name, scope.signal)));
    await assets.use(source);
    const bytes = await result.bytes();
    if (scope.over || !(await assets.box.deform(bytes.slice(0)))) return;
    this.strength.element.hidden = false;
    comparison.offer(true);
    this._strengthen();
    await this._recorded(example, bytes);
  }

  /** Offer what needs a server elsewhere. @param {Example} example @param {ArrayBuffer} bytes Of its result. */
  async _recorded({ id, document: asked }, bytes) {
    const recorded = await client.json(`recorded/${id}.json`, { signal: this.scope.signal }).catch(() => null);
    if (!recorded || this.scope.over) return;
    this.moves = new Moves(recorded, this.assets.box, { seed: asked.params.seed, bytes }, this.scope, (label) => {
      this.label = label;
      this._strengthen();
    });
    this.column?.append(this.moves.element);
  }

  _strengthen() {
    this.assets.box.viewer?.setMorph(this.strength.share);
    this.assets.box.tag.hidden = false;
    fill(this.assets.box.tag, this.label || "Result");
    this.moves?.follow();
  }
}
