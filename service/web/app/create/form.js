// @ts-check
/** What the forms for jobs have in common: the heading, the way to the other forms, and a button that starts one at a time. */
import { announce } from "../announce.js";
import { isAbort } from "../client.js";
import { fill, h } from "../dom.js";
import { routeHash } from "../router.js";

/** @typedef {"create" | "many" | "surface" | "family" | "words"} Kind */

/** The kinds of job that have a form. @type {[Kind, string][]} */
const KINDS = [
  ["create", "Deform by words"],
  ["many", "Many files"],
  ["surface", "Fit a surface"],
  ["family", "Find a family"],
  ["words", "Your words"],
];

/** @param {Kind} here */
export function kindsNav(here) {
  const links = KINDS.map(([name, label]) => h("a", { class: "chip chip-small", href: routeHash({ name, from: null }), "aria-current": name === here ? "page" : null }, label));
  return h("nav", { class: "chips kinds", "aria-label": "Kind of job" }, links);
}

/** @param {string} words @param {string} stressed @param {string} lead */
export function intro(words, stressed, lead) {
  return h("div", { class: "intro" }, h("h1", null, `${words} `, h("em", null, stressed)), h("p", { class: "lead" }, lead));
}

/**
 * Fill a view that is a form.
 * @param {HTMLElement} root
 * @param {Kind} kind
 * @param {Node} heading
 * @param {{element: Node}} given Takes the files.
 * @param {JobForm} form
 * @param {Node} below
 */
export function showForm(root, kind, heading, given, form, below) {
  fill(root, heading, kindsNav(kind), h("div", { class: "bench" }, given.element, form.element), below);
}

/** A form, and the button that sends it: one job at a time. */
export class JobForm {
  /**
   * @param {import("../scope.js").Scope} scope
   * @param {string} name Of the form.
   * @param {string} label Of the button.
   * @param {object} does
   * @param {() => boolean} does.ready Whether all can be sent; what cannot is said.
   * @param {() => Promise<string>} does.send Starts jobs, and returns the address that shows them.
   * @param {(error: unknown) => void} does.refuse Says why none started.
   * @param {string} [does.busy] Label of the button meanwhile.
   * @param {string} [does.failed] Announced where none started.
   */
  constructor(scope, name, label, does) {
    this.scope = scope;
    this.label = label;
    this.does = does;
    this.busy = false;
    this.button = h("button", { type: "submit", class: "button button-primary button-large", "aria-describedby": "estimate" }, label);
    this.estimate = h("p", { class: "estimate", id: "estimate", "aria-live": "off" });
    this.element = h("form", { class: "create-form", "aria-label": name, novalidate: true, on: { submit: (/** @type {Event} */ event) => this._submit(event) } });
  }

  /** The bar at the bottom. @param {string} [said] Beside the button, until more is known. */
  bar(said = "") {
    this.estimate.textContent = said;
    return h("div", { class: "start-bar" }, this.estimate, this.button);
  }

  /** @param {string} label Of the button. */
  rename(label) {
    this.label = label;
    if (!this.busy) this.button.textContent = label;
  }

  /** Move the focus to the first field that cannot be sent. */
  focusProblem() {
    /** @type {HTMLElement | null} */ (this.element.querySelector('[aria-invalid="true"]'))?.focus();
  }

  /** @param {Event} event */
  async _submit(event) {
    event.preventDefault();
    if (this.busy || !this.does.ready()) return;
    this.busy = true;
    this.button.setAttribute("aria-disabled", "true");
    this.button.textContent = this.does.busy ?? "Starting…";
    try {
      const hash = await this.does.send();
      if (!this.scope.over) location.hash = hash;
    } catch (error) {
      if (this.scope.over || isAbort(error)) return;
      announce(this.does.failed ?? "The job did not start");
      this.does.refuse(error);
    } finally {
      this.busy = false;
      this.button.removeAttribute("aria-disabled");
      this.button.textContent = this.label;
    }
  }
}
