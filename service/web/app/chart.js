// @ts-check
/** The curve of the loss over the steps: its values, thin, and smoothed. */
import { h, svg } from "./dom.js";
import { count, figure } from "./format.js";

const [WIDTH, HEIGHT] = [400, 100];

/**
 * Exponential smoothing that begins without a bias: early values are means of what there was.
 * @param {number[]} values
 * @param {number} [weight] Of the past, in [0, 1).
 */
export function smoothed(values, weight = 0.8) {
  let sum = 0;
  let norm = 0;
  return values.map((value) => {
    sum = weight * sum + value;
    norm = weight * norm + 1;
    return sum / norm;
  });
}

/**
 * The points of events and report: a report begins with the last attempt, events also cover the earlier ones.
 * @param {import("./history.js").Point[]} seen In the events.
 * @param {any} report
 * @returns {import("./history.js").Point[]}
 */
export function allPoints(seen, report) {
  const rows = /** @type {any[]} */ (report?.losses ?? []);
  return [...seen.filter(({ step }) => !rows.length || step < rows[0].step), ...rows.map(({ step, total }) => ({ step, loss: total }))];
}

/** What the loss did, for those who do not see its curve. @param {number[]} steps @param {number[]} smooth */
export function curveWords(steps, smooth) {
  if (!smooth.length) return "Nothing yet";
  const at = (/** @type {number} */ index) => `${figure(smooth[index])} at step ${count(steps[index])}`;
  return `${at(0)}, ${at(smooth.length - 1)}, lowest ${at(smooth.indexOf(Math.min(...smooth)))}`;
}

export class LossChart {
  constructor() {
    this.picture = svg("svg", { role: "img", class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none" });
    this.last = h("p", { class: "small muted chart-latest" });
    const head = h("div", { class: "panel-head" }, h("h2", { id: "loss-title" }, "Loss"));
    this.element = h("section", { class: "panel", "aria-labelledby": "loss-title", hidden: true }, head, this.picture, this.last);
  }

  /** @param {import("./history.js").Point[]} points @param {number} total Steps in all; 0 where not known. */
  show(points, total) {
    const steps = points.map(({ step }) => step);
    const values = points.map(({ loss }) => loss);
    this.element.hidden = values.length < 2;
    if (this.element.hidden) return;
    const smooth = smoothed(values);
    const last = Math.max(total, steps[steps.length - 1]);
    const high = Math.max(...values, 1e-12) * 1.05;
    const place = (/** @type {number} */ value, /** @type {number} */ index) => `${((WIDTH * steps[index]) / last).toFixed(1)} ${(HEIGHT * (1 - value / high)).toFixed(1)}`;
    const line = (/** @type {number[]} */ list, /** @type {string} */ name) => svg("polyline", { points: list.map(place).join(" "), class: name });
    this.picture.replaceChildren(line(values, "chart-raw"), line(smooth, "chart-line"));
    this.picture.setAttribute("aria-label", curveWords(steps, smooth));
    this.last.textContent = `${count(last)} steps`;
  }
}
