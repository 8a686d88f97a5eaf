// @ts-check
/** The scene around an asset: one key light whose shadow falls on the ground, in any theme. */
import { Box3, DirectionalLight, Mesh, PlaneGeometry, Scene, ShadowMaterial, Vector3 } from "../vendor/three/three.module.js";
import { clay, meshesOf } from "./loading.js";

export class Stage {
  constructor() {
    this.scene = new Scene();
    this.scene.environmentIntensity = 0.5;
    this.key = new DirectionalLight(0xfffaf2, 1.55);
    this.key.castShadow = true;
    this.key.shadow.mapSize.setScalar(1024 * Math.min(1, globalThis.devicePixelRatio ?? 1)); // no finer than the screen
    this.key.shadow.radius = 8;
    this.key.shadow.bias = -0.0004;
    this.key.shadow.intensity = 0.75;
    this.key.shadow.autoUpdate = false; // only when the mesh changes
    this.ground = new Mesh(new PlaneGeometry(1, 1).rotateX(-Math.PI / 2), new ShadowMaterial({ depthWrite: false }));
    this.ground.receiveShadow = true;
    this.ground.renderOrder = -2;
    this.ground.visible = false;
    this.scene.add(this.key, this.key.target, this.ground);
    this.floating = false;
    this.setTheme(false);
  }

  /** @param {boolean} floating whether there is no ground below, and nothing casts a shadow */
  setFloating(floating) {
    this.floating = floating;
    this.key.castShadow = !floating;
    this.ground.visible = false;
  }

  /** Set light and ground up for a box. @param {Box3} box world units */
  enclose(box) {
    const center = box.getCenter(new Vector3());
    const radius = Math.max(box.max.distanceTo(box.min) / 2, 1e-12);
    this.ground.visible = !this.floating;
    this.ground.position.set(center.x, box.min.y - 0.003 * radius, center.z);
    this.ground.scale.setScalar(radius * 8);
    this.key.target.position.copy(center);
    this.key.position.set(-0.28, 1, 0.5).setLength(radius * 4).add(center);
    const camera = this.key.shadow.camera;
    const reach = radius * 1.5;
    Object.assign(camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: radius, far: radius * 8 });
    camera.updateProjectionMatrix();
    this.key.shadow.normalBias = radius * 0.008;
    this.refreshShadow();
  }

  refreshShadow() {
    this.key.shadow.needsUpdate = true;
  }

  /** @param {boolean} dark whether the page is */
  setTheme(dark) {
    this.ground.material.opacity = dark ? 0.55 : 0.24;
  }

  dispose() {
    this.key.shadow.dispose();
    this.ground.geometry.dispose();
    this.ground.material.dispose();
  }
}

/**
 * Box around what is drawn; exact where bones or turned nodes would make a quick one too large.
 * @param {import("three").Object3D} root
 * @returns {Box3} never empty
 */
export function boundsOf(root) {
  root.updateWorldMatrix(true, true);
  const box = new Box3();
  for (const mesh of meshesOf(root)) {
    const precise = mesh.geometry.attributes.position.count <= 300_000;
    box.union(new Box3().setFromObject(mesh, precise));
  }
  if (box.isEmpty()) box.set(new Vector3(-1, -1, -1), new Vector3(1, 1, 1));
  return box;
}

/**
 * Give an asset what the file does not say: shadows, sharp textures, and clay where a mesh has no material.
 * @param {import("three").Object3D} root
 * @param {import("three").WebGLRenderer} renderer
 */
export function dress(root, renderer) {
  const anisotropy = Math.min(8, renderer.capabilities.getMaxAnisotropy());
  for (const mesh of meshesOf(root)) {
    mesh.castShadow = mesh.receiveShadow = true;
    if (isDefault(mesh.material)) mesh.material = clay(mesh.geometry);
    for (const material of [mesh.material].flat()) {
      // Lines of a wireframe lie on the surface, not in it.
      material.polygonOffset = true;
      material.polygonOffsetFactor = material.polygonOffsetUnits = 1;
      for (const value of Object.values(material)) if (value?.isTexture) value.anisotropy = anisotropy;
    }
  }
}

/** @param {any} material @returns {boolean} whether it is what the loader makes of no material: white, rough metal */
function isDefault(material) {
  return (
    material.isMeshStandardMaterial &&
    material.name === "" &&
    material.metalness === 1 &&
    material.roughness === 1 &&
    material.color.getHex() === 0xffffff &&
    !Object.values(material).some((value) => value?.isTexture)
  );
}
