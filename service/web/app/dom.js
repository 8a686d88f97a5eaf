// @ts-check
/**
 * Elements by function calls. Text is always a text node: nothing that a user or a server wrote is ever read as HTML.
 *
 * @typedef {Node | string | number | null | undefined | false} Child
 * @typedef {Record<string, any>} Props `class`, `on` (listeners by type), `data`, properties that begin with `.`; all
 *   else are attributes, left out where false, null or undefined.
 */

/**
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Props | null} [props]
 * @param {...(Child | Child[])} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function h(tag, props, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(props ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "class") element.className = value;
    else if (name === "on") for (const [type, listener] of Object.entries(value)) element.addEventListener(type, listener);
    else if (name === "data") Object.assign(element.dataset, value);
    else if (name.startsWith(".")) /** @type {any} */ (element)[name.slice(1)] = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  append(element, children);
  return element;
}

/** @param {Element} parent @param {(Child | Child[])[]} children */
export function append(parent, children) {
  for (const child of children.flat()) {
    if (child === null || child === undefined || child === false) continue;
    parent.append(child instanceof Node ? child : String(child));
  }
}

/**
 * @template {Element} E
 * @param {E} parent
 * @param {...(Child | Child[])} children
 * @returns {E}
 */
export function fill(parent, ...children) {
  parent.replaceChildren();
  append(parent, children);
  return parent;
}

/** Fill a list of buttons anew; the one with the focus keeps it. @param {HTMLElement} list @param {(HTMLElement | null)[]} buttons */
export function refill(list, buttons) {
  const focused = /** @type {HTMLElement} */ (document.activeElement);
  const at = [...list.children].indexOf(focused);
  fill(list, buttons);
  if (at >= 0) /** @type {HTMLElement | undefined} */ (buttons.includes(focused) ? focused : list.children[Math.min(at, list.childElementCount - 1)])?.focus();
}

/** @param {string} tag @param {Record<string, string | number>} attributes @param {...(Node | string)} children @returns {SVGElement} */
function svg(tag, attributes = {}, ...children) {
  const element = /** @type {SVGElement} */ (document.createElementNS("http://www.w3.org/2000/svg", tag));
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

/** Outlines on a grid of 24. */
const ICONS = /** @type {Record<string, string>} */ ({
  upload: "M12 16V5m0 0L7.5 9.5M12 5l4.5 4.5M5 15v3.5A1.5 1.5 0 0 0 6.500 20h11a1.500 1.500 0 0 0 1.500-1.500V15",
  dice: "M5 5h14v14H5zM9 9h.01M15 9h.01M12 12h.01M9 15h.01M15 15h.01",
  link: "M10 14a4 4 0 0 0 5.700 0l3-3a4 4 0 0 0-5.700-5.700l-1 1M14 10a4 4 0 0 0-5.700 0l-3 3a4 4 0 0 0 5.700 5.700l1-1",
  share: "M17 7.800a2.300 2.300 0 1 0 0-4.600 2.300 2.300 0 0 0 0 4.600zM6.500 14.300a2.300 2.300 0 1 0 0-4.600 2.300 2.300 0 0 0 0 4.600zM17 20.800a2.300 2.300 0 1 0 0-4.600 2.300 2.300 0 0 0 0 4.600zM8.500 10.800l6.400-4M8.500 13.200l6.400 4",
  download: "M12 5v10m0 0-4.500-4.500M12 15l4.500-4.500M5 19h14",
  retry: "M5 12a7 7 0 1 1 2.100 5M5 12V7.500M5 12h4.500",
  trash: "M5 7h14M10 7V5h4v2M7 7l1 12h8l1-12",
  stop: "M7 7h10v10H7z",
  check: "m5 12.500 4.500 4.500L19 7.500",
  warn: "M12 4 3 19.500h18zM12 10v4.500M12 17h.01",
  info: "M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18zM12 11v5M12 8h.01",
  cross: "m7 7 10 10M17 7 7 17",
  clock: "M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18zM12 7.500V12l3 2",
  play: "M8 5.500v13l10.500-6.500z",
  key: "M14.500 13.500a4 4 0 1 0-4-4c0 .5.100 1 .3 1.500L4 17.800V20h3v-2h2v-2h1.500l2-2c.6-.3 1.300-.5 2-.5zM15.500 8.500h.01",
  edit: "m5 19 .8-3.800L16 5l3 3L8.800 18.200zM14 7l3 3",
  spark: "M12 3.500 14 10l6.500 2-6.500 2-2 6.500-2-6.500-6.500-2 6.500-2z",
  camera: "M4 8h3.500l1.500-2.500h6L16.500 8H20v11H4zM12 16.500a3.500 3.500 0 1 0 0-7 3.500 3.500 0 0 0 0 7z",
  grid: "M4.500 4.500h6v6h-6zM13.500 4.500h6v6h-6zM4.500 13.500h6v6h-6zM13.500 13.500h6v6h-6z",
  reset: "M4.500 9V4.500H9M19.500 9V4.500H15M4.500 15v4.500H9M19.500 15v4.500H15",
  back: "M19 12H5m0 0 5.500-5.500M5 12l5.500 5.500",
});

/** @param {string} name */
export function icon(name) {
  return svg(
    "svg",
    { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true", focusable: "false" },
    svg("path", { d: ICONS[name] ?? "" }),
  );
}

/**
 * A button with an icon and a label; with `quiet`, the label is for screen readers and the tooltip.
 * @param {string} label
 * @param {() => void} act
 * @param {{icon?: string, class?: string, quiet?: boolean, title?: string}} [options]
 */
export function button(label, act, options = {}) {
  const classes = ["button", options.class ?? "", options.quiet ? "button-icon" : ""].filter(Boolean).join(" ");
  return h(
    "button",
    {
      type: "button",
      class: classes,
      on: { click: act },
      title: options.title ?? (options.quiet ? label : null),
      "aria-label": options.quiet ? label : null,
    },
    options.icon ? icon(options.icon) : null,
    options.quiet ? null : label,
  );
}

/** A small button for what is suggested or can be chosen. @param {string} label @param {() => void} act @param {Props} [props] Further ones; `small: false`: a larger one. */
export function chip(label, act, { small = true, class: more = "", ...props } = {}) {
  return h("button", { type: "button", class: `chip ${small ? "chip-small" : ""} ${more}`, on: { click: act }, ...props }, label);
}

/** The options of a choice. @param {[string, string][]} pairs Values, and words. */
export function options(pairs) {
  return pairs.map(([value, text]) => h("option", { value }, text));
}

/** A panel with a title. @param {string} id Of the title. @param {string} title @param {...(Child | Child[])} children */
export function panel(id, title, ...children) {
  return h("section", { class: "panel", "aria-labelledby": id }, h("div", { class: "panel-head" }, h("h2", { id }, title)), ...children);
}

/** A field with its label. @param {string} id Of the input. @param {string} label @param {...(Child | Child[])} children */
export function labelled(id, label, ...children) {
  return h("div", { class: "field" }, h("label", { class: "field-label", for: id }, label), ...children);
}

/** Say something in an element that is hidden while there is nothing to say. @param {HTMLElement} element @param {string} text */
export function say(element, text) {
  element.hidden = !text;
  element.textContent = text;
}

/** Mark what was typed as wrong, or as right again. @param {Element} input @param {boolean} wrong */
export function invalid(input, wrong) {
  if (wrong) input.setAttribute("aria-invalid", "true");
  else input.removeAttribute("aria-invalid");
}

let ids = 0;

/** An id that no other element of the page has. @param {string} prefix */
export function uniqueId(prefix) {
  ids += 1;
  return `${prefix}-${ids}`;
}
