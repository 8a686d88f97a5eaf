"""Generate the page http_reference.md: every operation and document of the HTTP API, from the OpenAPI document.

docs/http.md, written by hand, explains the purpose of the operations and how to combine them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

_DOCUMENT = Path(__file__).resolve().parents[2] / "openapi/openapi.json"
_SIGNS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
_LENGTHS = {"minLength": "length ≥", "maxLength": "length ≤"}

_HEAD = """\
# HTTP reference

This page is generated from the OpenAPI document when the site is built. The document itself is in the repository
as `openapi/openapi.json`, and every running service has it at `/openapi.json`. [HTTP](http.md) explains the
operations, [Parameters](parameters.md) the parameters of a job, and [Errors](errors.md) the errors.

Every error is an `application/problem+json` document, [Problem](#problem).
"""


def page() -> str:
    """Return the whole page."""
    document = json.loads(_DOCUMENT.read_text())
    groups: dict[str, list[str]] = {}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            group = groups.setdefault(operation.get("tags", ["other"])[0], [])
            group.append(_operation(f"{method.upper()} {path}", operation, document))
    parts = [_HEAD]
    for tag, operations in groups.items():
        parts += [f"## {tag.capitalize()}\n", *operations]
    parts.append("## Documents\n")
    parts += [_document(name, schema) for name, schema in sorted(document["components"]["schemas"].items())]
    return "\n".join(parts)


def _operation(title: str, operation: dict[str, Any], document: dict[str, Any]) -> str:
    parts = [f"### {title}\n", f"**{operation['summary']}.** {operation.get('description', '')}".strip() + "\n"]
    rows = [
        (found["name"], found["in"], found["schema"], found.get("description", ""), found.get("required", False))
        for found in (_found(each, document) for each in operation.get("parameters", []))
    ]
    for kind, content in _found(operation.get("requestBody", {}), document).get("content", {}).items():
        schema = _found(content.get("schema", {}), document)
        if kind == "multipart/form-data":
            rows += [
                (name, "form", part, part.get("description", ""), name in schema.get("required", []))
                for name, part in schema.get("properties", {}).items()
            ]
        else:
            parts.append(f"Body: `{kind}`, {_kind(content.get('schema', {}))}.\n")
    if rows:
        lines = [
            f"| `{name}` | {place} | {_kind(schema)} | {'required. ' if required else ''}{_cell(text)} |"
            for name, place, schema, text, required in rows
        ]
        parts.append("\n".join(["| parameter | in | kind | meaning |", "|---|---|---|---|", *lines]) + "\n")
    lines = [
        f"| {status} | {_body(answer)} | {_cell(answer.get('description', ''))} |"
        for status, answer in ((key, _found(value, document)) for key, value in sorted(operation["responses"].items()))
    ]
    parts.append("\n".join(["| answer | body | meaning |", "|---|---|---|", *lines]) + "\n")
    return "\n".join(parts)


def _body(answer: dict[str, Any]) -> str:
    kinds = [
        _kind(content["schema"]) if "$ref" in content.get("schema", {}) else f"`{kind}`"
        for kind, content in answer.get("content", {}).items()
    ]
    return " or ".join(kinds)


def _document(name: str, schema: dict[str, Any]) -> str:
    parts = [f"### {name}\n", f"{schema.get('description', '')}\n"]
    if "enum" in schema:
        parts.append("One of " + ", ".join(f"`{value}`" for value in schema["enum"]) + ".\n")
    rows = [
        f"| `{member}` | {_kind(found)} | {_cell(found.get('description', ''))} | {_example(found)} |"
        for member, found in schema.get("properties", {}).items()
    ]
    if rows:
        parts.append("\n".join(["| member | kind | meaning | example |", "|---|---|---|---|", *rows]) + "\n")
    return "\n".join(parts)


def _found(value: dict[str, Any], document: dict[str, Any]) -> dict[str, Any]:
    """Resolve a reference; return anything else unchanged."""
    while "$ref" in value:
        *way, name = value["$ref"].removeprefix("#/").split("/")
        place: dict[str, Any] = document
        for step in way:
            place = place[step]
        value = place[name]
    return value


def _kind(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in schema:
        return " or ".join(_kind(choice) for choice in schema["anyOf"])
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return " or ".join(f"`{value}`" for value in schema["enum"])
    if schema.get("type") == "array":
        return f"list of {_kind(schema.get('items', {}))}"
    limits = [f"{sign} {schema[key]:,}" for key, sign in (_SIGNS | _LENGTHS).items() if key in schema]
    kind = str(schema.get("format") or schema.get("type", "any"))
    default = f", default `{json.dumps(schema['default'])}`" if schema.get("default") is not None else ""
    return f"{kind} {', '.join(limits)}".strip() + default


def _example(schema: dict[str, Any]) -> str:
    return f"`{json.dumps(schema['examples'][0], ensure_ascii=False)}`" if schema.get("examples") else ""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
