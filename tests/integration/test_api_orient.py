"""The front of an asset before the job starts: what the job would report, or why there is nothing to find."""

from __future__ import annotations

import json
from typing import Any

import pytest

from meshdeform.assets import build_glb
from meshdeform.assets.limits import ChildOutcome
from meshdeform.client import Client
from meshdeform.errors import ParameterError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import orientation_process, questions, text_deform
from meshdeform.runs.base import job_input
from tests.cases import each_case
from tests.integration.conftest import Api
from tests.integration.http_calls import check_document, check_problem

BALL = build_glb(icosphere(1).verts.numpy() * [1, 1, 2], icosphere(1).faces.numpy())


def orient(api: Api, asset: bytes = BALL, **params: Any) -> Any:
    request = json.dumps({"prompt": "a giraffe", "params": grouped({"preset": "preview", **params})})
    return api.http.post("/v1/jobs:orient", files={"asset": ("a.glb", asset), "request": (None, request)})


def test_the_answer_is_what_the_report_would_say(
    api: Api, openapi: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # The child's work, in this process, which has loaded everything.
    def run_here(_module: str, arguments: list[str], **_more: Any) -> ChildOutcome:
        assert orientation_process.main(arguments) == 0
        return ChildOutcome(0, json.loads(capsys.readouterr().out.splitlines()[-1]))

    monkeypatch.setattr(questions, "run_child", run_here)
    monkeypatch.setattr(questions, "bound_memory", lambda _bytes: None)
    unknown = orient(api).json()
    check_document(unknown, "FoundOrientation", openapi)
    assert (unknown["source"], unknown["turn_deg"]) == ("unrecognised", 0.0)
    found = orient(api, source_noun="pear")
    assert found.status_code == 200, found.text
    check_document(found.json(), "FoundOrientation", openapi)
    params = {"preset": "preview", "guidance": {"source_noun": "pear"}}
    request = JobRequest.model_validate({"prompt": "a giraffe", "params": grouped(params)})
    run = text_deform.start(
        job_input(asset=BALL, filename="a.glb", request=request, prior=load_prior("builtin", device="cpu"))
    )
    assert found.json() == run.orientation.to_dict()
    assert len(found.json()["grades"]) == 12
    # Both clients drive the same generators.
    with Client(api.url) as client:
        orientation = client.orient(BALL, "a giraffe", params=params, filename="a.glb")
        assert orientation.model_dump() == found.json()
        with pytest.raises(ParameterError, match="would not search its front"):
            client.orient(BALL, "a giraffe", params={"guidance": {"orientation": "keep"}}, filename="a.glb")


@each_case(
    ("params", "member"),
    [
        ({"orientation": "keep"}, "orientation"),
        ({"orientation": 90}, "orientation"),
        ({"preset": "paper"}, "orientation"),
    ],
)
def test_a_job_that_searches_no_front_is_told_so(api: Api, params: dict[str, Any], member: str) -> None:
    problem = check_problem(orient(api, **params), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["params", "guidance", member]
