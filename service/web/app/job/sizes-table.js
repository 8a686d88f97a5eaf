// @ts-check
/** The bytes of a field beside those of the same meshes with Draco and meshopt, which the job's report has. */
import { fill, h } from "../dom.js";
import { bytes, counted } from "../format.js";

/**
 * @param {HTMLElement} table
 * @param {any} report
 * @param {{bytes: number, time: string, faces: number}} field What was loaded, how long it took to unfold, and to how many triangles.
 */
export function sizesTable(table, report, field) {
  const packed = report?.packed;
  table.hidden = !packed;
  if (!packed) return;
  const top = `level ${report.levels.at(-1).level}`;
  const rows = [["This field", counted(field.faces, "triangle"), bytes(field.bytes), field.time]];
  for (const [what, { faces, bits, draco, meshopt }] of [["input", packed.input], [top, packed.top_level]])
    for (const [name, found] of [["Draco", draco], ["meshopt", meshopt]])
      rows.push([`${name}, ${what}, ${bits} bits`, counted(faces, "triangle"), found ? bytes(found.bytes) : "not installed", found ? `${found.unpack_ms.toFixed(1)} ms where the job ran` : ""]);
  const cell = (/** @type {string} */ text, /** @type {number} */ i) => h(i ? "td" : "th", i ? null : { scope: "row" }, text);
  fill(
    table,
    h("caption", { class: "small muted" }, "As precise as the field: what other formats need"),
    h("thead", null, h("tr", null, ["What", "Triangles", "Bytes", "To unpack"].map((text) => h("th", { scope: "col" }, text)))),
    h("tbody", null, rows.map((row) => h("tr", null, row.map(cell)))),
  );
}
