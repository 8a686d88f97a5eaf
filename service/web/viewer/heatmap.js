// @ts-check
/** Values of vertices as colours on a mesh, with the data of a legend. */
import {
  BufferAttribute,
  DataTexture,
  DoubleSide,
  LinearFilter,
  MeshStandardMaterial,
  SRGBColorSpace,
} from "../vendor/three/three.module.js";
import { colorRow, cssGradient, pieceColors, positionOf, ticks } from "./colormaps.js";

/** @typedef {import("./deformation.js").Measured} Measured */
/** @typedef {import("./deformation.js").Measure} Measure */
/**
 * @typedef {object} Legend
 * @property {Measure} kind
 * @property {string} label what is measured
 * @property {string} unit of min, max and p99: "units" of the file, which does not name its own; "×" for factors
 * @property {number} min
 * @property {number} max
 * @property {number} p99 99 % of the vertices (displacement) or faces (others) are below
 * @property {string} problem why there is nothing to see, or empty
 * @property {"linear" | "log"} scale
 * @property {[number, number]} range values at the ends of the colours; what is above has the last one
 * @property {string} gradient the colours as a CSS image, from left to right
 * @property {{ text: string, at: number }[]} ticks `at` is 0..1 from the left
 */

/** @type {Record<Measure, { map: import("./colormaps.js").ColormapName, label: string, unit: string, scale: "linear" | "log" }>} */
const KINDS = {
  displacement: { map: "viridis", label: "Displacement", unit: "units", scale: "linear" },
  stretch: { map: "plasma", label: "Stretch", unit: "×", scale: "log" },
  texture: { map: "plasma", label: "Texture stretch", unit: "×", scale: "log" },
};

// About two pixels wide, however the surface is turned.
const ISOLINES = `float level = vHeat * COUNT;
          float beside = abs(level - floor(level + 0.5)) / max(fwidth(level), 1e-6);
          if (vHeat >= 0.0) heatColor *= mix(0.25, 1.0, smoothstep(0.6, 1.4, beside));`;

/** @param {Measure} kind @param {Measured} measured @returns {Legend} */
export function makeLegend(kind, measured) {
  const { map, label, unit, scale } = KINDS[kind];
  const { min, max, p99 } = measured;
  /** @type {[number, number]} */
  const range = kind !== "displacement" ? [1, Math.max(p99, 1.05)] : [0, p99 > 0 ? p99 : max];
  const legend = { range, scale };
  return {
    kind,
    label,
    unit,
    min,
    max,
    p99,
    problem: measured.count > 0 ? "" : "Nothing here has a texture.",
    ...legend,
    gradient: cssGradient(map),
    ticks: ticks(legend),
  };
}

/** @param {import("./colormaps.js").ColormapName} map @returns {DataTexture} its colours in a row */
export function colorTexture(map) {
  const colors = new DataTexture(colorRow(map), 256, 1);
  colors.colorSpace = SRGBColorSpace;
  colors.magFilter = colors.minFilter = LinearFilter;
  colors.needsUpdate = true;
  return colors;
}

/** @param {number} count @returns {DataTexture} a colour for each piece; that of piece k lies at (k + 0.5) / count */
export function pieceTexture(count) {
  const colors = new DataTexture(Uint8Array.from(pieceColors(count).flatMap((color) => [...color, 255])), count, 1);
  colors.colorSpace = SRGBColorSpace;
  colors.needsUpdate = true;
  return colors;
}

/** A material that colours by the attribute `heat` (0..1; below 0: no value), evenly lit so that the colours stay true. */
export class HeatMaterial extends MeshStandardMaterial {
  /**
   * @param {DataTexture} colors
   * @param {boolean} flatShading
   * @param {number} [isolines] so many between 0 and 1
   * @param {boolean} [whole] A triangle has one colour, that of one of its corners.
   */
  constructor(colors, flatShading, isolines = 0, whole = false) {
    super({ roughness: 1, metalness: 0, side: DoubleSide, flatShading });
    this.toneMapped = false;
    const passed = `${whole ? "flat " : ""}varying float vHeat;`;
    this.onBeforeCompile = (/** @type {import("three").WebGLProgramParametersWithUniforms} */ shader) => {
      shader.uniforms.heatColors = { value: colors };
      shader.vertexShader = shader.vertexShader
        .replace("#include <common>", `#include <common>\nattribute float heat;\n${passed}`)
        .replace("#include <begin_vertex>", "#include <begin_vertex>\nvHeat = heat;");
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <common>", `#include <common>\nuniform sampler2D heatColors;\n${passed}`)
        .replace(
          "#include <opaque_fragment>",
          `vec3 heatColor = vHeat < -0.5 ? vec3(0.2) : texture2D(heatColors, vec2(clamp(vHeat, 0.0, 1.0), 0.5)).rgb;
          ${isolines ? ISOLINES.replace("COUNT", isolines.toFixed(1)) : ""}
          float light = clamp(dot(outgoingLight, vec3(0.2126, 0.7152, 0.0722)), 0.0, 1.0);
          outgoingLight = heatColor * mix(0.55, 1.08, sqrt(light));
          #include <opaque_fragment>`,
        );
    };
    this.customProgramCacheKey = () => `heat ${isolines} ${whole}`;
  }
}

/** Colours on the meshes of a deformation; `dispose` puts their materials back. */
export class Heatmap {
  /** @param {import("./deformation.js").Deformation} deformation @param {Measure} kind */
  constructor(deformation, kind) {
    const measured = deformation.measure(kind);
    this.legend = makeLegend(kind, measured);
    this.colors = colorTexture(KINDS[kind].map);
    this.parts = deformation.blends.map(({ mesh, geometry }, i) => {
      const heat = Float32Array.from(measured.vertices[i], (value) =>
        Number.isFinite(value) ? Math.min(Math.max(positionOf(value, this.legend), 0), 1) : -1,
      );
      geometry.setAttribute("heat", new BufferAttribute(heat, 1));
      const part = { mesh, geometry, material: mesh.material };
      mesh.material = new HeatMaterial(this.colors, !geometry.hasAttribute("normal"));
      return part;
    });
  }

  dispose() {
    for (const { mesh, geometry, material } of this.parts) {
      /** @type {HeatMaterial} */ (mesh.material).dispose();
      mesh.material = material;
      geometry.deleteAttribute("heat");
    }
    this.colors.dispose();
  }
}
