// The wall of a family without a browser: what is framed holds all shapes, however they are turned.
import assert from "node:assert/strict";
import { test } from "node:test";

import { Box3, BoxGeometry, BufferAttribute, BufferGeometry, Group, Mesh, Points, Vector3 } from "../../service/web/vendor/three/three.module.js";
import { Wall } from "../../service/web/viewer/wall.js";

/** A wide shape at a place along x. */
function shape(x) {
  const cloud = new BufferGeometry();
  cloud.setAttribute("position", new BufferAttribute(new Float32Array(3), 3));
  cloud.setAttribute("_confidence", new BufferAttribute(new Float32Array([1]), 1));
  const node = new Group().add(new Points(cloud), new Mesh(new BoxGeometry(0.2, 1, 2)));
  node.position.x = x;
  return node;
}

test("the outer shapes of a wall are framed as they are turned", () => {
  const root = new Group().add(shape(-3), shape(3));
  const viewer = {
    root,
    ownBox: new Box3().setFromObject(root),
    framed: new Box3(),
    stage: { scene: new Group(), setFloating() {}, refreshShadow() {} },
    rig: { home: new Vector3(), setBox: (/** @type {Box3} */ box) => viewer.framed.copy(box) },
    surface: { canvas: new EventTarget() },
    invalidate() {},
  };
  const wall = new Wall(/** @type {any} */ (viewer), { pointed() {}, clicked() {} });
  assert.ok(viewer.ownBox.max.x < 3.2);
  wall.turn(90);
  assert.ok(viewer.framed.containsBox(new Box3().setFromObject(root, true)));
  assert.ok(viewer.framed.max.x > 3.9);
});
