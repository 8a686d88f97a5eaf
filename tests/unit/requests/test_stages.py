"""Stages in a request: what is refused, and what follows from them."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from meshdeform.errors import ParameterError, PromptError, VocabularyError
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.document import DeformParams, JobRequest, resolve
from meshdeform.requests.stages import (
    StageProgress,
    named_targets,
    needs_prior,
    stage_at,
    stage_titles,
)
from meshdeform.runs.text_deform_checks import check
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from tests.cases import each_case

PEAR, FILE = {"prompt": "a pear"}, {"target": "target_2", "name": "a vase"}


def of(*stages: dict[str, Any], **params: Any) -> JobRequest:
    return JobRequest.model_validate({"params": {"stages": stages, **params}})


def refused(request: JobRequest, targets: list[str]) -> str:
    with pytest.raises((ParameterError, PromptError)) as caught:
        check(request, default_model="builtin", targets=targets)
    return caught.value.detail


def test_a_stage_has_one_goal() -> None:
    for stage in ({}, {"prompt": " "}, {**PEAR, "target": "target"}, {"target": "asset"}, {"target": "target_9"}):
        with pytest.raises(ValidationError):
            of(stage)
    with pytest.raises(ValidationError):
        of(*[PEAR] * 9)


def test_the_first_stage_decides_the_preset() -> None:
    assert resolve(of(PEAR, FILE).params).guidance is GuidanceKind.SDS
    params = resolve(of(FILE, PEAR).params)
    assert params.guidance is GuidanceKind.TARGET
    assert params.steps == resolve(DeformParams(guidance=GuidanceKind.TARGET)).steps
    assert needs_prior(params)
    assert not needs_prior(resolve(of(FILE).params))


def test_a_request_needs_the_files_that_its_stages_name() -> None:
    request = of(FILE, PEAR, FILE)
    assert named_targets(request.params) == ("target_2",)
    assert TEXT_DEFORM.inherits(request) == {"asset", "target_2"}
    assert refused(request, []) == "A stage needs `target_2`."
    assert refused(of(FILE, PEAR), ["target", "target_2"]) == "`target` was sent, but no stage uses it."
    check(of(FILE, PEAR), default_model="builtin", targets=["target_2"])


@each_case(
    "request_, detail",
    [
        (
            JobRequest.model_validate({"prompt": "a vase", "params": {"stages": [PEAR]}}),
            "There are a prompt and stages.",
        ),
        (
            of(PEAR, landmarks=[{"source": 0, "target": 0}]),
            "`landmarks` belongs to a single goal, and there are stages.",
        ),
        (of(PEAR, guidance="target"), "guidance is `target`, and `stages` needs `sds`."),
    ],
    ids=["with a prompt", "with landmarks", "with other guidance"],
)
def test_contradictions_are_refused(request_: JobRequest, detail: str) -> None:
    assert refused(request_, []) == detail


def test_every_prompt_is_checked() -> None:
    with pytest.raises(VocabularyError, match="xylophone"):
        check(of(PEAR, {"prompt": "a xylophone"}), default_model="builtin")


def test_steps_progress_and_names_count_all_stages() -> None:
    request = of(PEAR, FILE, PEAR, steps=10)
    assert TEXT_DEFORM.steps(request, "builtin", None) == 30
    assert TEXT_DEFORM.goal(request, {"asset": "a.glb", "target_2": "b.glb"}) == "a pear, then a vase, then a pear"
    stages = stage_titles(request.model_dump(mode="json", exclude_unset=True))
    assert stages == [stage.title for stage in request.params.stages] == ["a pear", "a vase", "a pear"]
    assert stage_at(stages, 0, 0) == StageProgress(number=1, count=3, name="a pear")
    assert [stage_at(stages, step, 30).number for step in (9, 10, 29, 30)] == [1, 2, 3, 3]  # type: ignore[union-attr]
    assert stage_at((), 5, 10) is None
