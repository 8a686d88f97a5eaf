// @ts-check
/** The wall of a family: its shapes coloured by part, and the same point on all of them under the pointer. */
import { fill, h } from "../dom.js";
import { counted } from "../format.js";
import { ViewerBox } from "../viewer-box.js";
import { slider } from "../widgets.js";

const TURN = 35; // degrees: a look at front and side

export class WallView {
  /** @param {import("../scope.js").Scope} scope @param {(shape: number) => void} onChoose */
  constructor(scope, onChoose) {
    this.scope = scope;
    this.onChoose = onChoose;
    /** @type {import("../../viewer/wall.js").Wall | null} */
    this.wall = null;
    this.box = new ViewerBox("Wall", scope);
    this.turn = slider("wall-turn", "Turn", 360, () => this._turn());
    this.point = slider("wall-point", "Point", 0, () => this._mark(Number(this.point.input.value) - 1));
    this.legend = h("ul", { class: "row wall-legend", "aria-label": "Parts" });
    this.said = h("p", { class: "small muted wall-said", "aria-live": "polite" });
    this.tools = h("div", { class: "wall-tools", hidden: true }, this.legend, this.turn.row, this.point.row, this.said);
    scope.add(() => this.wall?.dispose());
  }

  /** @param {ArrayBuffer} buffer @returns {Promise<boolean>} whether it is shown */
  async show(buffer) {
    const { aboutWall, Wall } = await import("../../viewer/wall.js");
    this.about = aboutWall(buffer);
    if (!(await this.box.load(buffer, "glb")) || this.scope.over) return false;
    this.wall?.dispose();
    this.wall = new Wall(this.box.viewer, {
      pointed: (hit) => this._pointed(hit),
      clicked: (shape) => this.onChoose(shape),
    });
    const { shapes } = this.wall;
    fill(this.legend, this.about.parts.map(({ name, colour }) => {
      const swatch = h("span", { class: "swatch", "aria-hidden": "true" });
      swatch.style.backgroundColor = colour;
      return h("li", { class: "row" }, swatch, name);
    }));
    fill(this.box.tag, shapes.length < this.about.shapes ? `${shapes.length} of ${this.about.shapes} shapes` : counted(shapes.length, "shape"));
    this.point.input.max = String(this.wall.count);
    this.turn.input.value = String(TURN);
    this.tools.hidden = false;
    this._turn();
    this._mark(-1);
    this.box.resetView();
    return true;
  }

  /** @returns {string[]} names of what hangs here */
  get names() {
    return this.wall?.shapes.map(({ name }) => name) ?? [];
  }

  /** @param {number[]} shapes */
  choose(shapes) {
    this.wall?.choose(shapes);
  }

  _turn() {
    const degrees = Number(this.turn.input.value);
    this.turn.value.textContent = `${degrees}°`;
    this.wall?.turn(degrees);
  }

  /** @param {import("../../viewer/wall.js").Hit | null} hit */
  _pointed(hit) {
    // What was pointed at last stays marked, to be looked at.
    if (hit) this._mark(hit.point, hit.shape);
  }

  /** @param {number} point @param {number} [shape] */
  _mark(point, shape) {
    if (!this.wall || !this.about) return;
    this.wall.mark(point);
    this.point.input.value = String(point + 1);
    this.point.value.textContent = point < 0 ? "none" : String(point + 1);
    if (point < 0) return void fill(this.said, "Point at a shape: the same place is marked on all others. Drag, move and zoom as in any view.");
    const { shapes } = this.wall;
    const part = this.about.parts[this.about.points[point]].name;
    const where = shape === undefined ? "" : `${shapes[shape].name}: `;
    fill(this.said, `${where}point ${point + 1}, ${part}; ${this.wall.having(point)} of ${counted(shapes.length, "shape")} have it.`);
  }
}
