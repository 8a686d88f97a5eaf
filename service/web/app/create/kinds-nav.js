// @ts-check
/** The kinds of job that have a form. */
import { h } from "../dom.js";
import { routeHash } from "../router.js";

/** @typedef {"create" | "surface" | "family"} Kind */

/** @type {[Kind, string][]} */
const KINDS = [
  ["create", "Deform by words"],
  ["surface", "Fit a surface"],
  ["family", "Find a family"],
];

/** @param {Kind} here */
export function kindsNav(here) {
  const links = KINDS.map(([name, label]) => h("a", { class: "chip chip-small", href: routeHash({ name, from: null }), "aria-current": name === here ? "page" : null }, label));
  return h("nav", { class: "chips kinds", "aria-label": "Kind of job" }, links);
}
