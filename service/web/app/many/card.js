// @ts-check
/** One file of many on the wall: before and after, what it was read as, how far it is, and what can be done with it. */
import { button, chip, fill, h, icon, say } from "../dom.js";
import { percent } from "../format.js";
import { isTerminal, shareDone } from "../history.js";
import { routeHash } from "../router.js";
import { verdictBadge } from "../verdict.js";

/** @typedef {import("./item.js").Item} Item */
/** @typedef {{look: (item: Item) => void, again: (item: Item) => void, remove: (item: Item) => void}} Does */

const GLYPHS = /** @type {Record<string, string>} */ ({ changed: "check", refused: "warn", succeeded: "check", failed: "warn", canceled: "cross", expired: "clock" });
const FAILED = ["refused", "failed", "canceled", "expired"];

export class ManyCard {
  /** @param {Item} item @param {import("../scope.js").Scope} scope @param {Does} does */
  constructor(item, scope, does) {
    this.item = item;
    this.scope = scope;
    this.views = ["Before", "After"].map((tag) => {
      const image = h("img", { alt: "", hidden: true });
      const frame = h("span", { class: "many-view" }, image, h("span", { class: "many-tag" }, tag));
      return { image, frame };
    });
    const name = item.path;
    this.look = h("button", { type: "button", class: "many-look", "aria-label": `Look closer at ${name}`, on: { click: () => does.look(item) } });
    this.noun = h("p", { class: "small muted" });
    this.state = h("span", { class: "badge" });
    this.bar = h("progress", { max: 1, "aria-label": `Progress of ${name}`, hidden: true });
    this.why = h("p", { class: "field-problem", hidden: true });
    this.again = chip("Try again", () => does.again(item));
    this.link = h("a", { class: "chip chip-small", hidden: true }, "Open");
    const remove = button(`Take ${name} off the wall`, () => does.remove(item), { icon: "cross", quiet: true, class: "button-quiet many-remove" });
    this.element = h(
      "li",
      { class: "card many-card" },
      h("div", { class: "card-picture" }, this.views.map(({ frame }) => frame), this.look),
      h("div", { class: "card-text" }, h("h2", null, name), this.noun, h("div", { class: "row card-meta" }, this.state, this.bar), this.why, h("div", { class: "row" }, this.again, this.link)),
      remove,
    );
  }

  /** @param {string} sentence */
  show(sentence) {
    const { item } = this;
    const state = item.state(sentence);
    const job = item.keeps(sentence) ? item.job : null;
    const failed = FAILED.includes(state);
    const failure = state === "refused" ? item.why : failed ? item.failure : null;
    // Those that were kept in several shapes have their words.
    this.noun.textContent = [item.noun, sentence || !item.job ? "" : `“${item.job.prompt}”`].filter(Boolean).join(" · ");
    this.state.className = `badge badge-${state === "refused" ? "failed" : state === "changed" ? "queued" : state}`;
    const glyph = GLYPHS[state];
    this.state.hidden = state === "read";
    if (item.verdict && state === "succeeded") this.state.replaceChildren(verdictBadge(item.verdict));
    else fill(this.state, glyph ? icon(glyph) : null, item.words(sentence));
    this.state.classList.toggle("badge", !(item.verdict && state === "succeeded"));
    this.bar.hidden = !job || isTerminal(job.state);
    if (job && !this.bar.hidden) {
      this.bar.value = shareDone(job.progress);
      this.bar.title = percent(this.bar.value);
    }
    say(this.why, failure ? [failure.title, failure.advice].filter(Boolean).join(" ") : "");
    this.again.hidden = !failed;
    this.link.hidden = !item.job;
    if (item.job) this.link.href = routeHash({ name: "job", id: item.job.id });
    this.element.setAttribute("aria-busy", String(Boolean(item.doing)));
    // A picture of another sentence is none of this one.
    this.views[1].image.hidden = !this.views[1].image.src || !(item.has(sentence) || (job && job.state === "succeeded") || (!sentence && item.made));
    this.views[1].frame.hidden = this.views[1].image.hidden;
  }

  /** @param {(Blob | null)[]} pictures Of before and after; null: as it is. */
  picture(pictures) {
    for (const [k, blob] of pictures.entries()) {
      if (!blob) continue;
      this.views[k].image.src = this.scope.url(blob);
      this.views[k].image.hidden = this.views[k].frame.hidden = false;
    }
  }
}
