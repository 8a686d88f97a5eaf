"""The front of an asset before the job starts: what the job would report, or why there is nothing to find."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from meshdeform.assets import build_glb
from meshdeform.assets.isolation import ChildOutcome
from meshdeform.assets.limits import Limits
from meshdeform.client import Client
from meshdeform.errors import DependencyError, ParameterError, VocabularyError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.requests.document import JobRequest, resolve
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


def test_an_unknown_word_in_any_prompt_is_found_before_the_job(api: Api) -> None:
    prompts = [{"prompt": "a vase"}, {"prompt": "a zebr", "regions": [{"node": "Head"}]}]
    with Client(api.url) as client:
        with pytest.raises(VocabularyError) as caught:
            client.validate(BALL, "a giraffe", params={"guidance": {"prompts": prompts}}, filename="a.glb")
        assert caught.value.extra["errors"][0]["loc"] == ["params", "guidance", "prompts", 1, "prompt"]
        prompts[1]["prompt"] = "a bell"
        with pytest.raises(ParameterError, match="no node named 'Head'") as refused:
            client.validate(BALL, "a giraffe", params={"guidance": {"prompts": prompts}}, filename="a.glb")
        assert refused.value.extra["errors"][0]["loc"] == ["params", "guidance", "prompts", 1, "regions", 0, "node"]


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
    assert "auto" in problem["advice"]


def test_a_broken_asset_is_refused_before_the_search(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "run_child", lambda *_a, **_k: pytest.fail("searched"))
    answer = orient(api, b"no asset")
    assert answer.status_code in (415, 422)
    assert answer.json()["code"].startswith("asset_")


def test_a_server_without_torch_says_so(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    verdict = {
        "ok": False,
        "error": {"code": DependencyError.code, "detail": "torch is not installed.", "advice": "", "extra": {}},
    }
    monkeypatch.setattr(questions, "run_child", lambda *_a, **_k: ChildOutcome(1, verdict))
    problem = check_problem(orient(api), 501, DependencyError.code)
    assert "torch is not installed" in problem["detail"]
    assert "meshdeform inspect" in problem["advice"]


def test_a_search_that_takes_too_long_is_given_up(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(*_arguments: Any, **_more: Any) -> ChildOutcome:
        raise TimeoutError

    monkeypatch.setattr(questions, "run_child", slow)
    assert "longer than" in check_problem(orient(api), 503, "unavailable")["detail"]


def test_the_task_lies_beside_the_received_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def look(_module: str, arguments: list[str], **more: Any) -> ChildOutcome:
        task = json.loads(Path(arguments[0]).read_text())
        assert Path(arguments[0]).parent == tmp_path == more["temporary"]
        assert (task["suffix"], task["request"]["output"]) == (".obj", {"subdivide": True})
        return ChildOutcome(0, {"ok": True, "found": {"turn_deg": 90.0}})

    monkeypatch.setattr(questions, "run_child", look)
    request = JobRequest.model_validate({"prompt": "a cow", "params": {"preset": "preview"}})
    params = resolve(request.params, default_model="builtin")
    given = {"subdivide": True, "limits": Limits(), "timeout_s": 1.0}
    found = orientation_process.orientation_of(tmp_path / "file", "cow.obj", "a cow", params, **given)
    assert found == {"turn_deg": 90.0}
