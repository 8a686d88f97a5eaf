// @ts-check
/** The curve of one loss over the steps: its values, thin, and smoothed. */
import { fill, h, svg } from "./dom.js";
import { count, figure, titled } from "./format.js";
import { curveWords, seriesNames, smoothed } from "./series.js";
import { linearTicks } from "../viewer/colormaps.js";

const FIRST_WIDTH = 420;
const HEIGHT = 220;
const LEFT = 52;
const RIGHT = 12;
const TOP = 12;
const BOTTOM = 36;

export class LossChart {
  /** @param {import("./scope.js").Scope} scope */
  constructor(scope) {
    // As wide as its place, so that its letters keep their size.
    this.width = FIRST_WIDTH;
    /** @type {import("./history.js").Point[]} */
    this.points = [];
    this.total = 0;
    this.name = "total";
    this.select = h("select", { "aria-label": "Loss to show", on: { change: () => ((this.name = this.select.value), this._draw()) } });
    this.picture = svg("svg", { role: "img", class: "chart" });
    this.latest = h("span", { class: "chart-latest" });
    this.element = h(
      "section",
      { class: "panel", "aria-labelledby": "loss-title" },
      h("div", { class: "panel-head" }, h("h2", { id: "loss-title" }, "Loss"), this.latest, this.select),
      this.picture,
    );
    const observer = new ResizeObserver(([entry]) => {
      const width = Math.round(entry.contentRect.width);
      if (!width || width === this.width) return;
      this.width = width;
      this._draw();
    });
    observer.observe(this.picture);
    scope.add(() => observer.disconnect());
    this._draw();
  }

  /** @param {import("./history.js").Point[]} points @param {number} total Steps in all; 0 where not known. */
  show(points, total) {
    if (points === this.points && total === this.total) return;
    this.points = points;
    this.total = total;
    const names = seriesNames(points);
    const known = [...this.select.options].map((option) => option.value);
    if (names.join() !== known.join()) {
      fill(this.select, names.map((name) => h("option", { value: name }, label(name))));
      if (!names.includes(this.name)) this.name = names[0] ?? "total";
      this.select.value = this.name;
    }
    this.select.hidden = names.length < 2;
    this._draw();
  }

  _draw() {
    const { name, width } = this;
    this.picture.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    const points = this.points.filter((point) => Number.isFinite(point.losses[name]));
    const steps = points.map((point) => point.step);
    const values = points.map((point) => point.losses[name]);
    const smooth = smoothed(values);
    this.latest.textContent = smooth.length ? figure(smooth[smooth.length - 1]) : "";
    this.picture.replaceChildren();
    this.picture.setAttribute("aria-label", curveWords(label(name), steps, smooth, figure));
    const last = Math.max(this.total, steps[steps.length - 1] ?? 0, 1);
    const high = Math.max(...values, 1e-12) * 1.05;
    const x = (/** @type {number} */ step) => LEFT + (step / last) * (width - LEFT - RIGHT);
    const y = (/** @type {number} */ value) => HEIGHT - BOTTOM - (value / high) * (HEIGHT - TOP - BOTTOM);
    if (values.length < 2) {
      const ground = HEIGHT - BOTTOM;
      this.picture.append(svg("line", { x1: LEFT, x2: width - RIGHT, y1: ground, y2: ground, class: "chart-axis" }));
      const text = svg("text", { x: (LEFT + width - RIGHT) / 2, y: HEIGHT / 2 - 8, "text-anchor": "middle", class: "chart-empty" });
      text.textContent = "The curve begins with the first steps";
      this.picture.append(text);
      return;
    }
    this._axes(high, last, x, y);
    const path = (/** @type {number[]} */ line) => line.map((value, index) => `${index ? "L" : "M"}${x(steps[index]).toFixed(1)} ${y(value).toFixed(1)}`).join("");
    this.picture.append(svg("path", { d: path(values), class: "chart-raw" }), svg("path", { d: path(smooth), class: "chart-line" }));
    const end = steps.length - 1;
    this.picture.append(svg("circle", { cx: x(steps[end]), cy: y(smooth[end]), r: 3.5, class: "chart-dot" }));
  }

  /** @param {number} high @param {number} last @param {(step: number) => number} x @param {(value: number) => number} y */
  _axes(high, last, x, y) {
    const text = (/** @type {string} */ content, /** @type {Record<string, string | number>} */ at) => {
      const element = svg("text", { class: "chart-tick", ...at });
      element.textContent = content;
      this.picture.append(element);
    };
    for (const value of linearTicks(0, high, 4)) {
      this.picture.append(svg("line", { x1: LEFT, x2: this.width - RIGHT, y1: y(value), y2: y(value), class: value === 0 ? "chart-axis" : "chart-grid" }));
      text(figure(value), { x: LEFT - 8, y: y(value) + 4, "text-anchor": "end" });
    }
    for (const step of linearTicks(0, last, this.width > 360 ? 5 : 3)) text(count(step), { x: x(step), y: HEIGHT - BOTTOM + 17, "text-anchor": "middle" });
    text("step", { x: this.width - RIGHT, y: HEIGHT - 4, "text-anchor": "end" });
  }
}

const LABELS = /** @type {Record<string, string>} */ ({
  total: "Total",
  guidance: "Prompt",
  jacobian: "Change of the asset",
  normal: "Creases",
  laplacian: "Roughness",
  sds_mse: "Noise error of the model",
  sds_gradient_norm: "Pull of the prompt",
});

/** @param {string} name */
function label(name) {
  return LABELS[name] ?? titled(name);
}
