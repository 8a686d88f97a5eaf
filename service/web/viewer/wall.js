// @ts-check
/**
 * The wall of a family, `wall.glb`: shapes side by side, coloured by part. Point k of one corresponds to point k of any
 * other; pointing at a shape finds the nearest one, and the same point is marked on all of them.
 */
import { Box3, Box3Helper, InstancedMesh, Matrix4, Mesh, MeshBasicMaterial, Points, Quaternion, SphereGeometry, Vector3 } from "../vendor/three/three.module.js";
import { readJson } from "./glb.js";

const BALL = 0.02; // of a shape's diagonal
const HALO = 1.6;
const CHOSEN = [0xd9622b, 0x2b6fb3];
const STILL = 6; // pixels that a click may move

/** @typedef {{ name: string, node: import("three").Object3D, positions: Float32Array, sure: Float32Array }} Hung */
/** @typedef {{ shape: number, point: number }} Hit */

/**
 * What a wall says of itself.
 * @param {ArrayBuffer} buffer a GLB
 * @returns {{ parts: { name: string, colour: string }[], points: number[], shapes: number }} `points` has the part of each; `shapes` counts those that are not shown, too
 */
export function aboutWall(buffer) {
  const json = readJson(buffer);
  const { shapes, points } = json.asset.extras.meshdeform;
  const css = (/** @type {number[]} */ colour) => `rgb(${colour.slice(0, 3).map((value) => Math.round(255 * value ** (1 / 2.2))).join(" ")})`;
  return { shapes, points, parts: json.materials.map((/** @type {any} */ { name, pbrMetallicRoughness: { baseColorFactor } }) => ({ name, colour: css(baseColorFactor) })) };
}

export class Wall {
  /**
   * @param {import("./viewer.js").MeshViewer} viewer has loaded the wall
   * @param {{ pointed: (hit: Hit | null) => void, clicked: (shape: number) => void }} listeners
   */
  constructor(viewer, { pointed, clicked }) {
    this.viewer = viewer;
    this.shapes = hung(/** @type {import("three").Object3D} */ (viewer.root));
    this.balls = [marker(0x111111, HALO, this.shapes.length), marker(0xffffff, 1, this.shapes.length)];
    /** @type {Box3Helper[]} */
    this.frames = [];
    this.point = -1;
    viewer.stage.scene.add(...this.balls);
    // From the front, upright and without a ground: the rows hang above each other.
    viewer.stage.setFloating(true);
    viewer.rig.home.set(0, 0.06, 1).normalize();
    this.stop = new AbortController();
    const { canvas } = viewer.surface;
    const { signal } = this.stop;
    /** @type {[number, number]} */
    let from = [0, 0];
    canvas.addEventListener("pointermove", (event) => event.buttons === 0 && pointed(this.at(event)), { signal });
    canvas.addEventListener("pointerleave", () => pointed(null), { signal });
    canvas.addEventListener("pointerdown", (event) => void (from = [event.clientX, event.clientY]), { signal });
    canvas.addEventListener("pointerup", (event) => {
      if (Math.hypot(event.clientX - from[0], event.clientY - from[1]) > STILL) return;
      const hit = this.at(event);
      pointed(hit); // a finger points by touching
      if (hit) clicked(hit.shape);
    }, { signal });
  }

  /** Number of points of each shape. */
  get count() {
    return this.shapes[0].sure.length;
  }

  /** @param {number} point @returns {number} how many of the shapes have it */
  having(point) {
    return this.shapes.filter(({ sure }) => sure[point] > 0).length;
  }

  /** Turn every shape around its own vertical axis. @param {number} degrees */
  turn(degrees) {
    const turned = new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), (degrees * Math.PI) / 180);
    for (const { node } of this.shapes) node.quaternion.copy(turned);
    // What is framed holds the outer shapes however they were turned.
    this.viewer.ownBox.union(new Box3().setFromObject(/** @type {import("three").Object3D} */ (this.viewer.root)));
    this.viewer.rig.setBox(this.viewer.ownBox);
    this.viewer.stage.refreshShadow();
    this.mark(this.point);
    this.#outline();
  }

  /** Mark a point on all shapes that have it. @param {number} point -1 marks nothing */
  mark(point) {
    this.point = point;
    for (const ball of this.balls) {
      let used = 0;
      if (point >= 0) {
        for (const shape of this.shapes) {
          if (!(shape.sure[point] > 0)) continue;
          shape.node.updateMatrix();
          const size = BALL * (0.6 + 0.4 * shape.sure[point]) * ball.userData.size;
          ball.setMatrixAt(used++, new Matrix4().makeScale(size, size, size).setPosition(at(shape, point).applyMatrix4(shape.node.matrix)));
        }
      }
      ball.count = used;
      ball.instanceMatrix.needsUpdate = true;
    }
    this.viewer.invalidate();
  }

  /** Put a frame around shapes. @param {number[]} shapes */
  choose(shapes) {
    this.chosen = shapes;
    this.#outline();
  }

  #outline() {
    for (const frame of this.frames.splice(0)) {
      frame.removeFromParent();
      frame.dispose();
    }
    for (const [i, shape] of (this.chosen ?? []).entries()) {
      const box = new Box3().setFromObject(this.shapes[shape].node, true).expandByScalar(0.02);
      const frame = new Box3Helper(box, CHOSEN[i % CHOSEN.length]);
      frame.userData.overlay = true;
      this.frames.push(frame);
      this.viewer.stage.scene.add(frame);
    }
    this.viewer.invalidate();
  }

  /** @param {PointerEvent} event @returns {Hit | null} the point of a shape nearest to where a pointer points */
  at(event) {
    const [hit] = this.viewer.surface.cast(event, this.viewer.rig.camera).intersectObjects(this.shapes.flatMap(({ node }) => meshes(node)), false);
    if (!hit) return null;
    const shape = this.shapes.findIndex(({ node }) => node === hit.object || node === hit.object.parent);
    const local = this.shapes[shape].node.worldToLocal(hit.point.clone());
    let [nearest, point] = [Infinity, -1];
    for (const [k, sure] of this.shapes[shape].sure.entries()) {
      const far = sure > 0 ? at(this.shapes[shape], k).distanceToSquared(local) : Infinity;
      if (far < nearest) [nearest, point] = [far, k];
    }
    return point < 0 ? null : { shape, point };
  }

  dispose() {
    this.stop.abort();
    this.choose([]);
    for (const ball of this.balls) {
      ball.removeFromParent();
      ball.geometry.dispose();
      /** @type {import("three").Material} */ (ball.material).dispose();
      ball.dispose();
    }
  }
}

/** @param {import("three").Object3D} root @returns {Hung[]} in the order of the file */
function hung(root) {
  return root.children.map((node) => {
    const cloud = /** @type {Points} */ (node.children.find((child) => child instanceof Points));
    cloud.visible = false;
    const { position, _confidence: sure } = cloud.geometry.attributes;
    return { name: node.userData.name ?? node.name, node, positions: /** @type {Float32Array} */ (position.array), sure: /** @type {Float32Array} */ (sure.array) };
  });
}

/** @param {Hung} shape @param {number} point */
function at({ positions }, point) {
  return new Vector3().fromArray(positions, 3 * point);
}

/** @param {import("three").Object3D} node @returns {Mesh[]} */
function meshes(node) {
  return /** @type {Mesh[]} */ (node.children.filter((child) => child instanceof Mesh));
}

/** @param {number} color @param {number} size of a ball, times that of the inner one @param {number} most */
function marker(color, size, most) {
  const material = new MeshBasicMaterial({ color, toneMapped: false, depthTest: false, transparent: true });
  const balls = new InstancedMesh(new SphereGeometry(1, 16, 12), material, most);
  Object.assign(balls.userData, { overlay: true, size });
  balls.renderOrder = 4 - size;
  balls.count = 0;
  balls.frustumCulled = false;
  return balls;
}
