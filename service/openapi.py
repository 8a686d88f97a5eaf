"""The OpenAPI document: what FastAPI finds, and the schemas that only the multipart body and the errors refer to.

python -m service.openapi            write openapi/openapi.json
python -m service.openapi --check    fail if it is not what is committed
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from pydantic.json_schema import models_json_schema

from meshdeform.config import JobRequest
from service.schemas import Problem

__all__ = ["describe", "main", "text"]

_REFERENCE = "#/components/schemas/{model}"
_TAGS = [
    {"name": "jobs", "description": "One request to deform one asset: post it, look at it, cancel it, delete it."},
    {"name": "artifacts", "description": "The results of a job."},
    {"name": "health", "description": "For whoever runs the service."},
]


def describe(app: FastAPI) -> None:
    """Let `app.openapi()` give the whole document."""
    found = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = found()
            _, more = models_json_schema([(JobRequest, "validation"), (Problem, "validation")], ref_template=_REFERENCE)
            schemas = document.setdefault("components", {}).setdefault("schemas", {})
            # FastAPI adds its own error schemas wherever there is a parameter; no answer of ours has them.
            for name in ("HTTPValidationError", "ValidationError"):
                schemas.pop(name, None)
            schemas.update(more["$defs"])
            document["components"]["schemas"] = dict(sorted(schemas.items()))
            document["tags"] = _TAGS
            document["info"]["license"] = {"name": "Apache-2.0", "identifier": "Apache-2.0"}
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def text() -> str:
    """Return the document as it is committed."""
    from service.app import create_app

    return json.dumps(create_app().openapi(), indent=2, ensure_ascii=False) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Write or compare `openapi/openapi.json`."""
    parser = argparse.ArgumentParser(prog="python -m service.openapi", description=main.__doc__)
    parser.add_argument("--check", action="store_true", help="compare and do not write")
    parser.add_argument("--path", type=Path, default=Path(__file__).parent.parent / "openapi" / "openapi.json")
    options = parser.parse_args(arguments)
    document = text()
    if not options.check:
        options.path.parent.mkdir(exist_ok=True)
        options.path.write_text(document, encoding="utf-8")
        return 0
    if options.path.is_file() and options.path.read_text(encoding="utf-8") == document:
        return 0
    print(f"{options.path} is not what the routes say. Run: python -m service.openapi", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
