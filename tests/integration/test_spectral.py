"""Spectral finds neither an error nor a warning in the OpenAPI document, by its own rules and by ours."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Lint = Callable[[dict[str, Any]], list[tuple[str, str]]]


@pytest.fixture
def document(repository: Path) -> dict[str, Any]:
    return dict(json.loads((repository / "openapi/openapi.json").read_text()))


@pytest.fixture
def lint(repository: Path, tmp_path: Path) -> Lint:
    """Lint a document; returns (rule, place) of each finding."""
    program = repository / "tests/node/node_modules/.bin/spectral"
    if not program.exists():
        pytest.skip("Spectral is not installed (npm install --prefix tests/node)")

    def run(document: dict[str, Any]) -> list[tuple[str, str]]:
        source, report = tmp_path / "openapi.json", tmp_path / "report.json"
        source.write_text(json.dumps(document))
        command = [str(program), "lint", "--ruleset", str(repository / ".spectral.yaml"), "--quiet"]
        command += ["--format", "json", "--output", str(report), str(source)]
        done = subprocess.run(
            command, env={**os.environ, "NO_COLOR": "1"}, capture_output=True, text=True, check=False, timeout=120
        )
        assert done.returncode in (0, 1), done.stderr
        return [(found["code"], "/".join(map(str, found["path"]))) for found in json.loads(report.read_text())]

    return run


def test_nothing_is_found(lint: Lint, document: dict[str, Any]) -> None:
    assert lint(document) == []


def test_our_rules_find_what_they_are_for(lint: Lint, document: dict[str, Any]) -> None:
    path, item = next((path, item) for path, item in document["paths"].items() if path.startswith("/v1/jobs/{"))
    method = next(method for method in ("get", "post", "put") if method in item)
    operation = item[method]
    for key in ("operationId", "description", "summary"):
        del operation[key]
    operation["parameters"] = [{"name": "job_id", "in": "path", "required": True, "schema": {"type": "string"}}]
    operation["responses"] = {"200": {"description": "Good."}}
    other = document["paths"]["/v1/jobs"]["post"]["responses"]
    code = next(code for code in other if code.startswith("4"))
    other[code]["content"] = {"text/html": {"schema": {"type": "string"}}}
    document["paths"] = {path: item, "/v1/jobs": document["paths"]["/v1/jobs"]}  # the others only take time
    found = {rule for rule, _ in lint(document)}
    assert {
        "operation-operationId",
        "operation-description",
        "operation-summary",
        "operation-names-a-client-error",
        "errors-are-problem-documents",
        "oas3-parameter-description",
        "parameter-shows-a-value",
    } <= found, path
