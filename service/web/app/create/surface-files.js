// @ts-check
/** What a surface fit takes besides its asset: a base of its own, pairs of points that belong together, and values to learn along it. */
import { Asset, FORMATS } from "../assets.js";
import { announce } from "../announce.js";
import { button, fill, h, labelled } from "../dom.js";
import { bytes } from "../format.js";
import { fileInput } from "../picking.js";
import { markField } from "./field-rows.js";

/** @type {Record<string, { label: string, choose: string, formats: string[], help: string }>} */
const PARTS = {
  base: { label: "Base mesh", choose: "Choose a base", formats: FORMATS, help: "Instead of one made from the surface: at most 4,000 faces; its holes may be others." },
  scalars: { label: "Scalars", choose: "Choose scalars", formats: ["npz"], help: "Values at points near the surface (NPZ): temperatures, or the piece of each point. The field keeps them." },
};
const MOST_ANCHORS = 256;

/** @typedef {{ base: number[], surface: number[] }} Anchor */

/** Pairs of points, one in each line: `1,0,0 : 0,0,1`, or as `--anchor` has them. @param {string} text @returns {{ anchors: Anchor[], problem: string }} */
export function anchorsOf(text) {
  const lines = text.split("\n").map((line) => line.trim());
  /** @type {Anchor[]} */
  const anchors = [];
  for (const [i, line] of lines.entries()) {
    if (!line) continue;
    const points = line.split(":").map((point) => point.split(",").map((part) => (part.trim() ? Number(part) : NaN)));
    if (points.length !== 2 || points.some((point) => point.length !== 3 || !point.every(Number.isFinite)))
      return { anchors: [], problem: `Line ${i + 1} is not x,y,z : x,y,z.` };
    anchors.push({ base: points[0], surface: points[1] });
  }
  return anchors.length > MOST_ANCHORS ? { anchors: [], problem: `At most ${MOST_ANCHORS} pairs.` } : { anchors, problem: "" };
}

export class SurfaceFiles {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {Record<string, Asset>} By the names of their parts. */
    this.parts = {};
    this.rows = Object.fromEntries(Object.keys(PARTS).map((part) => [part, this._row(part)]));
    this.problem = h("p", { class: "field-problem", id: "anchors-problem", hidden: true, "aria-live": "polite" });
    this.input = h("textarea", { id: "anchors", rows: 3, spellcheck: false, placeholder: "1,0,0 : 0,0,1", "aria-describedby": "anchors-help anchors-problem" });
    this.input.addEventListener("input", () => {
      this.settle();
      this.onChange();
    });
    const help = h("p", { class: "small muted", id: "anchors-help" }, "In each line a point of the base, and the point of the surface where it goes.");
    const anchors = labelled("anchors", "Anchors", this.input, this.problem, help);
    this.element = h("div", { class: "surface-files" }, this.rows.base.element, anchors, this.rows.scalars.element);
  }

  /** @param {string} part */
  _row(part) {
    const { label, choose, formats, help } = PARTS[part];
    const problem = h("p", { class: "field-problem", role: "alert", hidden: true });
    const input = fileInput(`${part}-file`, `${label} file`, formats.map((format) => `.${format}`).join(","), ([file]) => {
      const known = formats.includes(file.name.toLowerCase().split(".").pop() ?? "");
      markField({ input: pick, problem }, known ? "" : `${file.name} isn't supported. Use ${formats.map((format) => format.toUpperCase()).join(", ")}.`);
      if (known) this.use(part, new Asset(file, file.name));
    });
    const pick = button(choose, () => input.click(), { class: "chip" });
    const chosen = h("div", { class: "chips" });
    const element = h("div", { class: "field" }, h("span", { class: "field-label" }, label), h("div", { class: "chips" }, pick, chosen, input), problem, h("p", { class: "small muted" }, help));
    return { element, chosen, pick };
  }

  /** @param {string} part @param {Asset | null} file */
  use(part, file) {
    const { [part]: _, ...others } = this.parts;
    this.parts = file ? { ...others, [part]: file } : others;
    const { chosen, pick } = this.rows[part];
    pick.hidden = file !== null;
    const remove = () => (this.use(part, null), pick.focus());
    fill(chosen, file ? [h("span", null, `${file.name}, ${bytes(file.size)}`), button(`Remove ${file.name}`, remove, { icon: "trash", quiet: true, class: "button-quiet" })] : null);
    announce(file ? `${file.name} is chosen` : `${PARTS[part].label} removed`);
    this.onChange();
  }

  /** @param {Anchor[]} anchors */
  restore(anchors) {
    this.input.value = anchors.map(({ base, surface }) => `${base} : ${surface}`).join("\n");
  }

  /** @returns {Anchor[]} */
  get anchors() {
    return anchorsOf(this.input.value).anchors;
  }

  /** @returns {boolean} whether what was typed can be sent; what cannot is said beside it */
  settle() {
    const { problem } = anchorsOf(this.input.value);
    markField(this, problem);
    return !problem;
  }
}
