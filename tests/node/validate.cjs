// Reads one GLB from standard input, writes the Khronos validator's report as JSON to standard output.
const { validateBytes } = require("gltf-validator");
const chunks = [];
process.stdin.on("data", (chunk) => chunks.push(chunk));
process.stdin.on("end", () =>
  validateBytes(new Uint8Array(Buffer.concat(chunks)), { maxIssues: 0 }).then(
    (report) => process.stdout.write(JSON.stringify(report)),
    (error) => { process.stderr.write(String(error)); process.exit(1); },
  ),
);
