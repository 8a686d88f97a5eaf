// Reads GLBs with glTF-Transform, compressed ones too: for each line of standard input, a list of paths as JSON, a line
// that says what each of the files has, or {"failed": "why"}.
import { createInterface } from "node:readline";
import { NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import draco3d from "draco3dgltf";
import { MeshoptDecoder } from "meshoptimizer";

const io = new NodeIO()
  .registerExtensions(ALL_EXTENSIONS)
  .registerDependencies({ "draco3d.decoder": await draco3d.createDecoderModule(), "meshopt.decoder": MeshoptDecoder });

function trianglesOf(mesh) {
  const corners = (primitive) => (primitive.getIndices() ?? primitive.getAttribute("POSITION")).getCount();
  return mesh.listPrimitives().reduce((sum, primitive) => sum + corners(primitive) / 3, 0);
}

async function count(file) {
  const root = (await io.read(file)).getRoot();
  const nodes = root.listNodes().filter((node) => node.getMesh());
  const copies = (node) => node.getExtension("EXT_mesh_gpu_instancing")?.listAttributes()[0].getCount() ?? 1;
  const targets = (mesh) => Math.max(0, ...mesh.listPrimitives().map((primitive) => primitive.listTargets().length));
  return {
    triangles: nodes.reduce((sum, node) => sum + trianglesOf(node.getMesh()) * copies(node), 0),
    joints: root.listSkins().map((skin) => skin.listJoints().length),
    animations: root.listAnimations().map((animation) => animation.listChannels().length).sort(),
    targets: nodes.reduce((sum, node) => sum + targets(node.getMesh()), 0),
    textures: root.listTextures().length,
    extensions: root.listExtensionsUsed().map((extension) => extension.extensionName).sort(),
  };
}

for await (const line of createInterface({ input: process.stdin })) {
  try {
    console.log(JSON.stringify(await Promise.all(JSON.parse(line).map(count))));
  } catch (error) {
    console.log(JSON.stringify({ failed: String(error) }));
  }
}
