// @ts-check
/** The lists of the control panel: a row with its fields for each region and each handle, and the parts of an asset in words. */
import { button, h, invalid, uniqueId } from "../../dom.js";
import { counted } from "../../format.js";
import { AXES, facesOf, facesText, regionWords } from "./model.js";

/**
 * @typedef {object} Row
 * @property {HTMLElement} element
 * @property {(anew?: boolean) => void} update Show the values again, but for a field that is being typed in or is wrong; `anew`: all.
 */

/** A field for a number. @param {string} label For screen readers. @param {() => number | null | undefined} get @param {(value: number) => void} set */
export function numberField(label, get, set) {
  const input = h("input", { type: "text", inputmode: "decimal", class: "number", autocomplete: "off", "aria-label": label });
  const show = (anew = false) => {
    if (!anew && (document.activeElement === input || input.hasAttribute("aria-invalid"))) return;
    const value = get();
    input.value = value === null || value === undefined ? "" : String(Number(value.toPrecision(6)));
    input.removeAttribute("aria-invalid");
  };
  input.addEventListener("input", () => {
    const text = input.value.trim().replace(",", ".");
    const wrong = text === "" || !Number.isFinite(Number(text));
    invalid(input, wrong);
    set(wrong ? /** @type {any} */ (get()) : Number(text));
  });
  show();
  return { input, show };
}

/** @param {string} name @param {() => number[]} get @param {(place: number[]) => void} set */
export function placeFields(name, get, set) {
  const fields = AXES.map((axis, i) =>
    numberField(`${name} ${axis}`, () => get()[i], (value) => set(get().map((old, at) => (at === i ? value : old)))),
  );
  const element = h("div", { class: "place" }, h("span", { class: "small muted" }, name), fields.map(({ input }) => input));
  return { element, show: () => fields.forEach((field) => field.show()) };
}

/** @param {string} words @param {() => void} remove @param {...(Node | null)} parts */
export function frame(words, remove, ...parts) {
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
      invalid(input, !faces);
      if (!faces) return;
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

/** @param {number[]} place To about four digits of the asset's size. @param {number} size */
export function rounded(place, size) {
  const step = 10 ** Math.floor(Math.log10(Math.max(size, 1e-12)) - 3);
  return place.map((value) => Number((Math.round(value / step) * step).toPrecision(7)));
}

/** @typedef {{index: number, name: string}} Named */
/** @typedef {{nodes: Named[], materials: Named[], mesh_names: Named[]}} Parts */

/** The name of a part, or its number where no name says which it is. @param {Named} part @param {Named[]} all */
export function named(part, all) {
  return part.name && all.filter(({ name }) => name === part.name).length === 1 ? part.name : part.index;
}

/** The parts of an asset, to choose one; a value is a selection as JSON. @param {Parts} parts */
export function partOptions({ nodes, materials }) {
  const group = (/** @type {string} */ kind, /** @type {string} */ label, /** @type {Named[]} */ list) =>
    h("optgroup", { label }, list.map((part) => h("option", { value: JSON.stringify({ [kind]: named(part, list) }) }, part.name || `${kind} ${part.index}`)));
  return [group("node", "Nodes", nodes), group("material", "Materials", materials)];
}
