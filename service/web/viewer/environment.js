// @ts-check
/** The studio that the meshes stand in: soft boxes around a grey room, drawn once into a prefiltered cube map. */
import {
  BackSide,
  Color,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  PMREMGenerator,
  Scene,
  ShaderMaterial,
  SphereGeometry,
} from "../vendor/three/three.module.js";

/** Soft boxes: azimuth and elevation in degrees, width and height at distance 10, radiance. */
const LIGHTS = [
  { azimuth: -35, elevation: 48, width: 8, height: 7, radiance: 9 }, // key
  { azimuth: 85, elevation: 15, width: 5, height: 10, radiance: 3.2 }, // fill
  { azimuth: 165, elevation: 30, width: 12, height: 4, radiance: 6 }, // rim
  { azimuth: -110, elevation: 10, width: 3, height: 9, radiance: 3 }, // edge
  { azimuth: 0, elevation: 89, width: 9, height: 9, radiance: 3.2 }, // ceiling
];

/** @param {import("three").WebGLRenderer} renderer @returns {import("three").WebGLRenderTarget} its `texture` goes into `scene.environment` */
export function makeEnvironment(renderer) {
  const scene = new Scene();
  const room = new Mesh(
    new SphereGeometry(20, 32, 16),
    new ShaderMaterial({
      side: BackSide,
      depthWrite: false,
      uniforms: { ground: { value: new Color(0.13, 0.125, 0.12) }, sky: { value: new Color(0.42, 0.44, 0.47) } },
      vertexShader: `varying vec3 direction;
        void main() { direction = position; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
      fragmentShader: `uniform vec3 ground; uniform vec3 sky; varying vec3 direction;
        void main() { gl_FragColor = vec4(mix(ground, sky, smoothstep(-0.5, 0.7, normalize(direction).y)), 1.0); }`,
    }),
  );
  scene.add(room);
  for (const { azimuth, elevation, width, height, radiance } of LIGHTS) {
    const box = new Mesh(
      new PlaneGeometry(width, height),
      new MeshBasicMaterial({ color: new Color(radiance, radiance, radiance) }),
    );
    const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
    box.position.set(Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)).multiplyScalar(10);
    box.lookAt(0, 0, 0);
    scene.add(box);
  }
  const generator = new PMREMGenerator(renderer);
  const target = generator.fromScene(scene, 0, 0.1, 50);
  generator.dispose();
  for (const child of scene.children) {
    if (!(child instanceof Mesh)) continue;
    child.geometry.dispose();
    child.material.dispose();
  }
  return target;
}
