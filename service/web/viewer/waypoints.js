// @ts-check
/** Values between known ones: a smooth curve through what is known at some shares of a way. */

/** @typedef {{ t: number, values: Float32Array }} Knot a share of the way, and all values there */

/** Add a knot in its place, or replace the one at the same share. @param {Knot[]} knots ascending @param {Knot} knot */
export function addKnot(knots, knot) {
  const at = knots.findIndex(({ t }) => t >= knot.t);
  if (at < 0) knots.push(knot);
  else knots.splice(at, knots[at].t === knot.t ? 1 : 0, knot);
}

/**
 * Write the values at a share of the way: cubic between the knots, straight where there are only two.
 * @param {Knot[]} knots two or more, ascending
 * @param {number} t not outside of them
 * @param {import("three").TypedArray} out
 */
export function writeBetween(knots, t, out) {
  const exact = knots.find((knot) => knot.t === t);
  // Where something is known, it is the file's own numbers, without rounding.
  if (exact) return void out.set(exact.values);
  const next = knots.findIndex((knot) => knot.t > t);
  const [a, b] = [knots[next - 1], knots[next]];
  const [before, after] = [knots[next - 2] ?? a, knots[next + 1] ?? b];
  const [length, left, right] = [b.t - a.t, b.t - before.t, after.t - a.t];
  const u = (t - a.t) / length;
  if (knots.length === 2) {
    for (let i = 0; i < out.length; i++) out[i] = a.values[i] + u * (b.values[i] - a.values[i]);
    return;
  }
  // Hermite's curve; its slopes at the knots are those between their neighbours.
  const [startSlope, endSlope] = [u * (1 - u) ** 2 * length, u * u * (u - 1) * length];
  const share = u * u * (3 - 2 * u);
  for (let i = 0; i < out.length; i++) {
    const [from, to] = [a.values[i], b.values[i]];
    const slopes = [(to - before.values[i]) / left, (after.values[i] - from) / right];
    out[i] = from + share * (to - from) + startSlope * slopes[0] + endSlope * slopes[1];
  }
}
