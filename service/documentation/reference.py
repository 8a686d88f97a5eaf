"""Render `/docs`: the OpenAPI document as one HTML page, without scripts; its fonts are the web page's."""

from __future__ import annotations

import functools
import json
from html import escape
from pathlib import Path
from typing import Any

__all__ = ["reference_page"]

_WEB = Path(__file__).parents[1] / "web"
_STYLE = """
* { box-sizing: border-box }
html { scroll-padding-top: 1rem }
body { margin: 0; background: var(--ground); color: var(--ink); font: 400 15.5px/1.5 var(--sans) }
a { color: var(--accent) } a:hover { color: var(--accent-strong) }
:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px }
.top { display: flex; align-items: center; gap: 1.5rem; padding: .8rem var(--edge);
  border-bottom: 1px solid var(--line) }
.brand { display: flex; align-items: center; gap: .6rem; margin-right: auto; color: var(--ink); font-weight: 600;
  text-decoration: none }
.brand svg { width: 26px; height: 26px }
.page { display: grid; grid-template-columns: 16rem minmax(0, 60rem); gap: 3rem; padding: 0 var(--edge) 4rem }
nav.contents { position: sticky; top: 0; align-self: start; max-height: 100vh; overflow-y: auto; padding: 1.5rem 0;
  font-size: 14px }
nav.contents ul { list-style: none; margin: 0 0 1rem; padding: 0 } nav.contents a { text-decoration: none }
h1 { font: 400 clamp(34px, 4.6vw, 54px)/1.05 var(--serif); margin: 2rem 0 1rem }
h2 { font: 400 32px/1.15 var(--serif); margin: 3rem 0 .5rem }
h3 { font-size: 17px; margin: 2.5rem 0 .5rem; border-top: 1px solid var(--line); padding-top: 1.2rem }
h4 { font-size: 15px; margin: 1rem 0 .3rem }
code, pre { font: 13px/1.45 var(--mono) } code { overflow-wrap: anywhere }
pre { background: var(--sunken); border-radius: var(--radius-small); padding: .75rem 1rem; overflow-x: auto }
.method { color: var(--good); font-weight: 600 }
.scroll { overflow-x: auto } table { border-collapse: collapse; width: 100% }
td, th { text-align: left; vertical-align: top; padding: .35rem .6rem .35rem 0 }
td:first-child code { white-space: nowrap }
tr { border-bottom: 1px solid var(--line) } th { color: var(--muted); font-weight: 500 } summary { cursor: pointer }
@media (max-width: 60rem) { .page { display: block } nav.contents { position: static; max-height: none } }
"""
_CURL = """curl -i -F asset=@sphere.glb -F 'request={"prompt": "a mushroom", "params": {"preset": "preview"}}' \\
    http://HOST/v1/jobs"""
_SIGNS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}

_newest: tuple[dict[str, Any], str] | None = None


def reference_page(document: dict[str, Any]) -> str:
    """Return the page. It is rendered once for a document that does not change.

    Parameters
    ----------
    document : dict
        The OpenAPI document.
    """
    global _newest
    known = _newest
    if known is None or known[0] is not document:
        known = _newest = document, _rendered(document)
    return known[1]


def _rendered(document: dict[str, Any]) -> str:
    info = document["info"]
    operations: dict[str, list[tuple[str, str, dict[str, Any]]]] = {tag["name"]: [] for tag in document["tags"]}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            operations[operation["tags"][0]].append((path, method, operation))
    sections = "".join(
        f'<h2 id="{_anchor(tag["name"])}">{escape(tag["name"].capitalize())}</h2><p>{_text(tag["description"])}</p>'
        + "".join(_operation(*operation) for operation in operations[tag["name"]])
        for tag in document["tags"]
    )
    schemas = "".join(_schema(name, schema) for name, schema in document["components"]["schemas"].items())
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{escape(info['title'])} API</title><style>{_colours()}{_STYLE}</style></head><body>"
        f'<header class="top"><a class="brand" href="./">{_logo()}{escape(info["title"])}</a>'
        '<a href="./">Web page</a><a href="openapi.json">OpenAPI (JSON)</a></header>'
        f'<div class="page"><nav class="contents" aria-label="Contents">{_contents(operations)}</nav><main>'
        f"<h1>API reference</h1><p>Version {escape(info['version'])}. {escape(info['summary'])} "
        f"{_text(info['description'])}</p><pre>{escape(_CURL)}</pre>"
        f'{sections}<h2 id="documents">Documents</h2>{schemas}</main></div></body></html>'
    )


@functools.cache
def _colours() -> str:
    """Return the page's design tokens; the fonts come from the page's folder."""
    return (_WEB / "style/tokens.css").read_text(encoding="utf-8").replace('url("', 'url("web/style/')


@functools.cache
def _logo() -> str:
    logo = (_WEB / "icons/meshdeform.svg").read_text(encoding="utf-8").strip()
    return logo.replace("<svg ", '<svg aria-hidden="true" ', 1)


def _anchor(name: str) -> str:
    return f"tag-{escape(name)}"


def _contents(operations: dict[str, list[tuple[str, str, dict[str, Any]]]]) -> str:
    groups = "".join(
        f'<a href="#{_anchor(tag)}"><strong>{escape(tag.capitalize())}</strong></a><ul>'
        + "".join(
            f'<li><a href="#{escape(operation["operationId"])}">{escape(operation["summary"])}</a></li>'
            for _, _, operation in found
        )
        + "</ul>"
        for tag, found in operations.items()
    )
    return f'{groups}<a href="#documents"><strong>Documents</strong></a>'


def _operation(path: str, method: str, operation: dict[str, Any]) -> str:
    parameters = [
        (parameter["name"], parameter["in"], parameter["schema"], parameter.get("description", ""))
        for parameter in operation.get("parameters", [])
    ]
    form = operation.get("requestBody", {}).get("content", {}).get("multipart/form-data", {}).get("schema", {})
    parameters += [
        (name, "form", schema, schema.get("description", "")) for name, schema in form.get("properties", {}).items()
    ]
    rows = [
        f"<td><code>{escape(name)}</code><td>{escape(place)}<td>{_type(schema)}<td>{_text(description)}"
        for name, place, schema, description in parameters
    ]
    responses = [
        f"<td>{escape(status)}<td>{_text(response.get('description', ''))}"
        for status, response in operation["responses"].items()
    ]
    return (
        f'<section><h3 id="{escape(operation["operationId"])}">{escape(operation["summary"])}</h3>'
        f'<p><span class="method">{method.upper()}</span> <code>{escape(path)}</code></p>'
        f"<p>{_text(operation.get('description', ''))}</p>"
        f"{_table(['parameter', 'in', 'type', ''], rows) if rows else ''}"
        f"<h4>Responses</h4>{_table(['status', ''], responses)}</section>"
    )


def _schema(name: str, schema: dict[str, Any]) -> str:
    rows = [
        f"<td><code>{escape(member)}</code><td>{_type(found)}<td>{_text(found.get('description', ''))}"
        f"<td>{_example(found)}"
        for member, found in schema.get("properties", {}).items()
    ]
    values = ", ".join(f"<code>{escape(str(value))}</code>" for value in schema.get("enum", []))
    return (
        f'<details id="{escape(name)}"><summary><code>{escape(name)}</code></summary>'
        f"<p>{_text(schema.get('description', ''))} {values}</p>"
        f"{_table(['member', 'type', '', 'example'], rows) if rows else ''}</details>"
    )


def _table(heads: list[str], rows: list[str]) -> str:
    head = "".join(f"<th>{escape(each)}" for each in heads)
    return f'<div class="scroll"><table><tr>{head}{"".join(f"<tr>{row}" for row in rows)}</table></div>'


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f'<a href="#{escape(name)}">{escape(name)}</a>'
    if "anyOf" in schema:
        return " or ".join(_type(choice) for choice in schema["anyOf"])
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}))}"
    bounds = " ".join(f"{sign} {schema[key]}" for key, sign in _SIGNS.items() if key in schema)
    default = f", default <code>{escape(json.dumps(schema['default']))}</code>" if "default" in schema else ""
    name = "file" if schema.get("format") == "binary" else str(schema.get("type", "any"))
    return f"{escape(name)} {escape(bounds)}{default}"


def _example(schema: dict[str, Any]) -> str:
    return f"<code>{escape(json.dumps(schema['examples'][0]))}</code>" if schema.get("examples") else ""


def _text(text: str) -> str:
    """Return the text escaped, with `code` as code."""
    pieces = escape(text).split("`")
    return "".join(f"<code>{piece}</code>" if index % 2 else piece for index, piece in enumerate(pieces))
