// Writes the types of the API: node generate.mjs OPENAPI_DOCUMENT OUTPUT
import { readFile, writeFile } from "node:fs/promises";
import openapiTS, { astToString } from "openapi-typescript";
import ts from "typescript";

const [document, output] = process.argv.slice(2);
const blob = ts.factory.createTypeReferenceNode("Blob");
const types = await openapiTS(await readFile(document, "utf8"), {
  // Members with a default may be left out of a request.
  defaultNonNullable: false,
  transform: (schema) => (schema.format === "binary" ? blob : undefined),
});
await writeFile(output, `// Made from openapi/openapi.json by generate.mjs.\n${astToString(types)}`);
