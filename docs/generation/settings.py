"""Generate the table in docs/configuration.md: every setting with its kind, bounds and default."""

from __future__ import annotations

from typing import Any

from docs.generation.between import renewed
from meshdeform.settings import Settings

SOURCE = "meshdeform/settings.py"
_BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<", "minLength": "length ≥"}
_KINDS = {
    "string": "text",
    "integer": "whole number",
    "number": "number",
    "array": "list",
    "boolean": "`true` or `false`",
}


def page(text: str) -> str:
    """Return the page with its table regenerated."""
    return renewed(text, SOURCE, table())


def table() -> str:
    """Return a table of all settings, in the order of the class."""
    schema = Settings.model_json_schema()["properties"]
    rows = [
        f"| [MESHDEFORM_{name.upper()}](#meshdeform_{name}) | {_kind(schema[name])} | {_default(name)} |"
        for name in Settings.model_fields
    ]
    return "\n".join(["| setting | kind | default |", "|---|---|---|", *rows]) + "\n"


def _kind(schema: dict[str, Any]) -> str:
    if "enum" in schema:
        return " or ".join(f"`{value}`" for value in schema["enum"])
    limits = ", ".join(f"{sign} {schema[key]:,}" for key, sign in _BOUNDS.items() if key in schema)
    return _KINDS[schema["type"]] + (f", {limits}" if limits else "")


def _default(name: str) -> str:
    value = Settings.model_fields[name].get_default(call_default_factory=True)
    return f"`{value}`" if value not in ("", []) else ""
