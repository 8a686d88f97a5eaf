// @ts-check
/** The control panel's hand in the 3D view: loads the tools when they are needed, and shows what the panel holds. */
import { announce } from "../../announce.js";
import { isPart } from "./model.js";

export class ControlView {
  /** @param {import("../../viewer-box.js").ViewerBox} box @param {import("./panel.js").ControlPanel} panel */
  constructor(box, panel) {
    this.box = box;
    this.panel = panel;
    /** @type {(string | number)[]} Nodes that stay out of the run. */
    this.excluded = [];
    /** @type {import("../../../viewer/control/tools.js").ControlTools | null} */
    this.tools = null;
    /** @type {import("../../../viewer/control/surface.js").NumberedSurface | null} */
    this.surface = null;
    /** @type {any} Modules of the viewer, once they are here. */
    this.library = null;
    this.everything = false;
    this._brush = 0.05;
    /** Triangles that are marked, once the tools are here. @type {(number | number[])[] | null} */
    this.marked = null;
    /** Who is told which triangle is clicked while no tool is in hand. @type {((face: number) => void) | null} */
    this.touched = null;
    box.ready.then(() => this._open());
  }

  /** Whether there is something to point at. */
  get possible() {
    return Boolean(this.box.viewer?.ready);
  }

  /** Whether the faces have the service's numbers. */
  get numbered() {
    return this.surface !== null || !this.box.viewer?.ready;
  }

  set brush(/** @type {number} */ share) {
    this._brush = share;
    if (this.tools) this.tools.brush = share;
  }

  async _open() {
    const { viewer, scope } = this.box;
    if (!viewer || scope.over) return;
    viewer.addEventListener("ready", () => this._loaded());
    const keys = (/** @type {KeyboardEvent} */ event) => {
      const typing = event.target instanceof HTMLInputElement && event.target.type === "text";
      if (!(event.ctrlKey || event.metaKey) || event.shiftKey || event.key.toLowerCase() !== "z" || typing || event.target instanceof HTMLTextAreaElement) return;
      if (!this.panel.history.past.length) return;
      event.preventDefault();
      this.panel.undo();
    };
    scope.listen(document, "keydown", keys);
    if (viewer.ready) this._loaded();
  }

  /** Load the tools, once. */
  async _begin() {
    const { viewer, scope } = this.box;
    if (!viewer || this.tools || this.loading) return;
    this.loading = true;
    const [{ ControlTools }, surface, selecting] = await Promise.all([
      import("../../../viewer/control/tools.js"),
      import("../../../viewer/control/surface.js"),
      import("../../../viewer/control/selecting.js"),
    ]);
    if (scope.over || !this.box.viewer) return;
    this.library = { ...surface, ...selecting };
    this.tools = new ControlTools(viewer, {
      painted: (faces) => this._painted(faces),
      begun: () => this.panel.begun(),
      done: () => this.panel.changed(),
      dropped: () => this.panel.dropped(),
      touched: (face) => this.touched?.(face),
    });
    this.tools.brush = this._brush;
    scope.add(() => this.tools?.dispose());
    if (viewer.ready) this._loaded();
  }

  _loaded() {
    const root = this.box.viewer?.root;
    if (!this.tools || !root) {
      this.panel._show();
      if (this._wanted()) this._begin();
      return;
    }
    this.surface = this.box.viewer.atRest(() => this.library.numberedSurface(root, this.excluded));
    this.tools.setSurface(this.surface);
    this.showPart(this.marked);
    this.panel._show();
    this.tools.use(this.panel.tool);
  }

  /** Number the faces without the nodes that stay out of the run; what was painted had other numbers. @param {(string | number)[]} nodes */
  exclude(nodes) {
    if (JSON.stringify(nodes) === JSON.stringify(this.excluded)) return;
    this.excluded = nodes;
    if (!this.surface) return;
    for (const region of this.panel.control.regions) if (region.faces) region.faces = [];
    this._loaded();
  }

  _wanted() {
    return this.panel.tool !== "turn" || this.touched !== null || this.panel.control.regions.length > 0;
  }

  /** @param {import("../../../viewer/control/tools.js").Tool} tool */
  use(tool) {
    if (this.tools) this.tools.use(tool);
    else this._begin();
    this.draw();
  }

  /** Say which triangle is clicked while no tool is in hand. @param {(face: number) => void} listener */
  touch(listener) {
    this.touched = listener;
    if (this.possible) this._begin();
  }

  /** Mark triangles. @param {(number | number[])[] | null} faces As a region has them. */
  showPart(faces) {
    this.marked = faces;
    if (this.tools && this.surface) this.tools.showPart(this.library.selectedFaces({ faces: faces ?? [] }, this.surface));
  }

  /** Take the triangles for where they are seen now: the view shows the asset changed, or as it is again. */
  reshape() {
    const root = this.box.viewer?.root;
    if (!this.tools || !this.surface || !root) return;
    this.surface.shown = this.box.viewer.atRest(() => this.library.numberedSurface(root, this.excluded))?.shown ?? this.surface.shown;
    this.tools.setSurface(this.surface);
    this.draw();
  }

  /** What is wrong with the regions on this asset; empty where nothing is. */
  get problem() {
    return this.everything ? "The regions keep the whole asset, so nothing is left to deform." : "";
  }

  /** Show what the panel holds. */
  draw() {
    const { regions } = this.panel.control;
    const { surface, tools } = this;
    this.everything = false;
    if (!tools) {
      if (this.box.viewer?.ready && this._wanted()) this._begin();
      return;
    }
    if (!surface) return;
    const flags = regions.map((region) => this.library.selectedFaces(region, surface));
    const asked = regions.map(({ action, faces }, i) => ({ action, flags: flags[i], faces })).filter(({ action, faces }) => !isPart(action) && (!faces || faces.length));
    const { action: aim, tool } = this.panel;
    const painted = isPart(aim) && tool !== "turn" ? flags.filter((_, i) => regions[i].action === aim) : [];
    const kept = this.library.keptFaces(asked, surface.count);
    this.everything = kept.length > 0 && kept.every(Boolean);
    tools.showKept(kept, this.library.unionOf(painted, surface.count));
  }

  /** @param {number[]} faces */
  _painted(faces) {
    const { panel, surface } = this;
    if (!surface) return;
    const { regions } = panel.control;
    const own = (/** @type {any} */ region) => region.faces && !region.label && (region.action ?? "keep") === panel.action;
    let at = regions.findLastIndex(own);
    if (at < 0) {
      if (panel.erasing) return;
      regions.push({ faces: [], action: panel.action });
      at = regions.length - 1;
      panel._show();
    }
    const flags = this.library.selectedFaces(regions[at], surface) ?? new Uint8Array(surface.count);
    for (const face of faces) flags[face] = panel.erasing ? 0 : 1;
    const ranges = this.library.rangesOf(flags);
    if (ranges.length > this.library.MOST_RANGES) return announce("These are too many separate triangles for one request");
    regions[at].faces = ranges;
    panel.refresh();
  }
}
