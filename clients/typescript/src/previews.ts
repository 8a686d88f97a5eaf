/** The shapes of a preview: positions of the vertices of `result.glb`, quantised, as `docs/http.md` describes them. */
import { MeshdeformError } from "./errors.js";

/** The positions of one primitive, in its mesh's space. */
export interface PrimitivePositions {
  /** Places in the file. */
  mesh: number;
  primitive: number;
  /** Three numbers for each vertex, in their order in the file. */
  positions: Float32Array;
}

/** What the asset becomes with one seed. */
export interface PreviewShape {
  seed: number;
  primitives: PrimitivePositions[];
  /** What it was fitted to, as in a report; empty for a change in plain words. */
  member: Record<string, unknown>;
  /** Sentences about what of the prompt was read otherwise, or made less of. */
  warnings: string[];
}

export interface PreviewShapes {
  /** SHA-256 of the asset. */
  asset: string;
  /** Whether the prompt is a change in plain words, which is the same with all seeds. */
  change: boolean;
  /** What the asset was read as, as in a report. */
  reading: Record<string, unknown> | null;
  /** Whether a simplified surface was fitted in place of a large asset's, which followed it. */
  draft: boolean;
  shapes: PreviewShape[];
}

const MAGIC = 0x5650444d; // MDPV
const HEAD_BYTES = 12;

/** Read the answer of `preview` with positions. */
export function readPreview(data: ArrayBuffer): PreviewShapes {
  try {
    const view = new DataView(data);
    if (view.getUint32(0, true) !== MAGIC || view.getUint32(4, true) !== 1) throw new RangeError("not of a known version");
    const start = HEAD_BYTES + view.getUint32(8, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, HEAD_BYTES, start - HEAD_BYTES)));
    return { ...header, shapes: header.shapes.map((told: Told) => shape(told, header.primitives, view, start)) };
  } catch (error) {
    throw new MeshdeformError(0, { code: "asset_invalid", detail: "The preview is cut off, or of another version." }, null, { cause: error });
  }
}

interface Told {
  seed: number;
  offset: number;
  low: number[][];
  step: number[][];
  member: Record<string, unknown>;
  warnings?: string[];
}

function shape(told: Told, primitives: { mesh: number; primitive: number; vertices: number }[], view: DataView, start: number): PreviewShape {
  let at = start + told.offset;
  const found = primitives.map(({ mesh, primitive, vertices }, k) => {
    const [low, step] = [told.low[k] as number[], told.step[k] as number[]];
    const positions = new Float32Array(3 * vertices);
    for (let i = 0; i < positions.length; i++) positions[i] = (low[i % 3] as number) + (step[i % 3] as number) * view.getUint16(at + 2 * i, true);
    at += Math.ceil((6 * vertices) / 4) * 4;
    return { mesh, primitive, positions };
  });
  return { seed: told.seed, primitives: found, member: told.member, warnings: told.warnings ?? [] };
}
