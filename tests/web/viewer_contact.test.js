// The soft darkness under an asset lies below what casts it, without a browser.
import assert from "node:assert/strict";
import { test } from "node:test";

import { Box3, Vector3 } from "../../service/web/vendor/three/three.module.js";
import { ContactShadow } from "../../service/web/viewer/contact.js";

test("a contact shadow is drawn below what casts it", () => {
  const shadow = new ContactShadow();
  shadow.enclose(new Box3(new Vector3(-1, 0, -2), new Vector3(3, 2, 5)));
  shadow.camera.updateMatrixWorld();
  shadow.floor.updateMatrixWorld();
  for (const [x, z] of [[-1, -2], [3, -2], [0, 5], [2.5, 1]]) {
    const seen = new Vector3(x, 0.5, z).project(shadow.camera); // the picture's middle is (0, 0), and the floor's
    const at = new Vector3(seen.x, seen.y, 0).applyMatrix4(shadow.floor.matrixWorld);
    assert.ok(Math.hypot(at.x - x, at.z - z) < 1e-6, `${x}, ${z} is drawn at ${at.x}, ${at.z}`);
  }
});
