// @ts-check
/** The soft darkness under an asset: how near the ground what is above it is, blurred. */
import {
  DoubleSide,
  HalfFloatType,
  Mesh,
  MeshBasicMaterial,
  MeshDepthMaterial,
  OrthographicCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  Vector2,
  WebGLRenderTarget,
} from "../vendor/three/three.module.js";

const SIZE = 256;
/** How far the floor reaches, in half lengths of the box. */
const REACH = 1.7;
/** Blur radius in shares of the floor. */
const BLURS = [0.035, 0.012];

export class ContactShadow {
  constructor() {
    const options = { type: HalfFloatType, depthBuffer: true };
    this.target = new WebGLRenderTarget(SIZE, SIZE, options);
    this.spare = new WebGLRenderTarget(SIZE, SIZE, { ...options, depthBuffer: false });
    this.camera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
    this.camera.up.set(0, 0, 1);
    this.depth = new MeshDepthMaterial({ side: DoubleSide });
    this.depth.onBeforeCompile = (shader) => {
      // Opaque black at the ground, nothing at the far end.
      shader.fragmentShader = shader.fragmentShader.replace(
        "gl_FragColor = vec4( vec3( 1.0 - fragCoordZ ), opacity );",
        "gl_FragColor = vec4( 0.0, 0.0, 0.0, pow( 1.0 - fragCoordZ, 2.0 ) );",
      );
    };
    this.blur = new ShaderMaterial({
      uniforms: { source: { value: null }, direction: { value: new Vector2() } },
      vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }",
      fragmentShader: `uniform sampler2D source; uniform vec2 direction; varying vec2 at;
        void main() {
          float sum = 0.0, total = 0.0;
          for (int i = -8; i <= 8; i++) {
            float x = float(i) / 8.0, weight = exp(-3.0 * x * x);
            sum += weight * texture2D(source, at + x * direction).a;
            total += weight;
          }
          gl_FragColor = vec4(0.0, 0.0, 0.0, sum / total);
        }`,
      depthTest: false,
      depthWrite: false,
    });
    this.screen = new Scene();
    this.screen.add(new Mesh(new PlaneGeometry(2, 2), this.blur));
    this.floor = new Mesh(
      new PlaneGeometry(2, 2),
      new MeshBasicMaterial({ map: this.target.texture, transparent: true, depthWrite: false, toneMapped: false }),
    );
    this.floor.rotation.x = -Math.PI / 2;
    this.floor.renderOrder = -1;
    this.floor.frustumCulled = false;
    this.needsUpdate = false;
  }

  /** @param {import("three").Box3} box */
  enclose(box) {
    const [x, z] = [(box.min.x + box.max.x) / 2, (box.min.z + box.max.z) / 2];
    const height = Math.max(box.max.y - box.min.y, 1e-9);
    const half = Math.max(box.max.x - box.min.x, box.max.z - box.min.z, 0.3 * height) / 2;
    const reach = REACH * half;
    this.floor.position.set(x, box.min.y - 0.004 * half, z);
    this.floor.scale.set(reach, reach, 1);
    // From below the picture is upside down.
    Object.assign(this.camera, { left: -reach, right: reach, top: -reach, bottom: reach, near: 0, far: Math.min(0.6 * height, half) });
    this.camera.position.copy(this.floor.position);
    this.camera.lookAt(x, box.max.y + height, z);
    this.camera.updateProjectionMatrix();
    this.needsUpdate = true;
  }

  /**
   * Draw the shadow again if something moved.
   * @param {import("three").WebGLRenderer} gl
   * @param {import("three").Scene} scene
   * @param {import("three").Object3D[]} hidden what casts none
   */
  update(gl, scene, hidden) {
    if (!this.needsUpdate) return;
    this.needsUpdate = false;
    const before = hidden.map((object) => object.visible);
    for (const object of hidden) object.visible = false;
    const { overrideMaterial } = scene;
    scene.overrideMaterial = this.depth;
    gl.setRenderTarget(this.target);
    gl.clear();
    gl.render(scene, this.camera);
    scene.overrideMaterial = overrideMaterial;
    hidden.forEach((object, i) => (object.visible = before[i]));
    for (const radius of BLURS) {
      this.#pass(gl, this.target, this.spare, radius, 0);
      this.#pass(gl, this.spare, this.target, 0, radius);
    }
    gl.setRenderTarget(null);
  }

  /** @param {import("three").WebGLRenderer} gl @param {WebGLRenderTarget} from @param {WebGLRenderTarget} to @param {number} x @param {number} y */
  #pass(gl, from, to, x, y) {
    this.blur.uniforms.source.value = from.texture;
    this.blur.uniforms.direction.value.set(x, y);
    gl.setRenderTarget(to);
    gl.render(this.screen, this.camera);
  }

  dispose() {
    for (const one of [this.target, this.spare, this.depth, this.blur, this.floor.geometry, this.floor.material]) {
      one.dispose();
    }
    /** @type {any} */ (this.screen.children[0]).geometry.dispose();
  }
}
