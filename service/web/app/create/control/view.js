// @ts-check
/** The control panel's hand in the 3D view: loads the tools when they are needed, and shows what the panel holds. */
import { announce } from "../../announce.js";
import { isPart } from "./model.js";
import { rounded } from "./rows.js";

/** @typedef {import("../../../viewer/control/tools.js").Box} Box */

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
    /** @type {(Uint8Array | null)[]} What each region selects. */
    this.flags = [];
    this.everything = false;
    this._brush = 0.05;
    /** Points that are shown beside those of the handles. @type {number[][]} */
    this.extra = [];
    /** Triangles that are marked, once the tools are here. @type {(number | number[])[] | null} */
    this.marked = null;
    /** Who is told where the asset is clicked. @type {((place: number[]) => void) | null} */
    this.pointing = null;
    /** Who is told which triangle is clicked while no tool is in hand. @type {((face: number) => void) | null} */
    this.touched = null;
    /** @type {() => void} */
    this.stopped = () => {};
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
      boxed: (box) => this._boxed(box),
      picked: (part) => this.panel.pick(part),
      held: (position) => this.panel.addHandle(rounded(position, this.size)),
      moved: (handle, to) => {
        this.panel.control.handles[handle].to = rounded(to, this.size);
        this.panel.refresh();
      },
      chosen: (handle) => {
        this.panel.chosen = handle;
        this.draw();
      },
      begun: () => this.panel.begun(),
      done: () => this.pointing || this.panel.changed(),
      dropped: () => this.pointing || this.panel.dropped(),
      touched: (face) => this.touched?.(face),
      pointed: (place) => this.pointing?.(rounded(place, this.size)),
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
    // Until the server has listed them.
    if (this.surface && !this.panel.parts.nodes.length) this.panel.offer(this.library.namedParts(root, this.surface));
    this.panel._show();
    this.tools.use(this.pointing ? "point" : this.panel.tool);
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
    const { regions, handles } = this.panel.control;
    return this.panel.tool !== "turn" || this.pointing !== null || this.touched !== null || regions.length + handles.length + this.extra.length > 0;
  }

  /** @param {import("../../../viewer/control/tools.js").Tool} tool */
  use(tool) {
    if (this.pointing) {
      this.pointing = null;
      this.stopped();
    }
    if (this.tools) this.tools.use(tool);
    else this._begin();
    this.draw();
  }

  /**
   * Say where the asset is clicked, until another tool is taken.
   * @param {((place: number[]) => void) | null} listener Null: the tool that was in hand is taken again.
   * @param {() => void} stopped Called when another tool is taken.
   */
  point(listener, stopped) {
    this.pointing = listener;
    this.stopped = stopped;
    if (this.tools) this.tools.use(listener ? "point" : this.panel.tool);
    else if (listener) this._begin();
  }

  /** Say which triangle is clicked while no tool is in hand. @param {(face: number) => void} listener */
  touch(listener) {
    this.touched = listener;
    if (this.possible) this._begin();
  }

  /** Mark triangles. @param {(number | number[])[] | null} faces As a region has them. */
  showPart(faces) {
    this.marked = faces;
    if (this.tools && this.surface) this.tools.showPart(this.library.selectedFaces({ faces: faces ?? [] }, this.surface, this.named));
  }

  /** Take the triangles for where they are seen now: the view shows the asset changed, or as it is again. */
  reshape() {
    const root = this.box.viewer?.root;
    if (!this.tools || !this.surface || !root) return;
    this.surface.shown = this.box.viewer.atRest(() => this.library.numberedSurface(root, this.excluded))?.shown ?? this.surface.shown;
    this.tools.setSurface(this.surface);
    this.draw();
  }

  /** @returns {number} length of the asset's diagonal */
  get size() {
    const { min, max } = this._bounds;
    return Math.hypot(max[0] - min[0], max[1] - min[1], max[2] - min[2]) || 1;
  }

  get _bounds() {
    if (this.surface && this.tools) return this.tools.bounds;
    const box = this.box.viewer?.ready ? this.box.viewer.ownBox : null;
    return box ? { min: box.min.toArray(), max: box.max.toArray() } : { min: [-1, -1, -1], max: [1, 1, 1] };
  }

  /** @returns {Box} around the upper half of the asset */
  get firstBox() {
    const { min, max } = this._bounds;
    const slack = 0.02 * this.size;
    const low = /** @type {any} */ (rounded([min[0] - slack, (min[1] + max[1]) / 2, min[2] - slack], this.size));
    return { min: low, max: /** @type {any} */ (rounded(max.map((/** @type {number} */ value) => value + slack), this.size)) };
  }

  /** @returns {number[]} the middle of the asset's top */
  get top() {
    const { min, max } = this._bounds;
    return rounded([(min[0] + max[0]) / 2, max[1], (min[2] + max[2]) / 2], this.size);
  }

  /** What the asset names. */
  get named() {
    return this.panel.parts;
  }

  /** @param {number} region @returns {number | null} triangles that it selects; null where that is not known here */
  selected(region) {
    const flags = this.flags[region];
    return flags ? flags.reduce((sum, flag) => sum + flag, 0) : null;
  }

  /** What is wrong with the regions on this asset; empty where nothing is. */
  get problem() {
    if (this.everything) return "The regions keep the whole asset, so nothing is left to deform.";
    const empty = this.panel.control.regions.findIndex(({ faces }, i) => this.flags[i] && this.selected(i) === 0 && !(faces && !faces.length));
    return empty < 0 ? "" : `Region ${empty + 1} selects no triangle.`;
  }

  /** Show what the panel holds. */
  draw() {
    const { regions, handles } = this.panel.control;
    if (!this.tools) {
      this.flags = [];
      this.everything = false;
      if (this.box.viewer?.ready && this._wanted()) this._begin();
      return;
    }
    const { surface } = this;
    this.flags = surface ? regions.map((region) => this.library.selectedFaces(region, surface, this.named)) : [];
    const asked = regions
      .map(({ action, faces }, i) => ({ action, flags: faces && !faces.length ? null : this.flags[i], faces }))
      .filter(({ action, faces }) => !isPart(action) && (!faces || faces.length));
    const { action: aim, boxed, tool } = this.panel;
    const painted = isPart(aim) && tool !== "turn" ? this.flags.filter((_, i) => regions[i].action === aim) : [];
    const kept = surface ? this.library.keptFaces(asked, surface.count) : new Uint8Array();
    this.everything = kept.length > 0 && kept.every(Boolean);
    this.tools.showKept(kept, surface ? this.library.unionOf(painted, surface.count) : new Uint8Array());
    const box = tool === "box" ? (regions[boxed]?.box ?? null) : null;
    this.tools.showMarks(box, handles.map(({ position, to }) => ({ position: /** @type {any} */ (position ?? null), to: /** @type {any} */ (to) })), this.panel.chosen, /** @type {any} */ (this.extra));
  }

  /** @param {number[]} faces */
  _painted(faces) {
    const { panel, surface } = this;
    if (!surface) return;
    const { regions } = panel.control;
    const own = (/** @type {any} */ region) => region.faces && (region.action ?? "keep") === panel.action;
    let at = regions.findLastIndex(own);
    if (at < 0) {
      if (panel.erasing) return;
      regions.push({ faces: [], action: panel.action });
      at = regions.length - 1;
      panel._show();
    }
    const flags = this.library.selectedFaces(regions[at], surface, this.named) ?? new Uint8Array(surface.count);
    for (const face of faces) flags[face] = panel.erasing ? 0 : 1;
    const ranges = this.library.rangesOf(flags);
    if (ranges.length > this.library.MOST_RANGES) return announce("These are too many separate triangles for one request");
    regions[at].faces = ranges;
    panel.refresh();
  }

  /** @param {Box} box */
  _boxed(box) {
    const region = this.panel.control.regions[this.panel.boxed];
    if (!region) return;
    region.box = { min: rounded(box.min, this.size), max: rounded(box.max, this.size) };
    this.panel.refresh();
  }
}
