"""Generate the list of routes in docs/http.md, from the OpenAPI document."""

from __future__ import annotations

import json
from pathlib import Path

from docs.generation.between import renewed

__all__ = ["page"]

_DOCUMENT = Path(__file__).resolve().parents[2] / "openapi/openapi.json"


def page(text: str) -> str:
    """Return docs/http.md with its list of routes regenerated."""
    paths = json.loads(_DOCUMENT.read_text(encoding="utf-8"))["paths"]
    lines = [
        f"- `{method.upper()} {path}`: {operation['summary']}\n"
        for path, methods in paths.items()
        for method, operation in methods.items()
    ]
    return renewed(text, "openapi/openapi.json", "".join(lines))
