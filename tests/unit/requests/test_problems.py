"""What every validator refuses is said in plain words, by the command line, by the API and to agents alike."""

from __future__ import annotations

import ast
import asyncio
import inspect
import json
from collections.abc import Callable
from types import ModuleType
from typing import Annotated, Any

import pytest
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import AwareDatetime, BaseModel, BeforeValidator, TypeAdapter, ValidationError

from meshdeform import settings
from meshdeform.cli.environment import load_settings
from meshdeform.cli.request import make_request
from meshdeform.errors import MeshdeformError, ParameterError
from meshdeform.mcp.tools import explained
from meshdeform.requests import parameters, selection
from meshdeform.requests.document import JobRequest, first_problem
from meshdeform.requests.problems import reason
from meshdeform.settings import Settings
from service.http.bodies import parse_document
from service.http.errors import parameter_error
from service.jobs import documents, routes
from tests.cases import each_case

WITH_VALIDATORS: tuple[ModuleType, ...] = (settings, parameters, selection, documents, routes)
BOX = {"min": [1, 0, 0], "max": [0, 0, 0]}
WORDS = ("Value error", "Assertion failed", "Extra inputs")


def control(name: str, *members: dict[str, Any]) -> dict[str, Any]:
    return {"params": {"control": {name: list(members)}}}


REQUESTS: list[dict[str, Any]] = [
    {"params": {"guidance": {"kind": "sds", "prompts": [{"prompt": "a vase", "outside": True}]}}},
    control("parts", *({"name": name, "parts": ["horns"]} for name in ("ears", "tail"))),
    {"params": {"guidance": "sds"}},
    {"params": {"guidance": {"kind": "exmplar"}}},
    control("regions", {"box": BOX}),
    control("regions", {}),
    control("parts", {"name": "!", "parts": ["horns"]}),
    control("parts", {"name": "ears"}),
    control("handles", {"to": [0, 0, 0]}),
]
OTHERS: list[tuple[type[BaseModel], dict[str, Any]]] = [
    (documents.JobDocument, {"asset": {"upload_id": "upl_" + "0" * 26, "artifact": "a.glb"}}),
    (documents.JobDocument, {"asset": {}}),
    (documents.JobDocument, {"asset": {"url": "https://a"}, "files": {"asset": {"url": "https://b"}}}),
    (documents.JobDocument, {"nothing": 1}),
    (Settings, {"cors_origins": "nonsense"}),
    (Settings, {"webhook_networks": "nonsense"}),
    (Settings, {"allowed_hosts": "[nonsense"}),
]
FILES: list[Any] = [*((JobRequest, document) for document in REQUESTS), *OTHERS]


def refused(work: Callable[[], object]) -> ValidationError:
    with pytest.raises(ValidationError) as error:
        work()
    return error.value


def when() -> object:
    return TypeAdapter(Annotated[AwareDatetime, BeforeValidator(routes._written_time)]).validate_python("17")


def raised_at(error: ValidationError) -> set[tuple[str, int]]:
    """The places in our own code where a validator refused."""
    found = set()
    for finding in error.errors():
        cause = finding.get("ctx", {}).get("error")
        trace = cause.__traceback__ if isinstance(cause, BaseException) else None
        while trace is not None:
            found.add((trace.tb_frame.f_code.co_filename, trace.tb_lineno))
            trace = trace.tb_next
    return found


def test_every_refusal_of_a_validator_is_among_these_cases() -> None:
    errors = [refused(lambda model=model, document=document: model(**document)) for model, document in FILES]
    reached = set().union(*(raised_at(error) for error in [*errors, refused(when)]))
    for module in WITH_VALIDATORS:
        path = inspect.getsourcefile(module)
        assert path is not None
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            if isinstance(node, ast.Raise) and "ValueError(" in ast.unparse(node):
                lines = range(node.lineno, (node.end_lineno or node.lineno) + 1)
                assert any((path, line) in reached for line in lines), f"{path}:{node.lineno} is in no case"


@each_case(("model", "document"), FILES)
def test_no_word_of_the_library_is_in_what_is_said(model: type[BaseModel], document: dict[str, Any]) -> None:
    error = refused(lambda: model(**document))

    async def tool() -> None:
        raise error

    said = [first_problem(error), parameter_error(error.errors()).detail]
    with pytest.raises(ToolError) as told:
        asyncio.run(explained(tool)())
    said.append(str(told.value))
    with pytest.raises(MeshdeformError) as answered:
        load_settings(**document) if model is Settings else parse_document(model, json.dumps(document).encode())
    said += [answered.value.detail, json.dumps(answered.value.extra)]
    if model is JobRequest:
        with pytest.raises(ParameterError) as printed:
            make_request("a vase", document["params"])
        said += [printed.value.detail, json.dumps(printed.value.extra)]
    for text in said:
        assert not any(word in text for word in WORDS), text
        assert "validation error" not in text
        assert ".." not in text


@each_case(
    ("document", "said"),
    [
        ({"preset": "prevew"}, "Input should be 'preview', 'balanced' or 'paper'. Did you mean 'preview'?"),
        ({"preset": "x" * 99}, "Input should be 'preview', 'balanced' or 'paper'"),
        ({"preset": 3}, "Input should be 'preview', 'balanced' or 'paper'"),
        ({"guidance": {"kind": "silhouete"}}, "there is no such kind of guidance. Did you mean 'silhouettes'?"),
        ({"guidance": {"kind": 3}}, "kind is sds, target, silhouettes or exemplar"),
    ],
)
def test_of_choices_the_one_that_was_probably_meant_is_named(document: dict[str, Any], said: str) -> None:
    [finding] = refused(lambda: JobRequest(prompt="a vase", params=document)).errors()
    assert reason(finding) == said
