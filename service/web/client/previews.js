/** The shapes of a preview: positions of the vertices of `result.glb`, quantised, as `docs/http.md` describes them. */
import { MeshdeformError } from "./errors.js";
const MAGIC = 0x5650444d; // MDPV
const HEAD_BYTES = 12;
/** Read the answer of `preview` with positions. */
export function readPreview(data) {
    try {
        const view = new DataView(data);
        if (view.getUint32(0, true) !== MAGIC || view.getUint32(4, true) !== 1)
            throw new RangeError("not of a known version");
        const start = HEAD_BYTES + view.getUint32(8, true);
        const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, HEAD_BYTES, start - HEAD_BYTES)));
        return { ...header, shapes: header.shapes.map((told) => shape(told, header.primitives, view, start)) };
    }
    catch (error) {
        throw new MeshdeformError(0, { code: "asset_invalid", detail: "The preview is cut off, or of another version." }, null, { cause: error });
    }
}
function shape(told, primitives, view, start) {
    let at = start + told.offset;
    const found = primitives.map(({ mesh, primitive, vertices }, k) => {
        const [low, step] = [told.low[k], told.step[k]];
        const positions = new Float32Array(3 * vertices);
        for (let i = 0; i < positions.length; i++)
            positions[i] = low[i % 3] + step[i % 3] * view.getUint16(at + 2 * i, true);
        at += Math.ceil((6 * vertices) / 4) * 4;
        return { mesh, primitive, positions };
    });
    return { seed: told.seed, primitives: found, member: told.member, warnings: told.warnings ?? [] };
}
