// Reads GLBs from standard input, each after its length (four bytes, little-endian), and writes a line of JSON for each:
// the Khronos validator's report, or {"failed": "why"}.
const { validateBytes } = require("gltf-validator");

const report = (glb) =>
  validateBytes(new Uint8Array(glb), { maxIssues: 0 }).catch((error) => ({ failed: String(error) }));

async function main() {
  let waiting = Buffer.alloc(0);
  for await (const chunk of process.stdin) {
    waiting = Buffer.concat([waiting, chunk]);
    while (waiting.length >= 4 && waiting.length >= 4 + waiting.readUInt32LE(0)) {
      const end = 4 + waiting.readUInt32LE(0);
      process.stdout.write(`${JSON.stringify(await report(waiting.subarray(4, end)))}\n`);
      waiting = waiting.subarray(end);
    }
  }
}

main();
