// @ts-check
/** The contact sheet of a group, a PNG: a row for each finished variation, a column for each strength. */
import { announce } from "../announce.js";
import { client } from "../client.js";
import { h } from "../dom.js";
import { saveBytes } from "../job/files.js";
import { stemOf } from "../names.js";
import { orToast } from "../problem-box.js";

const STRENGTHS = [50, 100, 130];
const CELL = 320; // pixels
const EDGE = 36; // for the words beside the cells

/** @param {any[]} jobs Finished ones, in order. @param {import("../scope.js").Scope} scope */
export function saveSheet(jobs, scope) {
  announce("Making the contact sheet");
  return orToast("No contact sheet", async () => {
    const { snapshotAsset } = await import("../../viewer/snapshot.js");
    const canvas = h("canvas", { width: EDGE + STRENGTHS.length * CELL, height: EDGE + jobs.length * CELL });
    const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    const style = getComputedStyle(document.body);
    pen.fillStyle = style.backgroundColor;
    pen.fillRect(0, 0, canvas.width, canvas.height);
    Object.assign(pen, { fillStyle: style.color, font: style.font, textAlign: "center", textBaseline: "middle" });
    const words = (/** @type {string} */ text, /** @type {number} */ x, /** @type {number} */ y, turn = 0) => {
      pen.setTransform(new DOMMatrix().translate(x, y).rotate(turn));
      pen.fillText(text, 0, 0, CELL);
      pen.resetTransform();
    };
    STRENGTHS.forEach((strength, x) => words(`${strength}%`, EDGE + (x + 0.5) * CELL, EDGE / 2));
    for (const [y, job] of jobs.entries()) {
      words(`Variation ${job.params?.seed ?? 0}`, EDGE / 2, EDGE + (y + 0.5) * CELL, -90);
      for (const [x, strength] of STRENGTHS.entries()) {
        const query = strength === 100 ? "" : `?strength=${strength / 100}`;
        const shape = await client.bytes(`v1/jobs/${job.id}/artifacts/result.glb${query}`, { signal: scope.signal });
        const picture = await createImageBitmap(await snapshotAsset(shape, { width: CELL, height: CELL }));
        pen.drawImage(picture, EDGE + x * CELL, EDGE + y * CELL);
      }
    }
    const sheet = await new Promise((resolve) => canvas.toBlob(resolve));
    saveBytes(sheet, `${stemOf(jobs[0]).replace(/-seed\d+$/, "")}-variants.png`);
  });
}
