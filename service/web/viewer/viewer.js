// @ts-check
/**
 * A mesh on the page: load it, turn it, blend it into its result.
 *
 *     const viewer = new MeshViewer(container, { label: "Before" });
 *     await viewer.load(buffer, { format: "glb" });
 *     await viewer.setDeformed(resultBuffer);
 *     viewer.setMorph(0.5);
 *
 * The container sets the size. Its CSS may set --viewer-background and --viewer-background-edge (colours); otherwise
 * they follow `color-scheme`. Draws only when something changed.
 */
import { Box3 } from "../vendor/three/three.module.js";
import { CameraRig, linkCameras } from "./cameras.js";
import { Deformation } from "./deformation.js";
import { withoutMaterials } from "./glb.js";
import { INSTRUCTIONS, listenToKeys } from "./keyboard.js";
import { disposeAsset, meshesOf, originOf, parseAsset, triangleCount } from "./loading.js";
import { mountClips } from "./clips.js";
import { Puppet } from "./puppet.js";
import { acquireRenderer, releaseRenderer } from "./renderer.js";
import { drawSnapshot } from "./snapshot.js";
import { boundsOf, dress, Stage } from "./stage.js";
import { Surface } from "./surface.js";
import { floats, pairMeshes, TopologyError } from "./topology.js";
import { weld } from "./weld.js";
import { Wireframe } from "./wireframe.js";

export { linkCameras, mountClips, TopologyError };

/** @typedef {import("./loading.js").Format} Format */
/** @typedef {{ vertices: number, triangles: number, meshes: number }} AssetInfo */

/** Events: `ready` (something was loaded), `clips` (there are others than before), `posed`, `rest` (whoever plays should stop), `camerachange` and `camerareset`. */
export class MeshViewer extends EventTarget {
  /** @type {import("./renderer.js").SharedRenderer | null} */ #renderer = null;
  /** @type {import("three").Object3D | null} */ #root = null;
  /** @type {Puppet | null} */ #puppet = null;
  /** @type {Deformation | null} */ #deformation = null;
  /** @type {Wireframe | null} */ #wireframe = null;
  #framed = new Box3(); // what the camera was last placed for
  #converted = false;
  #grounded = true; // the ground lies under the shape that is shown
  #disposed = false;
  #turn = 0;

  /** @param {HTMLElement} container @param {{ label?: string }} options `label` is the viewer's name for people who do not see it */
  constructor(container, { label = "3D model" } = {}) {
    super();
    this.stage = new Stage();
    this.surface = new Surface(container, label, INSTRUCTIONS, {
      resized: (aspect) => this.rig.setAspect(aspect),
      changed: () => this.invalidate(),
      themed: (dark) => this.stage.setTheme(dark),
    });
    this.rig = new CameraRig(this.surface.canvas, () => {
      this.invalidate();
      this.dispatchEvent(new CustomEvent("camerachange", { detail: this.rig.state }));
    });
    this.rig.setAspect(this.surface.aspect);
    /** The box of what is shown, without those of linked viewers. */
    this.ownBox = new Box3();
    this.stopKeys = listenToKeys(container, {
      rotate: (azimuth, elevation) => this.rig.rotate(azimuth, elevation),
      pan: (x, y) => this.rig.pan(x, y),
      zoom: (factor) => this.rig.zoom(factor),
      reset: () => this.resetView(),
    });
    this.surface.observe();
  }

  /** @returns {boolean} whether something is loaded */
  get ready() {
    return this.#root !== null;
  }

  /**
   * Show a file instead of what was there.
   * @param {ArrayBuffer} buffer
   * @param {{ format?: Format, keepCamera?: boolean }} options
   * @returns {Promise<AssetInfo>}
   * @throws {Error} the message is for people: the file cannot be read, or the browser cannot draw
   */
  async load(buffer, { format = "glb", keepCamera = false } = {}) {
    const turn = ++this.#turn;
    const renderer = this.#start();
    const root = await parseAsset(buffer, format, renderer.gl);
    if (turn !== this.#turn) {
      disposeAsset(root);
      throw new DOMException("Another file was loaded meanwhile.", "AbortError");
    }
    this.#clear();
    dress(root, renderer.gl);
    this.#root = root;
    this.#puppet = new Puppet(root);
    this.#converted = meshesOf(root).length > 0 && originOf(root)?.format !== "glb";
    this.stage.scene.environment = renderer.environment.texture;
    this.stage.scene.add(root);
    this.#wireframe?.attach(root);
    const kept = keepCamera && this.rig.touched;
    this.#frame();
    this.#framed.copy(this.ownBox);
    if (!kept) this.rig.reset();
    this.dispatchEvent(new Event("ready"));
    this.dispatchEvent(new Event("clips"));
    return this.info;
  }

  /** @returns {import("three").Object3D | null} what is loaded */
  get root() {
    return this.#root;
  }

  /** @returns {import("./puppet.js").Clip[]} of what is loaded */
  get clips() {
    return this.#puppet?.clips ?? [];
  }

  /** @returns {boolean} whether what is loaded has joints or morph targets */
  get rigged() {
    return this.#puppet?.rigged ?? false;
  }

  /** Show a moment of a clip; the camera is placed for the whole of it. @param {string | null} clip by its name; where there is none, the asset is at rest @param {number} [time] seconds */
  pose(clip, time = 0) {
    if (this.#puppet?.pose(clip, time)) {
      this.#frame();
      if (!this.rig.touched) this.resetView();
    }
    this.stage.refreshShadow();
    this.invalidate();
    this.dispatchEvent(new Event("posed"));
  }

  /** Show what is loaded as it stands in its file, and play nothing. */
  rest() {
    this.pose(null);
    this.dispatchEvent(new Event("rest"));
  }

  /** Do something while the asset is at rest, whatever is played. @template T @param {() => T} act @returns {T} */
  atRest(act) {
    return this.#puppet ? this.#puppet.atRest(act) : act();
  }

  /** @returns {AssetInfo} of what is loaded; loaders of other formats than glTF repeat a vertex for each of its faces */
  get info() {
    const meshes = this.#root ? meshesOf(this.#root) : [];
    const vertices = (/** @type {import("three").Mesh} */ { geometry: { attributes } }) =>
      this.#converted ? new Set(weld(floats(attributes.position, 3, null))).size : attributes.position.count;
    return {
      vertices: meshes.reduce((sum, mesh) => sum + vertices(mesh), 0),
      triangles: meshes.reduce((sum, mesh) => sum + triangleCount(mesh), 0),
      meshes: meshes.length,
    };
  }

  /**
   * Add the result of a deformation of what is loaded; `setMorph` works from then on.
   * @param {ArrayBuffer} buffer a GLB with the same meshes, vertices and faces
   * @param {{ keepCamera?: boolean }} options `keepCamera`: as long as all of it is in the picture
   * @throws {TopologyError} it has others; what was shown stays
   */
  async setDeformed(buffer, { keepCamera = false } = {}) {
    const turn = this.#turn;
    const source = this.#root;
    const puppet = this.#puppet;
    if (!source || !puppet) throw new Error("Load the source before its result.");
    const root = await parseAsset(withoutMaterials(buffer), "glb", this.#start().gl);
    try {
      if (turn !== this.#turn || source !== this.#root) {
        throw new DOMException("Another file was loaded meanwhile.", "AbortError");
      }
      const morph = this.#deformation?.morph ?? 0;
      this.clearDeformed();
      const pairs = pairMeshes(source, root, this.#converted);
      this.#deformation = new Deformation(pairs, puppet);
      puppet.meet(root);
      this.#wireframe?.refresh();
      this.setMorph(morph);
      this.#frame();
      if (!this.rig.touched && !(keepCamera && this.#framed.containsBox(this.ownBox))) this.resetView();
    } finally {
      disposeAsset(root);
    }
  }

  /**
   * Lead to another result of what is loaded, after one that came as a file.
   * @param {Map<string, Float32Array>} positions by the numbers of mesh and primitive in the file of the result, such as "0/1"
   */
  setShape(positions) {
    this.#deformation?.reshape(positions);
    this.#moved();
  }

  /** Whether there is a result, which `setShape` and `mix` can change. */
  get deformed() {
    return this.#deformation !== null;
  }

  /** How far another result moves each vertex, for `mix`. @param {Map<string, Float32Array> | null} positions as for `setShape`; null: the result that is shown @returns {Float32Array[]} */
  offsets(positions) {
    return this.#deformation?.offsets(positions) ?? [];
  }

  /** Lead to shares of several results together. @param {[Float32Array[], number][]} shapes as `offsets` gives them, and how much of each */
  mix(shapes) {
    this.#deformation?.mix(shapes);
    this.#moved();
  }

  #moved() {
    this.#grounded = false;
    this.stage.refreshShadow();
    this.invalidate();
  }

  /** A picture of another result, from where the camera is. @param {Map<string, Float32Array>} positions as for `setShape` @param {import("./snapshot.js").SnapshotOptions} options @returns {Promise<Blob>} PNG */
  async pictureOf(positions, { width = 256, height = 256, background } = {}) {
    const deformation = this.#deformation;
    if (!deformation) throw new Error("There is no result yet.");
    const renderer = this.#start();
    try {
      return await deformation.peek(positions, () => {
        this.rig.update();
        this.#grounded = false;
        this.#ground();
        this.stage.refreshShadow();
        return drawSnapshot(renderer, this.stage, this.rig.camera, { width, height, background });
      });
    } finally {
      this.#grounded = false;
      this.stage.refreshShadow();
      this.invalidate();
    }
  }

  /** @param {number} t 0 shows the source, 1 the result, up to 1.5 what lies beyond it, all on straight lines */
  setMorph(t) {
    this.#deformation?.setMorph(t);
    this.#moved();
  }

  /** @param {boolean} on lines along all edges */
  setWireframe(on) {
    this.#wireframe?.dispose();
    this.#wireframe = on ? new Wireframe() : null;
    if (this.#root) this.#wireframe?.attach(this.#root);
    this.invalidate();
  }

  /** Frame everything again. */
  resetView() {
    this.#framed.copy(this.ownBox);
    this.rig.reset();
    this.dispatchEvent(new Event("camerareset"));
  }

  /** Show nothing: forget what was loaded, and whatever is still being loaded. */
  clear() {
    this.#turn++;
    this.#clear();
    this.dispatchEvent(new Event("clips"));
    const { context, canvas } = this.surface;
    context.clearRect(0, 0, canvas.width, canvas.height);
  }

  /** Forget the result; the source is shown as it was loaded. */
  clearDeformed() {
    this.#deformation?.dispose();
    this.#deformation = null;
    this.#wireframe?.refresh();
    this.stage.refreshShadow();
    this.invalidate();
  }

  /** What is shown, as a picture of any size. @param {import("./snapshot.js").SnapshotOptions} options @returns {Promise<Blob>} PNG */
  async snapshot({ width = 1024, height = 1024, background } = {}) {
    if (!this.#root) throw new Error("Nothing is loaded.");
    this.rig.update();
    this.#ground();
    return drawSnapshot(this.#start(), this.stage, this.rig.camera, { width, height, background });
  }

  /**
   * One turn around what is shown, from where the camera is.
   * @param {import("./turntable.js").TurntableOptions} options
   * @returns {Promise<Blob>} a GIF or a video
   */
  async turntable(options = {}) {
    if (!this.#root) throw new Error("Nothing is loaded.");
    const { drawTurntable } = await import("./turntable.js");
    this.#ground();
    const { camera, orbit } = this.rig;
    return drawTurntable(this.#start(), this.stage, boundsOf(this.#root), camera.position.clone().sub(orbit.target), options);
  }

  /** Draw again, soon. */
  invalidate() {
    if (this.#root && this.surface.visible) this.#renderer?.request(this.#draw);
  }

  /** Free everything; the container is empty again. */
  dispose() {
    if (this.#disposed) return;
    this.#disposed = true;
    this.#turn++;
    this.#clear();
    this.stopKeys();
    this.rig.dispose();
    this.stage.dispose();
    this.surface.dispose();
    if (!this.#renderer) return;
    this.#renderer.cancel(this.#draw);
    this.#renderer.removeEventListener("contextrestored", this.#restored);
    this.#renderer = null;
    releaseRenderer();
  }

  /** @returns {import("./renderer.js").SharedRenderer} */
  #start() {
    if (this.#disposed) throw new Error("This viewer was disposed of.");
    if (!this.#renderer) {
      this.#renderer = acquireRenderer();
      this.#renderer.addEventListener("contextrestored", this.#restored);
    }
    return this.#renderer;
  }

  #restored = () => {
    this.stage.scene.environment = this.#renderer?.environment.texture ?? null;
    this.stage.refreshShadow();
    this.invalidate();
  };

  #draw = () => {
    const { context, canvas } = this.surface;
    // While the context is lost the last picture stays.
    if (!this.#renderer || this.#renderer.lost || !this.#root) return false;
    if (!this.surface.fit(this.#renderer.maxSize)) return false;
    const moving = this.rig.update();
    this.#ground();
    context.clearRect(0, 0, canvas.width, canvas.height);
    this.#renderer.draw(this.stage, this.rig.camera, context, canvas.width, canvas.height);
    return moving && this.surface.visible;
  };

  /** Put the ground under the shape that is shown. */
  #ground() {
    const root = this.#root;
    if (!this.#grounded && root) this.stage.enclose(this.atRest(() => boundsOf(root)));
    this.#grounded = true;
  }

  #frame() {
    const root = this.#root;
    if (!root) return;
    const [still, moving] = [new Box3(), new Box3()];
    for (const end of this.#deformation ? [0, 1] : [0]) {
      this.#deformation?.show(end);
      const box = this.atRest(() => boundsOf(root));
      still.union(box);
      this.#puppet?.reach(box);
      moving.union(box);
    }
    this.#deformation?.show(this.#deformation.morph);
    this.#grounded = false;
    this.ownBox.copy(still).union(moving);
    this.rig.setBox(this.ownBox);
  }

  #clear() {
    this.clearDeformed();
    this.#wireframe?.detach();
    if (this.#root) {
      this.#root.removeFromParent();
      disposeAsset(this.#root);
    }
    this.#root = this.#puppet = null;
  }
}
