// Loads GLBs with three.js' GLTFLoader: for each line of standard input, a list of paths as JSON, a line that says what
// each of the files has on screen, or {"failed": "why"}.
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";

// What the loader asks of a browser: pictures are not looked at here.
globalThis.self = globalThis;
globalThis.createImageBitmap = async () => ({ width: 1, height: 1, close() {} });
const { Box3 } = await import("three");
const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
const { MeshoptDecoder } = await import("three/addons/libs/meshopt_decoder.module.js");

async function count(file) {
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  const data = readFileSync(file);
  const gltf = await loader.parseAsync(data.buffer.slice(data.byteOffset, data.byteOffset + data.length), "");
  const found = { meshes: 0, triangles: 0, vertices: 0, bones: 0, lights: 0, targets: 0, textured: 0, colored: 0 };
  gltf.scene.updateMatrixWorld(true);
  gltf.scene.traverse((object) => {
    if (object.isBone) found.bones += 1;
    if (object.isLight) found.lights += 1;
    if (!object.isMesh) return;
    const { geometry, material } = object;
    const corners = geometry.index ? geometry.index.count : geometry.attributes.position.count;
    found.meshes += 1;
    found.triangles += (corners / 3) * (object.count ?? 1);
    found.vertices += geometry.attributes.position.count;
    found.targets += object.morphTargetInfluences?.length ?? 0;
    found.textured += material.map ? 1 : 0;
    found.colored += geometry.attributes.color ? 1 : 0;
  });
  // As the renderer would draw it: with skins posed and morph targets mixed in.
  const box = new Box3().setFromObject(gltf.scene, true);
  const names = (found) => found.map((each) => each.name);
  return {
    ...found,
    animations: gltf.animations.map(({ tracks }) => tracks.length).sort(),
    clips: names(gltf.animations),
    cameras: gltf.cameras.length,
    box: [box.min.toArray(), box.max.toArray()],
  };
}

for await (const line of createInterface({ input: process.stdin })) {
  try {
    console.log(JSON.stringify(await Promise.all(JSON.parse(line).map(count))));
  } catch (error) {
    console.log(JSON.stringify({ failed: String(error) }));
  }
}
