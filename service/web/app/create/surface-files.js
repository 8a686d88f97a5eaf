// @ts-check
/** What a surface fit takes besides its asset: a base of its own, and values to learn along it. */
import { Asset, FORMATS } from "../assets.js";
import { announce } from "../announce.js";
import { button, fill, h } from "../dom.js";
import { bytes } from "../format.js";
import { fileInput } from "../picking.js";
import { markField } from "./field-rows.js";

/** @type {Record<string, { label: string, choose: string, formats: string[], help: string }>} */
const PARTS = {
  base: { label: "Base mesh", choose: "Choose a base", formats: FORMATS, help: "Instead of one made from the surface: at most 4,000 faces; its holes may be others." },
  scalars: { label: "Scalars", choose: "Choose scalars", formats: ["npz"], help: "Values at points near the surface (NPZ): temperatures, or the piece of each point. The field keeps them." },
};

export class SurfaceFiles {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {Record<string, Asset>} By the names of their parts. */
    this.parts = {};
    this.rows = Object.fromEntries(Object.keys(PARTS).map((part) => [part, this._row(part)]));
    this.element = h("div", { class: "surface-files" }, Object.values(this.rows).map(({ element }) => element));
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
}
