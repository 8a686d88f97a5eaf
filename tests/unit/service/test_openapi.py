"""The OpenAPI document: what is committed is what the routes say, and it says all that a caller needs."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest

from meshdeform import errors
from meshdeform.errors import MeshdeformError
from meshdeform.requests.document import PARAMS_OF_KIND
from service import openapi
from tests.cases import each_case


@pytest.fixture(scope="module")
def document(repository: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((repository / "openapi" / "openapi.json").read_text())
    return found


def operations(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield f"{method} {path}", operation


def test_what_is_committed_is_what_the_routes_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(openapi, "text", functools.cache(openapi.text))  # it makes the whole application
    assert openapi.main(["--check"]) == 0
    other = tmp_path / "openapi.json"
    assert openapi.main(["--check", "--path", str(other)]) == 1
    assert "python -m service.openapi" in capsys.readouterr().err
    assert openapi.main(["--path", str(other)]) == 0
    assert openapi.main(["--check", "--path", str(other)]) == 0


def test_every_parameter_has_a_description_bounds_and_an_example(document: dict[str, Any]) -> None:
    for name, operation in operations(document):
        for parameter in operation.get("parameters", []):
            where = (name, parameter["name"])
            schemas = [parameter["schema"], *parameter["schema"].get("anyOf", [])]
            assert parameter["description"], where
            assert "example" in parameter or any(schema.get("examples") for schema in schemas), where
            assert (
                parameter["required"] or any("default" in s for s in schemas) or "Default:" in parameter["description"]
            )
            bounds = {"minimum", "maximum", "maxLength", "maxProperties", "pattern", "enum", "$ref"}
            assert any(bounds & set(schema) or schema.get("type") == "boolean" for schema in schemas), where
    # `{1,128}` behind all letters of Unicode is 12 MB in each process: the length is a bound of its own.
    for pattern in re.findall(r'"pattern": "((?:[^"\\]|\\.)*)"', json.dumps(document)):
        assert not re.search(r"\\[wWdDsSpP]\S*\{\d*,?\d{2,}\}", json.loads(f'"{pattern}"')), pattern


@each_case(
    "schema",
    [
        "JobDocument",
        "BranchDocument",
        "DeformParams",
        "PromptGuidanceParams",
        "TargetGuidanceParams",
        "ControlParams",
        "OutputParams",
    ],
)
def test_every_member_of_a_request_has_a_description_a_default_and_an_example(
    schema: str, document: dict[str, Any]
) -> None:
    for name, member in document["components"]["schemas"][schema]["properties"].items():
        assert member["description"], name
        assert member.get("examples") or "$ref" in member, name
        for choice in member.get("anyOf", [member]):
            if choice.get("type") in ("number", "integer"):
                assert {"minimum", "exclusiveMinimum"} & set(choice), name
                assert {"maximum", "exclusiveMaximum"} & set(choice), name
        said = "default" in member or "Default:" in member["description"]
        assert said or name in {"params", "output", "metadata", "guidance", "control", "input", "kind"}, name


def test_a_request_of_any_kind_of_job_fits_the_document(document: dict[str, Any]) -> None:
    schema = {"$ref": "#/components/schemas/JobDocument", "components": document["components"]}
    fits = jsonschema_rs.validator_for(schema).is_valid
    for kind, model in PARAMS_OF_KIND.items():
        params = model().model_dump(mode="json")
        assert fits({"kind": kind, "params": params}), kind
        assert not fits({"kind": kind, "params": {**params, "none_has_this": 1}}), kind


def test_every_error_of_every_route_is_a_problem_with_a_known_code(document: dict[str, Any]) -> None:
    kinds = [value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, MeshdeformError)]
    known = {kind.code: kind.status for kind in kinds}
    problem = {"$ref": "#/components/schemas/Problem", "components": document["components"]}
    for name, operation in operations(document):
        assert "default" in operation["responses"], name
        for status, response in operation["responses"].items():
            assert response["description"], (name, status)
            if status.startswith(("4", "5")) and name != "get /readyz":
                assert set(response["content"]) == {"application/problem+json"}, (name, status)
                for code, example in response["content"]["application/problem+json"]["examples"].items():
                    assert known[code] == int(status) == example["value"]["status"]
                    jsonschema_rs.validate(problem, example["value"])


def test_every_reference_leads_somewhere_and_nothing_is_left_over(document: dict[str, Any]) -> None:
    text = json.dumps(document)
    referred = set(re.findall(r'"#/components/schemas/(\w+)"', text))
    assert referred == set(document["components"]["schemas"])
    names = [operation["operationId"] for _, operation in operations(document)]
    assert len(names) == len(set(names))


def test_examples_are_valid(document: dict[str, Any]) -> None:
    for schema in document["components"]["schemas"].values():
        for found in schema.get("properties", {}).values():
            for example in found.get("examples", []):
                jsonschema_rs.validate({**found, "components": document["components"]}, example)
