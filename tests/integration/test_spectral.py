"""Spectral finds neither an error nor a warning in the OpenAPI document, by its own rules and by ours."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.cases import each_case

Findings = dict[str, list[tuple[str, str]]]
SPOILT = (
    "operation-operationId",
    "operation-description",
    "operation-summary",
    "operation-names-a-client-error",
    "errors-are-problem-documents",
    "oas3-parameter-description",
    "parameter-shows-a-value",
)
"""Rules that the document of `spoilt` breaks."""


def spoilt(document: dict[str, Any]) -> dict[str, Any]:
    """Return two paths of the document, with a mistake for each of the rules."""
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
    return {**document, "paths": {path: item, "/v1/jobs": document["paths"]["/v1/jobs"]}}  # the others only take time


@pytest.fixture(scope="module")
def findings(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Findings:
    """The (rule, place) of each finding, in the document as it is and in a spoilt one: one run, as it starts slowly."""
    program = repository / "tests/node/node_modules/.bin/spectral"
    if not program.exists():
        pytest.skip("Spectral is not installed (npm install --prefix tests/node)")
    folder = tmp_path_factory.mktemp("spectral")
    text = (repository / "openapi/openapi.json").read_text()
    (folder / "committed.json").write_text(text)
    (folder / "spoilt.json").write_text(json.dumps(spoilt(json.loads(text))))
    report = folder / "report"
    command = [str(program), "lint", "--ruleset", str(repository / ".spectral.yaml"), "--quiet"]
    command += ["--format", "json", "--output", str(report), *map(str, sorted(folder.glob("*.json")))]
    done = subprocess.run(
        command, env={**os.environ, "NO_COLOR": "1"}, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode in (0, 1), done.stderr
    found: Findings = {"committed": [], "spoilt": []}
    for each in json.loads(report.read_text()):
        found[Path(each["source"]).stem].append((each["code"], "/".join(map(str, each["path"]))))
    return found


def test_nothing_is_found(findings: Findings) -> None:
    assert findings["committed"] == []


def test_our_rules_find_what_they_are_for(findings: Findings) -> None:
    assert set(SPOILT) <= {rule for rule, _ in findings["spoilt"]}


# hadolint finds nothing in the Dockerfiles, not even a remark.


@pytest.fixture(scope="module")
def hadolint(repository: Path) -> str:
    found = sorted((repository / "tests/.hadolint").glob("*/bin/hadolint"))
    program = str(found[-1]) if found else shutil.which("hadolint")
    if program is None:
        pytest.skip("hadolint is not installed (scripts/test installs it)")
    return program


@each_case("name", ["service", "worker"])
def test_images_are_built_as_hadolint_says(hadolint: str, repository: Path, name: str) -> None:
    path = repository / f"docker/{name}.Dockerfile"
    done = subprocess.run([hadolint, "--no-color", str(path)], capture_output=True, text=True, check=False, timeout=60)
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 0)
