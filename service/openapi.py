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

from service.documentation.links import add_links
from service.jobs.documents import BranchDocument, JobDocument, UploadCompletion, UploadDocument
from service.schemas import Problem

__all__ = ["describe", "main", "text"]

# What no route's signature names: bodies that are read as they come, and problems.
_MODELS = (JobDocument, BranchDocument, UploadDocument, UploadCompletion, Problem)
_REFERENCE = "#/components/schemas/{model}"
_DESCRIPTION = (
    "Post an asset and a prompt as a job, follow it, and fetch its results. What is wrong is told as a problem "
    "document (RFC 9457) with a code, and with advice. In words: docs/http.md."
)
_TAGS = [
    {"name": "jobs", "description": "One request to deform one asset: post it, look at it, cancel it, delete it."},
    {"name": "uploads", "description": "Files that are sent by themselves, in pieces if need be, and named by jobs."},
    {"name": "events", "description": "What happens to a job, as it happens: docs/http.md#events."},
    {"name": "checkpoints", "description": "Where a job can go on from, and its shape there."},
    {"name": "artifacts", "description": "The results of a job."},
    {"name": "webhooks", "description": "Be told of events by signed messages: docs/webhooks.md."},
    {"name": "models", "description": "What jobs may name as `params.model`."},
    {"name": "limits", "description": "What this server allows."},
    {"name": "health", "description": "For whoever runs the service."},
]


def describe(app: FastAPI) -> None:
    """Let `app.openapi()` give the whole document."""
    found = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = found()
            _, more = models_json_schema([(model, "validation") for model in _MODELS], ref_template=_REFERENCE)
            schemas = document.setdefault("components", {}).setdefault("schemas", {})
            # FastAPI adds its own error schemas wherever there is a parameter; no answer of ours has them.
            for name in ("HTTPValidationError", "ValidationError"):
                schemas.pop(name, None)
            schemas.update(more["$defs"])
            document["components"]["schemas"] = dict(sorted(schemas.items()))
            document["tags"] = _TAGS
            add_links(document)
            _say_what_can_be_sent(document)
            document["info"]["description"] = _DESCRIPTION
            document["info"]["license"] = {"name": "Apache-2.0", "identifier": "Apache-2.0"}
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _say_what_can_be_sent(document: dict[str, Any]) -> None:
    """Take `null` out of the parameters' schemas: it is how Python says that one is left out, and cannot be sent."""
    for methods in document["paths"].values():
        for operation in methods.values():
            for parameter in operation.get("parameters", []):
                schema = parameter["schema"]
                kinds = [kind for kind in schema.get("anyOf", []) if kind != {"type": "null"}]
                if len(kinds) == 1 and "$ref" not in kinds[0]:
                    parameter["schema"] = {**{k: v for k, v in schema.items() if k != "anyOf"}, **kinds[0]}
                elif kinds:
                    # What stands beside a reference is not seen by every reader.
                    schema["anyOf"] = kinds


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
