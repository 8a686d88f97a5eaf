// @ts-check
/** The lists of the control panel: a row with its fields for each region, each handle and each length. */
import { button, h, uniqueId } from "../../dom.js";
import { counted } from "../../format.js";
import { AXES, facesOf, facesText, regionWords } from "./model.js";

/**
 * @typedef {object} Row
 * @property {HTMLElement} element
 * @property {(anew?: boolean) => void} update Show the values again, but for a field that is being typed in or is wrong; `anew`: all.
 */

/**
 * A field for a number.
 *
 * @param {string} label For screen readers.
 * @param {() => number | null | undefined} get
 * @param {(value: number | null) => void} set Null where the field is empty and may be.
 * @param {{optional?: boolean, placeholder?: string}} [options]
 */
export function numberField(label, get, set, { optional = false, placeholder = "" } = {}) {
  const input = h("input", { type: "text", inputmode: "decimal", class: "number", autocomplete: "off", "aria-label": label, placeholder: placeholder || null });
  const show = (anew = false) => {
    if (!anew && (document.activeElement === input || input.hasAttribute("aria-invalid"))) return;
    const value = get();
    input.value = value === null || value === undefined ? "" : String(Number(value.toPrecision(6)));
    input.removeAttribute("aria-invalid");
  };
  input.addEventListener("input", () => {
    const text = input.value.trim().replace(",", ".");
    const wrong = text === "" ? !optional : !Number.isFinite(Number(text));
    if (wrong) input.setAttribute("aria-invalid", "true");
    else input.removeAttribute("aria-invalid");
    set(wrong ? /** @type {any} */ (get()) : text === "" ? null : Number(text));
  });
  show();
  return { input, show };
}

/**
 * @param {string} name
 * @param {() => number[]} get
 * @param {(place: number[]) => void} set
 */
export function placeFields(name, get, set) {
  const fields = AXES.map((axis, i) =>
    numberField(`${name} ${axis}`, () => get()[i], (value) => set(get().map((old, at) => (at === i ? Number(value) : old)))),
  );
  const element = h("div", { class: "place" }, h("span", { class: "small muted" }, name), fields.map(({ input }) => input));
  return { element, show: () => fields.forEach((field) => field.show()) };
}

/** @param {string} words @param {() => void} remove @param {...(Node | null)} parts */
function frame(words, remove, ...parts) {
  const title = h("strong", null, words);
  const element = h(
    "li",
    { class: "control-row", "aria-label": words },
    h("div", { class: "control-head" }, title, ...parts.slice(0, 1), button(`Remove ${words.toLowerCase()}`, remove, { icon: "trash", quiet: true, class: "button-quiet" })),
    ...parts.slice(1),
  );
  return { element, title };
}

/**
 * @param {import("./model.js").Region} region Changed by the fields.
 * @param {number} number
 * @param {object} context
 * @param {() => void} context.changed
 * @param {() => void} context.moved Called when it is for something else.
 * @param {[string, string][]} context.purposes What a region can be for: values of `action`, and words.
 * @param {() => void} context.remove
 * @param {(() => void) | null} context.edit Take the box into the view; null where there is none.
 * @param {() => number | null} context.selected How many triangles it selects; null: only the service knows.
 * @returns {Row}
 */
export function regionRow(region, number, { changed, moved, purposes, remove, edit, selected }) {
  const action = h("select", { class: "select-small", "aria-label": `Region ${number}: what happens to it` }, purposes.map(([value, text]) => h("option", { value }, text)));
  action.value = region.action ?? "keep";
  action.addEventListener("change", () => {
    region.action = action.value;
    moved();
  });
  const shows = /** @type {(() => void)[]} */ ([]);
  const more = [];
  if (region.box) {
    for (const end of /** @type {const} */ (["min", "max"])) {
      const fields = placeFields(end === "min" ? "From" : "To", () => region.box[end], (place) => {
        region.box[end] = place;
        changed();
      });
      shows.push(fields.show);
      more.push(fields.element);
    }
    if (edit) more.push(h("div", null, button("Drag in the view", edit, { class: "chip chip-small" })));
  }
  if (region.faces) {
    const id = uniqueId("faces");
    const input = h("input", { type: "text", id, autocomplete: "off", placeholder: "0-12, 40" });
    input.addEventListener("input", () => {
      const faces = facesOf(input.value);
      if (!faces) return void input.setAttribute("aria-invalid", "true");
      input.removeAttribute("aria-invalid");
      region.faces = faces;
      changed();
    });
    const show = () => {
      if (document.activeElement === input || input.hasAttribute("aria-invalid")) return;
      input.value = facesText(region.faces);
    };
    show();
    shows.push(show);
    more.push(h("div", { class: "place" }, h("label", { class: "small muted", for: id }, "Triangles"), input));
  }
  const { element, title } = frame(`Region ${number}`, remove, action, ...more);
  const update = () => {
    const count = selected();
    const words = regionWords(region);
    title.textContent = count === null || region.faces ? words : `${words}, ${counted(count, "triangle")}`;
    element.classList.toggle("control-empty", count === 0);
    action.value = region.action ?? "keep";
    for (const show of shows) show();
  };
  update();
  return { element, update };
}

/**
 * @param {import("./model.js").Handle} handle Changed by the fields.
 * @param {number} number
 * @param {() => void} changed
 * @param {() => void} remove
 * @returns {Row}
 */
export function handleRow(handle, number, changed, remove) {
  const point = handle.position
    ? placeFields("Point", () => handle.position ?? [], (place) => {
        handle.position = place;
        changed();
      })
    : { element: h("p", { class: "small muted" }, `Vertex ${handle.vertex}`), show: () => {} };
  const goal = placeFields("Goes to", () => handle.to, (place) => {
    handle.to = place;
    changed();
  });
  const { element } = frame(`Handle ${number}`, remove, null, point.element, goal.element);
  return {
    element,
    update: () => {
      point.show();
      goal.show();
    },
  };
}

/**
 * @param {string} axis
 * @param {() => import("./model.js").Limit | undefined} get
 * @param {(limit: import("./model.js").Limit | undefined) => void} set
 * @returns {Row}
 */
export function lengthRow(axis, get, set) {
  const kind = h(
    "select",
    { class: "select-small", "aria-label": `Length along ${axis}` },
    [["free", "Free"], ["keep", "Kept"], ["limits", "Limits"]].map(([value, text]) => h("option", { value }, text)),
  );
  const bound = (/** @type {"min" | "max"} */ end, /** @type {string} */ words) =>
    numberField(`${words} length along ${axis}, times that of the asset`, () => /** @type {any} */ (get())?.[end] ?? null, (value) => set({ .../** @type {any} */ (get()), [end]: value }), { optional: true, placeholder: "no limit" });
  const [low, high] = [bound("min", "Least"), bound("max", "Greatest")];
  const limits = h("div", { class: "limits" }, low.input, h("span", { class: "small muted", "aria-hidden": "true" }, "to"), high.input, h("span", { class: "small muted", "aria-hidden": "true" }, "×"));
  kind.addEventListener("change", () => {
    set(kind.value === "keep" ? "keep" : kind.value === "limits" ? { min: null, max: null } : undefined);
    update(true);
  });
  const update = (anew = false) => {
    const limit = get();
    kind.value = limit === "keep" ? "keep" : limit ? "limits" : "free";
    limits.hidden = kind.value !== "limits";
    low.show(anew);
    high.show(anew);
  };
  const element = h("div", { class: "length-row" }, h("span", null, axis), kind, limits);
  update();
  return { element, update };
}

/** @param {number[]} place To about four digits of the asset's size. @param {number} size */
export function rounded(place, size) {
  const step = 10 ** Math.floor(Math.log10(Math.max(size, 1e-12)) - 3);
  return place.map((value) => Number((Math.round(value / step) * step).toPrecision(7)));
}

