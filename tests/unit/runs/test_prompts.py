"""Several prompts at once: what each reaches, how they add up, and what a request cannot ask for."""

from __future__ import annotations

import functools
import json
from typing import Any

import numpy as np
import pytest
import safetensors.torch
import torch
from pydantic import ValidationError

from meshdeform.assets import build_glb
from meshdeform.errors import ParameterError, VocabularyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.record.models import NewJob
from meshdeform.record.rows import searched_text
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import check_request
from meshdeform.runs.likeness import prompt_reports
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.unit.guidance.pictures import PicturesPrior
from tests.unit.runs.jobs import started

BALL = icosphere(2)
MIDDLES = BALL.verts[BALL.faces].mean(1)
ABOVE = {"box": {"min": [-2, 0, -2], "max": [2, 2, 2]}}
ALL = {"box": {"min": [-2, -2, -2], "max": [2, 2, 2]}}
IN_BOX = (BALL.verts[BALL.faces][:, :, 1] >= 0).all(1)
PEAR, VASE = {"prompt": "a pear"}, {"prompt": "a vase"}
BARE = dict.fromkeys(("jacobian_reg_weight", "laplacian_weight", "normal_weight", "dirichlet_weight"), 0.0)


def prior() -> PicturesPrior:
    drawn = torch.rand(3, 1, 3, 48, 48, generator=torch.Generator().manual_seed(0))
    return PicturesPrior(dict(zip(("", "a pear", "a vase"), drawn, strict=True)))


QUICK = {"preset": "preview", "steps": 3, "orientation": "keep", "safeguard": "none"}


def request_of(prompt: str, *prompts: dict[str, Any], **params: Any) -> JobRequest:
    return JobRequest.model_validate({"prompt": prompt, "params": grouped({**QUICK, **params, "prompts": prompts})})


def start(prompt: str, *prompts: dict[str, Any], **params: Any) -> Any:
    asset = build_glb(BALL.verts, BALL.faces)
    return started(asset, prompt, prior=prior(), prompts=prompts, **{**QUICK, **params})


def moved(prompt: str, *prompts: dict[str, Any], **params: Any) -> np.ndarray:
    run = start(prompt, *prompts, **params)
    assert len(list(run)) == run.total_steps
    return run.positions()


def first_gradient(prompt: str, *prompts: dict[str, Any], **params: Any) -> torch.Tensor:
    """The gradient on the Jacobians at the first step, without regularisers: ten times Adam's first moment."""
    # A region needs no asking: few controls would carry its gradient everywhere.
    carrier = "auto" if any("regions" in each for each in prompts) else "surface"
    run = start(prompt, *prompts, **BARE, falloff=0.0, carrier=carrier, **params)
    next(iter(run))
    return 10 * safetensors.torch.load(run.checkpoint())["jacobians.exp_avg"]


def close(found: torch.Tensor, expected: torch.Tensor) -> bool:
    """Whether gradients are the same but for the rounding of float32 pictures."""
    return bool((found - expected).abs().max() <= 1e-4 * expected.abs().max())


@functools.cache
def alone(prompt: str) -> torch.Tensor:
    return first_gradient(prompt)


def test_a_prompt_without_weight_and_a_region_of_everything_change_nothing() -> None:
    single = moved("a pear")
    assert np.array_equal(moved("a pear", {**VASE, "weight": 0}), single)
    assert np.array_equal(moved("", {**PEAR, "regions": [ALL]}), single)
    assert np.array_equal(moved("", {**VASE, "weight": 0, "regions": [ABOVE]}, PEAR), single)
    assert not np.allclose(moved("a pear", {**VASE, "weight": 0.5}), single, atol=1e-4)


def test_prompts_without_regions_add_up_with_their_weights() -> None:
    """Liu et al. 2022: with weights that add up to 1, the gradients are averaged; more is divided by the sum."""
    pear, vase = alone("a pear"), alone("a vase")
    for first, second in ((0.25, 0.75), (1.0, 3.0)):
        both = first_gradient("", {**PEAR, "weight": first}, {**VASE, "weight": second})
        assert close(both, 0.25 * pear + 0.75 * vase)
    assert close(first_gradient("", {**PEAR, "weight": 0.5}), 0.5 * pear)


def test_a_prompt_with_a_region_reaches_its_faces_and_no_others() -> None:
    pear, vase = alone("a pear"), alone("a vase")
    local = first_gradient("", {**VASE, "regions": [ABOVE]})
    assert not local[~IN_BOX].any()
    assert close(local[IN_BOX], vase[IN_BOX])
    above, below = {**VASE, "regions": [ABOVE]}, {**PEAR, "regions": [ABOVE], "outside": True}
    both = first_gradient("", above, below)
    assert close(both, torch.where(torch.from_numpy(IN_BOX)[:, None, None], vase, pear))
    over = first_gradient("a pear", {**above, "weight": 3})
    assert close(over[~IN_BOX], pear[~IN_BOX])
    assert close(over[IN_BOX], (0.25 * pear + 0.75 * vase)[IN_BOX])


def test_a_symmetry_mirrors_the_regions() -> None:
    left = {**VASE, "regions": [{"box": {"min": [0, -2, -2], "max": [2, 2, 2]}}]}
    (share,) = start("", left, falloff=0.0)._facts.goal.shares
    (mirrored,) = start("", left, falloff=0.0, symmetry="x")._facts.goal.shares
    inside = MIDDLES[:, 0] > 0.2
    assert share[inside].all()
    assert not share[MIDDLES[:, 0] < 0].any()
    assert mirrored[np.abs(MIDDLES[:, 0]) > 0.2].all()
    assert not mirrored.all()


def test_a_resumed_run_equals_an_uninterrupted_one_and_the_report_names_each_prompt() -> None:
    given = [{**VASE, "weight": 0.5, "regions": [ABOVE]}, {**PEAR, "weight": 0.25}]
    run = start("a pear", *given)
    next(iter(run))
    state = run.checkpoint()
    assert len(list(run)) == 2
    again = start("a pear", *given, checkpoint=state)
    assert [each.step for each in again] == [2, 3]
    results, others = run.finish(), again.finish()
    assert results["result.glb"].data == others["result.glb"].data
    found = json.loads(results["report.json"].data)["prompts"]
    assert [(each["prompt"], each["weight"], each["faces"]) for each in found] == [
        ("a pear", 1.0, len(BALL.faces)),
        ("a vase", 0.5, int(IN_BOX.sum())),
        ("a pear", 0.25, len(BALL.faces)),
    ]
    assert found[1]["regions"] == [ABOVE]
    assert found[1]["moved"].keys() == {"inside", "outside"}
    assert found[1]["moved"]["inside"] > 0 < found[1]["moved"]["outside"]
    assert "moved" not in found[0]


def test_the_likeness_of_a_region_is_that_of_the_region_alone_now_and_before() -> None:
    run = start("a pear", {**VASE, "regions": [ABOVE]})
    high = TriangleMesh(BALL.verts + np.array([0.0, 5.0, 0.0]), BALL.faces)

    def lowest(mesh: TriangleMesh, prompt: str) -> dict[str, Any]:
        return {"noun": prompt, "probability": float(mesh.verts[:, 1].min()), "rank": len(mesh.faces)}

    whole, part = prompt_reports(run._facts.prompts, BALL, high, lowest)
    assert whole["likeness"] == {"noun": "a pear", "probability": pytest.approx(4), "rank": len(BALL.faces)}
    faces = int(IN_BOX.sum())
    assert part["likeness"]["probability"] == pytest.approx(5, abs=1e-6)
    assert part["likeness"]["rank"] == faces
    assert part["likeness"]["before"] == {"probability": pytest.approx(0, abs=1e-6), "rank": faces}
    assert prompt_reports(run._facts.prompts, BALL, high, lambda *_: None)[1]["likeness"] is None


@each_case(
    "prompts, params, member, words",
    [
        ([{**VASE, "regions": [{"box": {"min": [5, 5, 5], "max": [6, 6, 6]}}]}], {}, "regions", "has all its corners"),
        ([{**VASE, "regions": [ALL], "outside": True}], {}, "regions", "nothing is outside"),
        ([{**VASE, "regions": [ABOVE]}], {"regions": [ABOVE]}, "regions", "is kept"),
    ],
)
def test_a_region_that_reaches_nothing_is_refused(
    prompts: list[dict[str, Any]], params: dict[str, Any], member: str, words: str
) -> None:
    with pytest.raises(ParameterError, match=words) as caught:
        start("a pear", *prompts, **params)
    assert caught.value.extra["errors"][0]["loc"][:5] == ["params", "guidance", "prompts", 0, member]


def test_what_prompts_cannot_be_combined_with_is_refused() -> None:
    def refused(request: JobRequest) -> str:
        with pytest.raises(ParameterError) as caught:
            check_request(request, Settings(), files=["asset"])
        assert caught.value.extra["errors"][0]["loc"] == ["params", "guidance", "prompts"]
        return caught.value.detail

    with pytest.raises(ValidationError, match=r"guidance\.target\.prompts"):
        request_of("", VASE, guidance="target")
    assert refused(request_of("", {**VASE, "weight": 0})) == "All prompts have the weight 0."
    for wrong in ({**VASE, "outside": True}, {"prompt": " "}, {**VASE, "weight": -1}, {**VASE, "action": "keep"}):
        with pytest.raises(ValidationError):
            request_of("", wrong)
    with pytest.raises(ValidationError):
        request_of("", *[VASE] * 9)


def test_an_unknown_word_names_its_prompt() -> None:
    check_request(request_of("", VASE, PEAR), Settings(), files=["asset"])
    with pytest.raises(VocabularyError) as caught:
        check_request(request_of("a pear", VASE, {"prompt": "a zebr", "weight": 0}), Settings(), files=["asset"])
    assert caught.value.extra["errors"][0]["loc"] == ["params", "guidance", "prompts", 1, "prompt"]
    with pytest.raises(VocabularyError) as caught:
        check_request(request_of("a zebr", VASE), Settings(), files=["asset"])
    assert caught.value.extra["errors"][0]["loc"] == ["prompt"]


def test_lists_searches_and_estimates_know_all_prompts() -> None:
    request = request_of("a pear", VASE, {"prompt": "a Rabbit", "regions": [ABOVE]})
    assert TEXT_DEFORM.goal(request, {}) == "a pear + a vase + a Rabbit"
    assert "a rabbit" in searched_text(NewJob(request, {}))
    single, both = request_of("a pear"), request_of("a pear", VASE)
    assert single.workload == request_of("a vase").workload == "text_deform/sds/"
    assert len({single.workload, both.workload, request.workload}) == 3
