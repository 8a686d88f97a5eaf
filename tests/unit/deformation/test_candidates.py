"""Several seeds: the best goes on as if it had been alone, from any checkpoint, and steps add up."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch
from torch import Tensor

from meshdeform.deformation.candidates import CandidateRun
from meshdeform.deformation.checkpoint import dump_checkpoint, load_checkpoint
from meshdeform.deformation.loop import Deformation
from meshdeform.errors import CheckpointError, ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.testing import FakePrior

STYLE = RenderStyle(view_size=16, supersample=1)
MESH = icosphere(1, 0.6)


def params(**changes: object) -> ResolvedParams:
    return resolve(DeformParams.model_validate({"preset": "preview", "guidance": "target", "seed": 7, **changes}))


def guidance() -> TargetGuidance:
    stretched = MESH.verts * torch.tensor([0.6, 1.4, 0.9], dtype=torch.float64)
    return TargetGuidance(TriangleMesh(stretched, MESH.faces), style=STYLE)


def start(settings: ResolvedParams) -> CandidateRun:
    return CandidateRun(Deformation(MESH, guidance(), settings))


def finish(run: CandidateRun) -> list[int]:
    return [step.step for step in run]


SEARCH = {"steps": 9, "candidates": 5, "candidate_steps": 2}


def test_the_survivor_is_what_a_run_of_its_seed_alone_gives() -> None:
    run = start(params(**SEARCH))
    assert run.deformation.params.rungs == (5, 3, 2)
    assert run.total_steps == 9 + 2 * (4 + 2 + 1)
    assert finish(run) == list(range(1, run.total_steps + 1))
    (chosen,) = [entry for entry in run.to_report() if entry["chosen"]]
    alone = start(params(steps=9, seed=chosen["seed"]))
    assert finish(alone) == list(range(1, 10))
    assert torch.equal(run.verts(), alone.verts())


def test_the_worse_half_is_given_up_after_every_round() -> None:
    run = start(params(**SEARCH))
    finish(run)
    report = run.to_report()
    assert [entry["seed"] for entry in report] == [7, 8, 9, 10, 11]
    alive = report
    for rung, count in enumerate((5, 3, 2)):
        assert len(alive) == count
        ranked = sorted(alive, key=lambda entry: entry["grades"][rung]["grade"])
        grades = [entry["grades"][rung]["grade"] for entry in ranked]
        assert all(a < b for a, b in pairwise(grades)), "grades of different shapes differ"
        assert {entry["grades"][rung]["step"] for entry in ranked} == {2 * (rung + 1)}
        keep = (count + 1) // 2
        assert all(len(entry["grades"]) == rung + 1 for entry in ranked[keep:])
        alive = ranked[:keep]
    assert alive[0]["chosen"]


def test_a_grade_is_the_same_each_time_and_takes_none_of_the_runs_random_numbers() -> None:
    plain, graded = (Deformation(MESH, guidance(), params(steps=4)) for _ in range(2))
    for a, b in zip(plain, graded, strict=True):
        assert graded.grade() == graded.grade()
        assert a.losses == b.losses
    assert graded.grade() < Deformation(MESH, guidance(), params(steps=4)).grade(), "four steps nearer to the target"


@pytest.mark.parametrize("stop", [1, 10, 13, 17])
def test_a_resumed_search_is_the_uninterrupted_one_bit_for_bit(stop: int) -> None:
    settings = params(**SEARCH, stop_when_settled=0.01, seed=3)
    whole = start(settings)
    finish(whole)
    first = start(settings)
    for step in first:
        if step.step == stop:
            break
    stored = load_checkpoint(dump_checkpoint(first.checkpoint(), "run"), "run")
    second = CandidateRun(Deformation(MESH, guidance(), settings), stored)
    assert second.step == stop
    assert finish(second) == list(range(stop + 1, whole.total_steps + 1))
    assert torch.equal(second.verts(), whole.verts())
    assert second.to_report() == whole.to_report()


def test_a_checkpoint_of_one_candidate_is_refused_by_a_search() -> None:
    with pytest.raises(CheckpointError, match="one candidate"):
        CandidateRun(Deformation(MESH, guidance(), params(**SEARCH)), start(params(steps=9)).checkpoint())


def test_more_rounds_than_steps_are_refused_with_what_to_change() -> None:
    with pytest.raises(ParameterError, match=r"5 candidates need 3 rounds of 4 steps, and the run has 9\.") as caught:
        params(**{**SEARCH, "candidate_steps": 4})
    assert "candidate_steps" in caught.value.advice_text


class _Preferring:
    """A target whose grades prefer whatever has been drawn last."""

    def __init__(self) -> None:
        self.target, self.asked = guidance(), 0
        self.style = self.single_style = STYLE
        self.identity = self.target.identity

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        return self.target.loss(image, context)

    def grade(self, image: Tensor, context: StepContext) -> float:
        self.asked += 1
        return -float(self.asked)


def test_the_guidance_has_the_say() -> None:
    run = CandidateRun(Deformation(MESH, _Preferring(), params(steps=4, candidates=3, candidate_steps=1)))
    finish(run)
    assert [entry["chosen"] for entry in run.to_report()] == [False, False, True]


class _TwoPictures(FakePrior):
    """Knows what it would see by the prompt, and what without: one grey each."""

    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        level = self.alphas_cumprod[timestep].view(-1, 1, 1, 1)
        return tuple((z_t - level.sqrt() * grey) / (1 - level).sqrt() for grey in (0.5, -0.25))


def test_the_grade_of_a_prior_is_the_distance_by_the_prompt_less_that_without() -> None:
    """Whatever the noise and the timestep: the predictions are known, so the difference is."""
    generator = torch.Generator().manual_seed(0)
    distillation = ScoreDistillation(_TwoPictures(), "an egg", guidance_scale=7.5)
    image = torch.rand(1, 3, 8, 8, generator=generator)
    cameras = fixed_cameras(0.0, 0.0)
    z0 = image * 2 - 1
    wanted = float(((-0.25 - z0).square() - (0.5 - z0).square()).mean())
    for _ in range(4):
        found = distillation.grade(image, StepContext(0, 1, cameras, generator))
        assert found == pytest.approx(wanted, rel=1e-2)
    dark = torch.full_like(image, 0.375)
    # z0 is -1/4 all over: the prompt's own picture, and 3/4 away from the other.
    assert distillation.grade(dark, StepContext(0, 1, cameras, generator)) == pytest.approx(-(0.75**2), rel=1e-2)
