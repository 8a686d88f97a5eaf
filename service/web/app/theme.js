// @ts-check
/** Light or dark: as the system says, until the user says otherwise. */
import { fill, h, icon } from "./dom.js";

const NAME = "meshdeform.theme";
const ORDER = /** @type {const} */ (["auto", "light", "dark"]);
const ICONS = { auto: "auto", light: "sun", dark: "moon" };
const WORDS = { auto: "as the system", light: "light", dark: "dark" };

function stored() {
  try {
    const found = localStorage.getItem(NAME);
    return ORDER.find((name) => name === found) ?? "auto";
  } catch {
    return "auto";
  }
}

const DARK = matchMedia("(prefers-color-scheme: dark)");

/** @param {(typeof ORDER)[number]} name */
function apply(name) {
  document.documentElement.dataset.theme = name === "auto" ? (DARK.matches ? "dark" : "light") : name;
}

export function themeSwitch() {
  let current = stored();
  apply(current);
  DARK.addEventListener("change", () => apply(current));
  const control = h("button", { type: "button", class: "button button-quiet button-icon" });
  const show = () => {
    const label = `Theme: ${WORDS[current]}`;
    control.setAttribute("aria-label", label);
    control.title = label;
    fill(control, icon(ICONS[current]));
  };
  control.addEventListener("click", () => {
    current = ORDER[(ORDER.indexOf(current) + 1) % ORDER.length];
    apply(current);
    try {
      localStorage.setItem(NAME, current);
    } catch {
      // It holds while the page is open.
    }
    show();
  });
  show();
  return control;
}
