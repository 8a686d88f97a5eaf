// @ts-check
/**
 * The frame of a 3D view. Without WebGL it says so, and everything else works.
 *
 * @typedef {{vertices: number, triangles: number, meshes: number}} Found
 */
import { toast } from "./announce.js";
import { isAbort } from "./client.js";
import { fill, h, icon } from "./dom.js";
import { saveBytes } from "./job/files.js";

/** @type {Promise<any> | null} */
let module_ = null;

/** @returns {Promise<any>} */
function viewerModule() {
  module_ ??= import("../viewer/viewer.js").catch((error) => {
    module_ = null;
    throw error;
  });
  return module_;
}

export class ViewerBox {
  /** @param {string} label @param {import("./scope.js").Scope} scope */
  constructor(label, scope) {
    this.label = label;
    this.scope = scope;
    this.canvas = h("div", { class: "viewer-canvas" });
    this.note = h("div", { class: "viewer-note", hidden: true });
    this.tag = h("span", { class: "viewer-tag" }, label);
    this.element = h("div", { class: "viewer" }, this.canvas, this.note, this.tag);
    /** The viewer, once it is here; null where nothing can be drawn. @type {any} */
    this.viewer = null;
    /** Of what is loaded. */
    this.triangles = 0;
    this.failed = false;
    this.ready = this._open();
    scope.add(() => {
      this.viewer?.dispose();
      this.viewer = null;
    });
  }

  async _open() {
    try {
      const { MeshViewer } = await viewerModule();
      if (this.scope.over) return;
      this.viewer = new MeshViewer(this.canvas, { label: this.label });
    } catch (error) {
      this._fail(error);
    }
  }

  /** @param {unknown} error Why nothing can be shown in this browser. */
  _fail(error) {
    console.warn(error);
    this.failed = true;
    this.say("No 3D view", "WebGL is missing or switched off in this browser. Everything else works.", "info");
  }

  /**
   * Show a note over the view; with an empty title, take it away.
   * @param {string} title
   * @param {string} [text]
   * @param {string} [glyph]
   * @param {boolean} [cover] Hide the view behind the note: what it shows is not what its label says.
   */
  say(title, text = "", glyph = "", cover = false) {
    this.note.hidden = !title;
    this.note.classList.toggle("viewer-cover", cover);
    fill(this.note, glyph ? icon(glyph) : null, h("strong", null, title), text ? h("span", null, text) : null);
  }

  /** @param {ArrayBuffer} buffer @param {string} format @param {boolean} [keepCamera] @returns {Promise<Found | null>} Null where nothing can be shown. */
  async load(buffer, format, keepCamera = false) {
    await this.ready;
    if (!this.viewer) return null;
    if (!this.note.classList.contains("viewer-cover")) this.say("");
    try {
      const found = await this.viewer.load(buffer, { format, keepCamera });
      this.triangles = found?.triangles ?? 0;
      return found;
    } catch (error) {
      // Another file took its place meanwhile: that one is shown.
      if (this.scope.over || isAbort(error)) return null;
      if (error instanceof Error && error.name === "NoWebGL") {
        this._fail(error);
        return null;
      }
      console.warn(error);
      this.viewer?.clear();
      if (error instanceof Error && error.name === "NoTriangles") {
        this.say("This file has no triangles", "Points and lines can't be deformed. Fit a surface to points first.", "warn");
        return null;
      }
      const reason = format === "zip" && error instanceof Error ? error.message : "It may be empty, cut off or damaged.";
      this.say("This file can't be shown", reason, "warn");
      return null;
    }
  }

  /**
   * Show another shape of what is loaded; where the vertices do not fit, show the file by itself.
   * @param {ArrayBuffer} buffer A GLB.
   * @returns {Promise<boolean>} Whether morphing works.
   */
  async deform(buffer) {
    await this.ready;
    if (!this.viewer) return false;
    try {
      await this.viewer.setDeformed(buffer);
      return true;
    } catch (error) {
      if (this.scope.over || isAbort(error)) return false;
      console.warn(error);
      await this.load(buffer, "glb", true);
      return false;
    }
  }

  /**
   * Look at what is shown from a direction, from as far away as now.
   * @param {number} azimuth Degrees; 0 sees it from +Z, 90 from +X.
   * @param {number} elevation Degrees above the horizon.
   */
  look(azimuth, elevation) {
    if (this.viewer) this.viewer.rig.side = { azimuth, elevation };
  }

  /** @returns {{azimuth: number, elevation: number} | null} From where it is seen, in degrees. */
  seenFrom() {
    return this.viewer?.rig.side ?? null;
  }

  resetView() {
    this.viewer?.resetView();
  }

  /** @returns {Promise<Blob>} A PNG of what is shown, twice as large as on the screen. */
  picture() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return this.viewer.snapshot({ width: 2 * width, height: 2 * height, background: getComputedStyle(this.canvas).backgroundColor });
  }
}

/** @param {ViewerBox} a @param {ViewerBox} b */
export async function linkViews(a, b) {
  await Promise.all([a.ready, b.ready]);
  if (!a.viewer || !b.viewer) return;
  const { linkCameras } = await viewerModule();
  linkCameras(a.viewer, b.viewer);
}

/**
 * What plays the clips of views, in step, and saves turntables of the last of them (`viewer/clips.js`).
 * @param {import("./scope.js").Scope} scope
 * @param {ViewerBox[]} views
 * @param {(ending: string) => string} [named] What a turntable is saved as; without it there is none.
 * @returns {HTMLElement}
 */
export function movingTools(scope, views, named) {
  const element = h("div", { class: "moving" });
  const options = named && {
    save: (/** @type {Blob} */ file, /** @type {string} */ ending) => saveBytes(file, named(ending)),
    failed: (/** @type {unknown} */ error) => toast(`No turntable. ${error instanceof Error ? error.message : ""}`),
  };
  Promise.all(views.map(({ ready }) => ready)).then(async () => {
    const viewers = views.flatMap(({ viewer }) => viewer ?? []);
    if (!viewers.length || scope.over) return;
    const { mountClips } = await viewerModule();
    if (!scope.over) scope.add(mountClips(element, viewers, options).dispose);
  });
  return element;
}
