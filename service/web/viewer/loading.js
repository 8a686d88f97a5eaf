// @ts-check
/** From the bytes of a file to objects of three.js. What a format needs is fetched when a file of it comes. */
import { Group, LoadingManager, Mesh, MeshStandardMaterial } from "../vendor/three/three.module.js";
import { GLTFLoader } from "../vendor/three/addons/loaders/GLTFLoader.js";
import { isGlb, readJson } from "./glb.js";

/** @typedef {"glb" | "gltf" | "obj" | "ply" | "stl" | "zip"} Format */

/**
 * What is needed of a file to number its faces as the service does: of a glTF its JSON and the nodes of its objects.
 * @typedef {{ format: Exclude<Format, "zip">, buffer?: ArrayBuffer, json?: Record<string, any>, nodes?: Map<object, number> }} Origin
 */

/** @typedef {(uri: string) => Uint8Array<ArrayBuffer> | undefined} Linked finds a file to which another refers */

/** A picture of one white pixel. */
const WHITE = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mP4DwABAQEAHLCMmQAAAABJRU5ErkJggg==";

/** @type {WeakMap<import("three").Object3D, Origin>} */
const origins = new WeakMap();

/** @type {WeakMap<object, string>} */
const primitiveNames = new WeakMap();

/** Which primitive of its glTF a mesh is: the numbers of its mesh and primitive. @param {object} mesh @returns {string} "0/1"; empty: it is of no glTF */
export function primitiveOf(mesh) {
  return primitiveNames.get(mesh) ?? "";
}

/** @param {import("three").Object3D} root as `parseAsset` made it */
export function originOf(root) {
  return origins.get(root) ?? null;
}

/** @type {import("../vendor/three/addons/loaders/DRACOLoader.js").DRACOLoader | undefined} */
let draco;
/** @type {import("../vendor/three/addons/loaders/KTX2Loader.js").KTX2Loader | undefined} */
let ktx2;

/**
 * Read a file.
 * @param {ArrayBuffer} buffer
 * @param {Format} format
 * @param {import("three").WebGLRenderer} renderer asks it which textures the machine can show
 * @returns {Promise<import("three").Object3D>}
 * @throws {Error} the message is for people
 */
export async function parseAsset(buffer, format, renderer) {
  if (buffer.byteLength === 0) throw new Error("The file is empty.");
  const packed = format === "zip" ? (await import("./zip.js")).assetIn(buffer) : { buffer, format, linked: () => undefined };
  return parseFile(packed.buffer, isGlb(packed.buffer) ? "glb" : /** @type {Exclude<Format, "zip">} */ (packed.format), packed.linked, renderer);
}

/** @param {ArrayBuffer} buffer @param {Exclude<Format, "zip">} kind @param {Linked} linked @param {import("three").WebGLRenderer} renderer */
async function parseFile(buffer, kind, linked, renderer) {
  if (kind === "glb" || kind === "gltf") return parseGltf(buffer, linked, renderer);
  /** @type {import("three").Object3D} */
  let root;
  try {
    root = await parsePlain(buffer, kind);
  } catch (error) {
    throw new Error(`The ${kind.toUpperCase()} file cannot be read: ${reason(error)}`, { cause: error });
  }
  requireTriangles(root);
  origins.set(root, { format: kind, buffer });
  return root;
}

/** @param {ArrayBuffer} buffer @param {Linked} linked @param {import("three").WebGLRenderer} renderer @returns {Promise<import("three").Object3D>} */
async function parseGltf(buffer, linked, renderer) {
  const json = readJson(buffer);
  const used = new Set(json.extensionsUsed ?? []);
  const missing = (json.buffers ?? []).find((/** @type {any} */ { uri }) => uri && !/^data:/i.test(uri) && !linked(uri));
  if (missing) {
    throw new Error(`The file refers to another file (${missing.uri}), which is not there. Export it as one .glb, or put all files into a ZIP.`);
  }
  const manager = localManager(linked);
  const loader = new GLTFLoader(manager);
  if (used.has("EXT_meshopt_compression") || used.has("KHR_meshopt_compression")) {
    const { MeshoptDecoder } = await import("../vendor/three/addons/libs/meshopt_decoder.module.js");
    await MeshoptDecoder.ready;
    loader.setMeshoptDecoder(MeshoptDecoder);
  }
  if (used.has("KHR_draco_mesh_compression")) {
    if (!draco) {
      const { DRACOLoader } = await import("../vendor/three/addons/loaders/DRACOLoader.js");
      draco = new DRACOLoader().setWorkerLimit(2);
      draco.setDecoderPath(new URL("../vendor/three/addons/libs/draco/gltf/", import.meta.url).href);
    }
    loader.setDRACOLoader(draco);
  }
  if (used.has("KHR_texture_basisu")) {
    if (!ktx2) {
      const { KTX2Loader } = await import("../vendor/three/addons/loaders/KTX2Loader.js");
      ktx2 = new KTX2Loader().setWorkerLimit(2);
      ktx2.setTranscoderPath(new URL("../vendor/three/addons/libs/basis/", import.meta.url).href);
    }
    loader.setKTX2Loader(ktx2.detectSupport(renderer));
  }
  let gltf;
  try {
    gltf = await loader.parseAsync(buffer, "");
  } catch (error) {
    throw new Error(`The glTF file cannot be shown: ${reason(error)}`, { cause: error });
  } finally {
    manager.forget();
  }
  const root = gltf.scene ?? gltf.scenes[0];
  if (!root) throw new Error("The glTF file has no scene.");
  const found = [...gltf.parser.associations].filter(([, { nodes } = {}]) => nodes !== undefined);
  for (const [object, { meshes, primitives } = {}] of gltf.parser.associations) if (primitives !== undefined) primitiveNames.set(object, `${meshes}/${primitives}`);
  const nodes = new Map(found.map(([object, each]) => [object, Number(each.nodes)]));
  root.animations = gltf.animations;
  atRest(json, nodes);
  requireTriangles(root);
  origins.set(root, { format: "glb", json, nodes });
  return root;
}

/**
 * Show what three's loader leaves out: weights of nodes; and leave out what KHR_node_visibility hides.
 * @param {Record<string, any>} json
 * @param {Map<any, number>} nodes
 */
function atRest(json, nodes) {
  for (const [object, at] of nodes) {
    const node = json.nodes[at];
    if (isHidden(node)) object.removeFromParent();
    const own = [object, ...object.children].filter((each) => each instanceof Mesh && (each === object || !nodes.has(each)));
    for (const mesh of node.weights ? own : []) node.weights.forEach((/** @type {number} */ weight, /** @type {number} */ k) => (mesh.morphTargetInfluences[k] = weight));
  }
}

/** @param {Record<string, any>} node of the file @returns {boolean} */
export function isHidden(node) {
  return node.extensions?.KHR_node_visibility?.visible === false;
}

/** @param {ArrayBuffer} buffer @param {"obj" | "ply" | "stl"} kind @returns {Promise<import("three").Object3D>} */
async function parsePlain(buffer, kind) {
  if (kind === "obj") {
    const { OBJLoader } = await import("../vendor/three/addons/loaders/OBJLoader.js");
    const group = new OBJLoader(localManager()).parse(new TextDecoder().decode(buffer));
    group.traverse((object) => {
      if (object instanceof Mesh) object.material = clay(object.geometry); // the material library was not sent
    });
    return group;
  }
  const geometry =
    kind === "ply"
      ? new (await import("../vendor/three/addons/loaders/PLYLoader.js")).PLYLoader().parse(buffer)
      : new (await import("../vendor/three/addons/loaders/STLLoader.js")).STLLoader().parse(buffer);
  const group = new Group();
  group.add(new Mesh(geometry, clay(geometry)));
  return group;
}

/** Nothing is ever fetched for a file: what it refers to came with it, or is an image, which is white then. @param {Linked} linked */
function localManager(linked = () => undefined) {
  /** @type {string[]} */
  const urls = [];
  const manager = new LoadingManager();
  manager.setURLModifier((url) => {
    if (/^(blob:|data:)/i.test(url) || url.startsWith(new URL("../vendor/", import.meta.url).href)) return url;
    const data = linked(url);
    return data ? urls[urls.push(URL.createObjectURL(new Blob([data]))) - 1] : WHITE;
  });
  return Object.assign(manager, { forget: () => urls.forEach((url) => URL.revokeObjectURL(url)) });
}

/** What a mesh without a material looks like. @param {import("three").BufferGeometry} geometry */
export function clay(geometry) {
  const colored = geometry.hasAttribute("color");
  return new MeshStandardMaterial({
    color: colored ? 0xffffff : 0xb9bcc2,
    roughness: 0.62,
    metalness: 0,
    vertexColors: colored,
    flatShading: !geometry.hasAttribute("normal"),
  });
}

/** @param {import("three").Object3D} root @returns {import("three").Mesh[]} in the order of the file's nodes */
export function meshesOf(root) {
  /** @type {import("three").Mesh[]} */
  const meshes = [];
  root.traverse((object) => {
    if (object instanceof Mesh && !object.userData.overlay) meshes.push(object);
  });
  return meshes;
}

/** @param {import("three").Mesh} mesh @returns {number} */
export function triangleCount({ geometry }) {
  return Math.floor((geometry.index ? geometry.index.count : geometry.attributes.position.count) / 3);
}

/** @param {import("three").Object3D} root */
function requireTriangles(root) {
  if (!meshesOf(root).some((mesh) => mesh.geometry.attributes.position && triangleCount(mesh) > 0)) {
    throw Object.assign(new Error("There are no triangles in this file."), { name: "NoTriangles" });
  }
}

/** @param {unknown} error */
function reason(error) {
  return (error instanceof Error ? error.message : String(error)).replace(/^THREE\.\w+: /, "");
}

/** Free everything that an asset keeps on the GPU. @param {import("three").Object3D} root */
export function disposeAsset(root) {
  root.traverse((object) => {
    if (!(/** @type {any} */ (object).geometry)) return;
    const { geometry, material, skeleton } = /** @type {any} */ (object);
    geometry.dispose();
    skeleton?.dispose();
    for (const one of [material].flat()) {
      if (!one) continue;
      for (const value of Object.values(one)) {
        if (/** @type {any} */ (value)?.isTexture) {
          /** @type {any} */ (value).image?.close?.();
          /** @type {any} */ (value).dispose();
        }
      }
      one.dispose();
    }
  });
}
