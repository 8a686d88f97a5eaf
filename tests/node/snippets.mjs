/** Print the programs that the page offers for requests: `node snippets.mjs REQUESTS`, a list in JSON. */
Object.assign(globalThis, { document: { baseURI: "http://127.0.0.1:8765/" }, window: {} });
const { snippets } = await import("../../service/web/app/snippets.js");
console.log(JSON.stringify(JSON.parse(process.argv[2]).map(snippets)));
