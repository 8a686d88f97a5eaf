// @ts-check
/** Where the camera stands so that a box fills the picture. */

/**
 * Distance from the box's centre at which all of it is seen.
 * @param {[number, number, number]} half half the box's sides
 * @param {[number, number, number][]} axes the camera's right, up and backward directions, unit vectors
 * @param {number} fov vertical, degrees
 * @param {number} aspect width / height
 * @param {number} margin 1 touches the picture's border
 * @returns {number}
 */
export function fitDistance(half, axes, fov, aspect, margin = 1.04) {
  const tanY = Math.tan((fov * Math.PI) / 360) / margin;
  const tanX = tanY * aspect;
  let distance = 0;
  for (let corner = 0; corner < 8; corner++) {
    const point = half.map((size, axis) => (corner & (1 << axis) ? size : -size));
    const [x, y, z] = axes.map((axis) => axis[0] * point[0] + axis[1] * point[1] + axis[2] * point[2]);
    distance = Math.max(distance, Math.abs(x) / tanX + z, Math.abs(y) / tanY + z);
  }
  return distance;
}

/**
 * Unit vector from the target to the camera.
 * @param {number} azimuth degrees; 0 looks at the front (+Z), 90 at the left side (+X)
 * @param {number} elevation degrees above the horizon
 * @returns {[number, number, number]}
 */
export function viewDirection(azimuth, elevation) {
  const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
  return [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)];
}

/**
 * The camera's right, up and backward axes when it looks against a direction.
 * @param {[number, number, number]} back
 * @returns {[number, number, number][]}
 */
export function cameraAxes(back) {
  const length = Math.hypot(back[0], back[2]) || 1;
  /** @type {[number, number, number]} */
  const right = [back[2] / length, 0, -back[0] / length];
  /** @type {[number, number, number]} */
  const up = [
    back[1] * right[2] - back[2] * right[1],
    back[2] * right[0] - back[0] * right[2],
    back[0] * right[1] - back[1] * right[0],
  ];
  return [right, up, back];
}
