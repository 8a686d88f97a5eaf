// @ts-check
/** All jobs, newest first, in pages, with a search. */
import { announce } from "../announce.js";
import { client, isAbort } from "../client.js";
import { ask } from "../dialogs.js";
import { button, fill, h } from "../dom.js";
import { counted, STATE_WORDS } from "../format.js";
import { isTerminal } from "../history.js";
import { problemBox } from "../problem-box.js";
import { MAX_SEARCH, routeHash } from "../router.js";
import { debounced } from "../scope.js";
import { JobCard } from "./card.js";

const PAGE = 24;
const POLL_MS = 1500;

export class ListView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {{state?: string | null, search?: string}} wanted */
  constructor(root, scope, { state = null, search = "" }) {
    this.scope = scope;
    /** Which jobs are shown; a new one for every search. @type {{limit: number, state: any, search: string}} */
    this.filter = { limit: PAGE, state, search: search.trim() };
    /** @type {Map<string, JobCard>} */
    this.cards = new Map();
    /** @type {Map<string, any>} */
    this.jobs = new Map();
    this.cursor = /** @type {string | null} */ (null);
    this.grid = h("ul", { class: "card-grid" });
    this.problem = h("div", null);
    this.summary = h("p", { class: "lead" });
    this.more = button("Older jobs", () => this._older(), { class: "more" });
    this.more.hidden = true;
    this.search = h("input", { type: "search", id: "job-search", placeholder: "Prompt, file or label", "aria-label": "Search jobs", maxlength: MAX_SEARCH, value: search });
    const find = debounced(() => this._search(state), 250, scope);
    this.search.addEventListener("input", find);
    /** The filter whose jobs are shown. @type {any} */
    this.shown = null;
    this.selecting = false;
    this.select = button("Select", () => this._selectMode(!this.selecting), {});
    this.chosen = h("div", { class: "row select-bar", hidden: true });
    const tools = h("div", { class: "row" }, this.search, filter(state, () => this.search.value.trim()), this.select);
    const head = h("div", { class: "section-head" }, h("h1", null, "Jobs"), tools);
    fill(root, head, this.chosen, this.summary, this.problem, this.grid, this.more);
    this._run();
  }

  async _run() {
    let wait = POLL_MS;
    do {
      // Nobody looks: nothing is asked.
      if (document.hidden && this.jobs.size) continue;
      try {
        await this._newest();
        wait = POLL_MS;
      } catch (error) {
        if (isAbort(error) || this.scope.over) return;
        fill(this.problem, problemBox(error));
        wait = Math.min(15000, wait * 2);
      }
    } while (await this.scope.sleep(this._active() || wait > POLL_MS ? wait : 4 * POLL_MS));
  }

  _active() {
    return [...this.jobs.values()].some((job) => !isTerminal(job.state));
  }

  async _newest() {
    const { filter } = this;
    const page = await client.jobPage({ ...filter, signal: this.scope.signal });
    // An answer to an earlier search is not shown.
    if (this.scope.over || filter !== this.filter) return;
    if (this.problem.childElementCount) fill(this.problem);
    if (filter !== this.shown) for (const id of [...this.cards.keys()]) this._forget(id);
    this.shown = filter;
    const first = !this.jobs.size;
    if (first) this.cursor = page.next_cursor;
    this._drop(page.jobs);
    this._take(page.jobs, true);
    this._words();
  }

  async _older() {
    const { filter } = this;
    if (!this.cursor || filter !== this.shown) return;
    try {
      const page = await client.jobPage({ ...filter, cursor: this.cursor, signal: this.scope.signal });
      if (filter !== this.shown) return;
      this.cursor = page.next_cursor;
      this._take(page.jobs, false);
      this._words();
      this.cards.get(page.jobs[0]?.id)?.title.focus();
      announce(`${counted(page.jobs.length, "older job")} shown`);
    } catch (error) {
      if (!isAbort(error)) fill(this.problem, problemBox(error));
    }
  }

  /** Show the jobs that were searched for; the address remembers the search. @param {string | null} state */
  async _search(state) {
    const text = this.search.value.trim();
    if (text === this.filter.search) return;
    this.filter = { ...this.filter, search: text };
    history.replaceState(null, "", routeHash({ name: "jobs", state, search: text }));
    try {
      await this._newest();
      if (text === this.filter.search && text) announce(this._searchWords());
    } catch (error) {
      if (!isAbort(error) && !this.scope.over) fill(this.problem, problemBox(error));
    }
  }

  _searchWords() {
    if (!this.filter.search) return "";
    const found = counted(this.cards.size, "job");
    return this.cursor ? `The newest ${found} that match.` : `${found} found.`;
  }

  /** @param {boolean} on */
  _selectMode(on) {
    this.selecting = on;
    this.select.setAttribute("aria-pressed", String(on));
    this.grid.classList.toggle("selecting", on);
    this.chosen.hidden = !on;
    if (!on) for (const card of this.cards.values()) card.box.checked = false;
    this._selection();
  }

  /** @returns {JobCard[]} */
  _selected() {
    return [...this.cards.values()].filter(({ box }) => box.checked && !box.disabled);
  }

  _selection() {
    if (!this.selecting) return;
    const chosen = this._selected();
    const all = button("Select all finished", () => {
      for (const { box } of this.cards.values()) box.checked = !box.disabled;
      this._selection();
    }, {});
    const remove = button(`Delete ${counted(chosen.length, "job")}`, () => this._deleteSelected(), { icon: "trash", class: "button-danger" });
    remove.disabled = !chosen.length;
    const compare = button("Compare", () => this._compare(), { icon: "grid", title: "Show two selected jobs side by side" });
    compare.disabled = chosen.length !== 2;
    const focused = this.chosen.contains(document.activeElement);
    fill(this.chosen, all, compare, remove, h("span", { class: "small muted" }, "Two jobs can be compared. Cancel a running job before you delete it."));
    if (focused) all.focus();
  }

  /** Compare the two selected jobs, the older one first. */
  _compare() {
    const [a, b] = this._selected().map(({ id }) => id).sort();
    if (b) location.hash = routeHash({ name: "compare", ids: [a, b] });
  }

  _deleteSelected() {
    const chosen = this._selected();
    ask(
      {
        title: `Delete ${counted(chosen.length, "job")}?`,
        body: [h("p", null, "Their results, steps and assets are deleted too.")],
        action: "Delete",
        danger: true,
        act: async () => {
          for (const { id } of chosen) {
            await client.delete(id);
            this._forget(id);
          }
          this._selectMode(false);
          this._words();
        },
      },
      this.scope,
    );
  }

  /** @param {string} id */
  _forget(id) {
    this.cards.get(id)?.element.remove();
    this.cards.delete(id);
    this.jobs.delete(id);
  }

  /** Remove jobs of the first page that are no longer in it: deleted, or in another state. @param {any[]} jobs */
  _drop(jobs) {
    const ids = new Set(jobs.map((job) => job.id));
    const oldest = jobs.length ? jobs[jobs.length - 1].id : "";
    for (const id of [...this.cards.keys()]) if (!ids.has(id) && id >= oldest) this._forget(id);
  }

  /** @param {any[]} jobs Newest first. @param {boolean} atFront */
  _take(jobs, atFront) {
    for (const job of atFront ? [...jobs].reverse() : jobs) {
      this.jobs.set(job.id, job);
      const known = this.cards.get(job.id);
      if (known) {
        known.show(job);
        continue;
      }
      const card = new JobCard(job, this.scope, { onSelect: () => this._selection() });
      this.cards.set(job.id, card);
      if (atFront && this.grid.childElementCount) this.grid.prepend(card.element);
      else this.grid.append(card.element);
    }
  }

  _words() {
    this.more.hidden = !this.cursor;
    const jobs = [...this.jobs.values()];
    this.select.hidden = !jobs.length;
    if (!jobs.length && this.filter.search) return void fill(this.summary, this._searchWords());
    if (!jobs.length) {
      fill(this.summary, this.filter.state ? "No jobs in this state." : "No jobs yet. ", this.filter.state ? null : h("a", { href: "#/" }, "Create the first one"));
      return;
    }
    fill(this.summary, this._searchWords());
  }
}

/** @param {string | null} chosen @param {() => string} search */
function filter(chosen, search) {
  const select = h(
    "select",
    { id: "state-filter", on: { change: () => (location.hash = routeHash({ name: "jobs", state: select.value || null, search: search() })) } },
    h("option", { value: "" }, "All states"),
    Object.entries(STATE_WORDS).map(([value, words]) => h("option", { value }, words)),
  );
  select.value = chosen ?? "";
  return h("div", { class: "row" }, h("label", { class: "field-label", for: "state-filter" }, "State"), select);
}
