// @ts-check
/** Prepare the values of a loss for drawing. */

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

/** Return the names of the losses that can be drawn, the most useful first. @param {{losses: Record<string, number>}[]} points */
export function seriesNames(points) {
  const hidden = ["timestep"];
  const first = ["total", "guidance", "jacobian", "normal", "laplacian"];
  const found = new Set(points.flatMap((point) => Object.keys(point.losses)));
  const rest = [...found].filter((name) => !first.includes(name) && !hidden.includes(name)).sort();
  return [...first.filter((name) => found.has(name)), ...rest];
}

/** The points of `report.json`, which are denser than those of the events. @param {any} report @returns {import("./history.js").Point[]} */
export function reportPoints(report) {
  const rows = Array.isArray(report?.losses) ? report.losses : [];
  return rows.map((/** @type {any} */ row) => {
    const { step, ...losses } = row;
    return { step: Number(step), losses };
  });
}

/**
 * Join the points of events and report: a report begins with the last attempt, events also cover the earlier ones.
 * @param {import("./history.js").Point[]} seen In the events.
 * @param {import("./history.js").Point[]} reported
 */
export function allPoints(seen, reported) {
  if (!reported.length) return seen;
  return [...seen.filter((point) => point.step < reported[0].step), ...reported];
}

/**
 * Describe a curve in a sentence, for those who cannot see it.
 * @param {string} name
 * @param {number[]} steps
 * @param {number[]} smooth
 * @param {(value: number) => string} written
 */
export function curveWords(name, steps, smooth, written) {
  if (!smooth.length) return `${name}: nothing yet`;
  const low = smooth.indexOf(Math.min(...smooth));
  const last = smooth.length - 1;
  return (
    `${name}, smoothed: ${written(smooth[0])} at step ${steps[0]}, ${written(smooth[last])} at step ${steps[last]}, ` +
    `lowest ${written(smooth[low])} at step ${steps[low]}`
  );
}
