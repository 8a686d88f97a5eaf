"""`/docs`: the OpenAPI document as one page, made here. It loads nothing from anywhere and has no script."""

from __future__ import annotations

import json
from html import escape
from typing import Any

__all__ = ["reference_page"]

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1, h2, h3 { line-height: 1.2 } h2 { margin-top: 2.5rem; border-top: 1px solid #ccc; padding-top: 1rem }
code, pre { font: 13px/1.45 ui-monospace, monospace } pre { background: #f5f5f2; padding: .75rem; overflow-x: auto }
table { border-collapse: collapse; width: 100% } td, th { text-align: left; vertical-align: top; padding: .3rem .6rem }
tr { border-bottom: 1px solid #e5e5e0 } .method { color: #0a5; font-weight: 600 } summary { cursor: pointer }
@media (prefers-color-scheme: dark) { body { background: #181818; color: #ddd } pre { background: #242424 }
  tr, h2 { border-color: #333 } }
"""
_CURL = """curl -i -F asset=@sphere.glb -F 'request={"prompt": "a mushroom", "params": {"preset": "preview"}}' \\
    http://HOST/v1/jobs"""


def reference_page(document: dict[str, Any]) -> str:
    """Return the page.

    Parameters
    ----------
    document : dict
        The OpenAPI document.
    """
    info = document["info"]
    operations = [
        _operation(path, method, operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    schemas = [_schema(name, schema) for name, schema in document["components"]["schemas"].items()]
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{escape(info['title'])}</title><style>{_STYLE}</style>"
        f"<h1>{escape(info['title'])} {escape(info['version'])}</h1><p>{escape(info['summary'])}</p>"
        f'<pre>{escape(_CURL)}</pre><p>For programs: <a href="/openapi.json">/openapi.json</a>.</p>'
        f"{''.join(operations)}<h2>Documents</h2>{''.join(schemas)}</html>"
    )


def _operation(path: str, method: str, operation: dict[str, Any]) -> str:
    parameters = [
        (parameter["name"], parameter["in"], parameter["schema"], parameter.get("description", ""))
        for parameter in operation.get("parameters", [])
    ]
    form = operation.get("requestBody", {}).get("content", {}).get("multipart/form-data", {}).get("schema", {})
    parameters += [
        (name, "form", schema, schema.get("description", "")) for name, schema in form.get("properties", {}).items()
    ]
    rows = "".join(
        f"<tr><td><code>{escape(name)}</code><td>{escape(place)}<td>{_type(schema)}<td>{_text(description)}"
        for name, place, schema, description in parameters
    )
    answers = "".join(
        f"<tr><td>{escape(status)}<td>{_text(answer.get('description', ''))}"
        for status, answer in operation["responses"].items()
    )
    return (
        f'<h2><span class="method">{method.upper()}</span> <code>{escape(path)}</code></h2>'
        f"<p>{_text(operation.get('summary', ''))}. {_text(operation.get('description', ''))}</p>"
        f"{f'<table>{rows}</table>' if rows else ''}<h3>Answers</h3><table>{answers}</table>"
    )


def _schema(name: str, schema: dict[str, Any]) -> str:
    rows = "".join(
        f"<tr><td><code>{escape(member)}</code><td>{_type(found)}<td>{_text(found.get('description', ''))}"
        f"<td>{_example(found)}"
        for member, found in schema.get("properties", {}).items()
    )
    values = ", ".join(f"<code>{escape(str(value))}</code>" for value in schema.get("enum", []))
    return (
        f'<details id="{escape(name)}"><summary><code>{escape(name)}</code></summary>'
        f"<p>{_text(schema.get('description', ''))} {values}</p><table>{rows}</table></details>"
    )


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f'<a href="#{escape(name)}">{escape(name)}</a>'
    if "anyOf" in schema:
        return " or ".join(_type(choice) for choice in schema["anyOf"])
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}))}"
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    bounds = " ".join(f"{sign} {schema[key]}" for key, sign in signs.items() if key in schema)
    default = f", default <code>{escape(json.dumps(schema['default']))}</code>" if "default" in schema else ""
    return f"{escape(str(schema.get('type', 'any')))} {escape(bounds)}{default}"


def _example(schema: dict[str, Any]) -> str:
    return f"<code>{escape(json.dumps(schema['examples'][0]))}</code>" if schema.get("examples") else ""


def _text(text: str) -> str:
    """Escape, and show `code` as code."""
    pieces = escape(text).split("`")
    return "".join(f"<code>{piece}</code>" if index % 2 else piece for index, piece in enumerate(pieces))
