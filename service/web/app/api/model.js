// @ts-check
/**
 * The OpenAPI document as a reader looks at it: operations by their tags, and schemas as members with their types.
 *
 * @typedef {object} Operation
 * @property {string} id
 * @property {string} method
 * @property {string} path
 * @property {string} summary
 * @property {string} about
 * @property {any[]} parameters
 * @property {{type: string, schema: any, example: any} | null} body
 * @property {{status: string, about: string, schema: any}[]} answers
 * @property {boolean} open No key is needed.
 *
 * @typedef {{name: string, type: string, required: boolean, about: string, schema: any}} Member `schema`: of what it has
 *   inside; null where it is a word or a number.
 */
import { quoted } from "../format.js";

/** @param {any} spec @returns {{tag: string, about: string, operations: Operation[]}[]} */
export function sections(spec) {
  const all = Object.entries(spec.paths).flatMap(([path, methods]) => Object.entries(/** @type {any} */ (methods)).map(([method, said]) => ({ tag: said.tags?.[0] ?? "", operation: operationOf(spec, path, method, said) })));
  return spec.tags.map((/** @type {any} */ { name, description }) => ({ tag: name, about: description, operations: all.filter(({ tag }) => tag === name).map(({ operation }) => operation) })).filter((/** @type {any} */ { operations }) => operations.length);
}

/** @param {any} spec @param {string} path @param {string} method @param {any} said @returns {Operation} */
function operationOf(spec, path, method, said) {
  const [type, content] = Object.entries(said.requestBody?.content ?? {})[0] ?? [];
  return {
    id: said.operationId,
    method: method.toUpperCase(),
    path,
    summary: said.summary ?? "",
    about: said.description ?? "",
    parameters: said.parameters ?? [],
    body: type ? { type, schema: content.schema, example: content.example ?? Object.values(content.examples ?? {})[0]?.value } : null,
    answers: Object.entries(said.responses).map(([status, answer]) => ({ status, about: /** @type {any} */ (answer).description ?? "", schema: schemaOf(answer) })),
    open: !(said.security ?? spec.security ?? []).some((/** @type {any} */ each) => "apiKey" in each),
  };
}

/** @param {any} answer */
function schemaOf(answer) {
  return answer.content?.["application/json"]?.schema ?? null;
}

/** Whether an operation has all words that somebody looks for. @param {Operation} operation @param {string} words */
export function matches(operation, words) {
  const text = `${operation.method} ${operation.path} ${operation.summary} ${operation.id}`.toLowerCase();
  return words.toLowerCase().split(/\s+/).every((word) => text.includes(word));
}

/** What a schema says itself, and what it refers to. @param {any} spec @param {any} schema @returns {any} */
export function resolved(spec, schema) {
  const name = schema?.$ref?.split("/").pop();
  return name ? { ...spec.components.schemas[name], ...without(schema, "$ref") } : (schema ?? {});
}

/** @param {Record<string, any>} value @param {string} name */
function without(value, name) {
  return Object.fromEntries(Object.entries(value).filter(([key]) => key !== name));
}

/** Members of an object; of a choice or a list, those of what it is made of. @param {any} spec @param {any} schema @returns {Member[]} */
export function members(spec, schema) {
  const known = resolved(spec, schema);
  const inner = variants(known).map((each) => resolved(spec, each)).filter((each) => each.type !== "null");
  if (inner.length === 1) return members(spec, inner[0]);
  if (inner.length) return inner.flatMap((each) => (hasInside(spec, each) ? [member(spec, each.title ?? typeOf(spec, each), each, false)] : []));
  if (known.type === "array") return members(spec, known.items);
  const required = new Set(known.required ?? []);
  return Object.entries(known.properties ?? {}).map(([name, each]) => member(spec, name, each, required.has(name)));
}

/** @param {any} spec @param {string} name @param {any} schema @param {boolean} required @returns {Member} */
function member(spec, name, schema, required) {
  const known = resolved(spec, schema);
  return { name, type: typeOf(spec, schema), required, about: [known.description, bounds(known)].filter(Boolean).join(" "), schema: hasInside(spec, schema) ? schema : null };
}

/** @param {any} schema @returns {any[]} */
function variants(schema) {
  return schema.anyOf ?? schema.oneOf ?? [];
}

/** @param {any} spec @param {any} schema @returns {boolean} */
function hasInside(spec, schema) {
  const known = resolved(spec, schema);
  if (known.type === "array") return hasInside(spec, known.items ?? {});
  return Boolean(known.properties) || variants(known).some((each) => hasInside(spec, each));
}

/** The type in one or two words. @param {any} spec @param {any} schema @returns {string} */
export function typeOf(spec, schema) {
  const known = resolved(spec, schema);
  if (known.enum) return known.enum.map((/** @type {any} */ each) => JSON.stringify(each)).join(" | ");
  if ("const" in known) return JSON.stringify(known.const);
  const choices = [...new Set(variants(known).map((each) => typeOf(spec, each)))];
  if (choices.length) return choices.join(" | ");
  if (known.type === "array") return known.items ? `list of ${typeOf(spec, known.items)}` : "list";
  if (known.format === "binary" || known.contentMediaType) return "bytes";
  return [known.type].flat().join(" | ") || "any";
}

/** @param {any} schema */
function bounds(schema) {
  const said = [
    schema.minimum !== undefined ? `at least ${schema.minimum}` : null,
    schema.exclusiveMinimum !== undefined ? `more than ${schema.exclusiveMinimum}` : null,
    schema.maximum !== undefined ? `at most ${schema.maximum}` : null,
    schema.maxLength !== undefined ? `at most ${schema.maxLength} characters` : null,
    schema.default !== undefined && schema.default !== null && typeof schema.default !== "object" ? `default ${JSON.stringify(schema.default)}` : null,
  ].filter(Boolean);
  return said.length ? `(${said.join(", ")})` : "";
}

/** One request with curl. @param {any} spec @param {Operation} operation @param {string} baseUrl @param {boolean} keyed */
export function curlOf(spec, operation, baseUrl, keyed) {
  const path = operation.path.replace(/\{(\w+)\}/g, (whole, name) => exampleOf(operation.parameters.find((each) => each.name === name)) ?? whole);
  const needed = operation.parameters.filter((each) => each.in === "query" && each.required);
  const query = needed.length ? `?${new URLSearchParams(needed.map((each) => [each.name, String(exampleOf(each) ?? "")]))}` : "";
  const words = ["curl -sS", operation.method === "GET" ? "" : `-X ${operation.method}`, keyed && !operation.open ? '-H "Authorization: Bearer $MESHDEFORM_API_KEY"' : ""];
  const [first, ...rest] = [words.filter(Boolean).join(" "), ...bodyOf(spec, operation), quoted(`${baseUrl.replace(/\/$/, "")}${path}${query}`)];
  return [first, ...rest].join(rest.length > 1 ? " \\\n  " : " ");
}

/** @param {any} spec @param {Operation} operation @returns {string[]} */
function bodyOf(spec, { body }) {
  if (!body) return [];
  if (body.type === "multipart/form-data") {
    const fields = members(spec, body.schema).filter(({ name, required }) => required || name === "asset");
    return fields.map(({ name, type }) => (type === "bytes" ? `-F ${name}=@${name === "asset" ? "asset" : name}.glb` : `--form-string ${name}=${quoted(JSON.stringify(body.example?.[name] ?? {}))}`));
  }
  if (body.type === "application/octet-stream") return ["-H 'Content-Type: application/octet-stream'", "--data-binary @file"];
  return [`-H ${quoted(`Content-Type: ${body.type}`)}`, `--data-raw ${quoted(JSON.stringify(body.example ?? {}))}`];
}

/** @param {any} parameter */
function exampleOf(parameter) {
  return parameter?.example ?? parameter?.schema?.examples?.[0] ?? parameter?.schema?.example ?? parameter?.schema?.default;
}
