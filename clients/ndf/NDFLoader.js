// @ts-check
/** Loads `.ndf` files into three.js. Levels come from the one file, when they are needed. */
import { BufferAttribute, BufferGeometry, Color, FileLoader, Loader, Mesh, SRGBColorSpace } from "three";
import { readField, scalarsAt, unfold } from "./ndf.js";

const MOST_LEVEL = 4;
const MOST_FACES = 1_000_000;

export class NDFLoader extends Loader {
  /** @param {import("three").LoadingManager} [manager] */
  constructor(manager) {
    super(manager);
    this.level = 2;
  }

  /** @param {number} level Every edge of the base in 2^level parts. */
  setLevel(level) {
    this.level = level;
    return this;
  }

  /**
   * @param {string} url
   * @param {(geometry: BufferGeometry) => void} onLoad
   * @param {(event: ProgressEvent) => void} [onProgress]
   * @param {(error: unknown) => void} [onError]
   */
  load(url, onLoad, onProgress, onError) {
    const loader = new FileLoader(this.manager);
    loader.setPath(this.path).setRequestHeader(this.requestHeader).setWithCredentials(this.withCredentials).setResponseType("arraybuffer");
    const fail = (/** @type {unknown} */ error) => {
      if (onError) onError(error);
      else console.error(error);
      this.manager.itemError(url);
    };
    loader.load(url, (data) => void this.parse(/** @type {ArrayBuffer} */ (data)).then(onLoad).catch(fail), onProgress, onError);
  }

  /** @param {ArrayBuffer} data @returns {Promise<BufferGeometry>} With the field in `userData.field`. */
  async parse(data) {
    return geometryOf(await readField(new Uint8Array(data)), this.level);
  }
}

/** The mesh of a level, with the attribute `color` if the file has colours. @param {import("./ndf.js").NeuralField} field @param {number} level */
export function geometryOf(field, level) {
  const { positions, indices, corners, weights } = unfold(field, level);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setIndex(new BufferAttribute(indices, 1));
  geometry.computeVertexNormals();
  const colour = field.scalars.find(({ name, offset }) => name === "colour" && offset.length === 3);
  if (colour) {
    const colours = new BufferAttribute(new Float32Array(positions.length), 3);
    const [red, green, blue] = [0, 1, 2].map((output) => scalarsAt(colour, corners, weights, output));
    const mixed = new Color();
    for (let i = 0; i < colours.count; i++) {
      mixed.setRGB(red[i], green[i], blue[i], SRGBColorSpace);
      colours.setXYZ(i, mixed.r, mixed.g, mixed.b);
    }
    geometry.setAttribute("color", colours);
  }
  geometry.userData = { field, level };
  return geometry;
}

/** A mesh that unfolds the level that it needs, when it is drawn: triangles of about `pixels` pixels along an edge. */
export class NDFMesh extends Mesh {
  /** @param {import("./ndf.js").NeuralField} field @param {import("three").Material} material @param {number} [pixels] */
  constructor(field, material, pixels = 4) {
    const base = geometryOf(field, 0);
    super(base, material);
    /** @type {BufferGeometry[]} By level. */
    this.levels = [base];
    base.computeBoundingSphere();
    this.onBeforeRender = (renderer, _scene, camera) => {
      const { center, radius } = /** @type {import("three").Sphere} */ (this.levels[0].boundingSphere);
      const away = this.localToWorld(center.clone()).applyMatrix4(camera.matrixWorldInverse).length();
      const scale = camera.projectionMatrix.elements;
      const depth = scale[11] ? Math.max(away, radius / 10) : 1; // of a camera with perspective
      const size = (radius * this.matrixWorld.getMaxScaleOnAxis() * scale[5] * renderer.domElement.height) / depth;
      this.setLevel(Math.ceil(Math.log2(size / (pixels * Math.sqrt(field.header.faces)))));
    };
  }

  /** @param {number} level Nearest that can be had. */
  setLevel(level) {
    const { faces } = this.levels[0].userData.field.header;
    const most = Math.min(MOST_LEVEL, Math.floor(Math.log(MOST_FACES / faces) / Math.log(4)));
    const wanted = Math.max(0, Math.min(level, most));
    this.geometry = this.levels[wanted] ??= geometryOf(this.levels[0].userData.field, wanted);
  }

  dispose() {
    for (const geometry of this.levels) geometry?.dispose();
  }
}
