// @ts-check
/** The examples, and one of them: its result at once, and the same job live on demand. */
import { announce } from "../announce.js";
import { exampleAsset } from "../assets.js";
import { readVerdict } from "../../client/index.js";
import { client, isAbort } from "../client.js";
import { exampleOrigin } from "../create/origins.js";
import { DEMO } from "../demo.js";
import { button, fill, h, icon } from "../dom.js";
import { forgetDraftOf } from "../drafts.js";
import { goalWords } from "../format.js";
import { slider } from "../job/stage-controls.js";
import { COLOURS, PairStage } from "../pair-stage.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { verdictBadge } from "../verdict.js";
import { exampleCards, gallery } from "./gallery.js";
import { Moves } from "./moves.js";

/** @typedef {import("./gallery.js").Example} Example */

/** Percent: straight lines lead beyond the result. */
const STRONGEST = 150;

/** Show all examples. @param {HTMLElement} root @param {import("../scope.js").Scope} scope */
export async function showExamples(root, scope) {
  const lead = h("p", { class: "lead" }, DEMO ? "Look at a result, or at a job as it ran. To deform your own files, install Meshdeform." : "Look at a result, then run it yourself.");
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
    this.busy = false;
    this.problem = h("div", { class: "problem-slot", "aria-live": "polite" });
    fill(root, h("p", { class: "loading", role: "status" }, "Loading the example…"));
    this._open(id);
  }

  /** @param {string} id */
  async _open(id) {
    const back = h("a", { class: "button", href: routeHash({ name: "examples" }) }, "All examples");
    try {
      const example = (await gallery(this.scope.signal)).find((found) => found.id === id);
      if (this.scope.over) return;
      if (example) await this._build(example);
      else fill(this.root, h("h1", null, "Not found"), h("p", { class: "lead" }, `There is no example ${id}.`), back);
    } catch (error) {
      if (!this.scope.over && !isAbort(error)) fill(this.root, h("h1", { class: "visually-hidden" }, "Example"), problemBox(error, back));
    }
  }

  /** @param {Example} example */
  async _build(example) {
    const { document: asked, label } = example;
    const title = goalWords(asked);
    const verdict = readVerdict(example.report);
    this.start = button("Run it", () => this._run(example), { icon: "play", class: "button-primary", title: "Start this job now, with the same variation" });
    this.stage = new PairStage(this.scope, {
      label: "Before and after",
      tags: ["Before", "After"],
      colours: COLOURS,
    });
    const strength = slider("strength-slider", "Strength", STRONGEST, () => this._strengthen());
    strength.input.value = "100";
    this.strength = strength;
    /** What the slider leads to, where it is not the result. */
    this.label = "";
    this.stage.element.append(strength.row);
    fill(
      this.root,
      h(
        "header",
        { class: "job-head" },
        h("a", { class: "back", href: routeHash({ name: "examples" }) }, icon("back"), "Examples"),
        h("h1", { class: "prompt-title" }, `“${title}”`),
        h("p", { class: "row meta" }, label),
        DEMO ? null : h("div", { class: "row", role: "group", "aria-label": "Actions" }, this.start, button("Change it first", () => this._edit(example), { icon: "edit" })),
      ),
      h(
        "div",
        { class: "job" },
        this.stage.element,
        h(
          "div",
          { class: "job-side" },
          this.problem,
          DEMO ? null : h("p", { class: "panel small" }, "This result came with the page. “Run it” starts the same job, with the same variation, on this server, and shows every shape on the way."),
          verdict ? h("div", { class: "panel" }, h("p", null, verdictBadge(verdict)), h("p", null, verdict.reasons.join(" "))) : null,
        ),
      ),
    );
    document.title = `${title} · Meshdeform`;
    const [source, result] = await Promise.all([example.asset, example.result].map((name) => exampleAsset(name, this.scope.signal)));
    const bytes = await Promise.all([source.bytes(), result.bytes()]);
    if (this.scope.over) return;
    strength.row.hidden = !(await this.stage.show(bytes[0], bytes[1]));
    this._strengthen();
    if (DEMO && !strength.row.hidden) await this._recorded(example.id, bytes[1]);
  }

  /** Offer what needs a server elsewhere. @param {string} id @param {ArrayBuffer} result */
  async _recorded(id, result) {
    const response = await fetch(new URL(`recorded/${id}.json`, document.baseURI), { signal: this.scope.signal });
    if (!response.ok || !this.stage || this.scope.over) return;
    this.moves = new Moves(await response.json(), this.stage.views[1], result, this.scope, (label) => {
      this.label = label;
      this._strengthen();
    });
    this.strength?.row.before(this.moves.element);
  }

  _strengthen() {
    if (!this.strength || !this.stage) return;
    const { input, value } = this.strength;
    this.stage.views[1].viewer?.setMorph(Number(input.value) / 100);
    value.textContent = `${input.value}%`;
    input.setAttribute("aria-valuetext", `${input.value} percent`);
    fill(this.stage.views[1].tag, ["After", this.label].filter(Boolean).join(" · "));
    this.moves?.follow();
  }

  /** Open the form with the example's settings, not with those that were changed there before. @param {Example} example */
  _edit({ id }) {
    forgetDraftOf(exampleOrigin(id));
    location.hash = routeHash({ name: "create", from: null, example: id });
  }

  /** Start the job that made the result. @param {Example} example */
  async _run({ asset: name, document: asked }) {
    if (this.busy || !this.start) return;
    this.busy = true;
    this.start.setAttribute("aria-disabled", "true");
    fill(this.problem);
    try {
      const asset = await exampleAsset(name, this.scope.signal);
      const job = await client.submit(...(await asset.submission(asked)));
      if (!this.scope.over) location.hash = routeHash({ name: "job", id: job.id });
    } catch (error) {
      if (this.scope.over || isAbort(error)) return;
      fill(this.problem, problemBox(error));
      announce("The job did not start");
    } finally {
      this.busy = false;
      this.start.removeAttribute("aria-disabled");
    }
  }
}
