"""The paper's ablations: what each takes out, and that each still runs to a shape."""

from __future__ import annotations

import pytest
import torch

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from tests.cases import each_case
from tests.fakes import FakePrior
from training.evaluation.ablations import Ablation, SingleViews, ablated_params, deformation_of

PARAMS = resolve(DeformParams.model_validate({"preset": "paper", "steps": 60, "learning_rate": 0.02}))

# The others only set a weight to zero, which takes no run to see.
STRUCTURAL = [
    ablation
    if ablation in {Ablation.VERTICES, Ablation.SINGLE_VIEWS}
    else pytest.param(ablation, marks=pytest.mark.long)
    for ablation in Ablation
]


def deformed(ablation: Ablation | None, params: ResolvedParams) -> Deformation:
    guidance = ScoreDistillation(FakePrior(), "", guidance_scale=1.0)
    deformation = deformation_of(ablation, icosphere(2, 0.6), guidance, ablated_params(params, ablation))
    for _ in deformation:
        pass
    return deformation


@pytest.mark.parametrize("ablation", STRUCTURAL)
def test_each_comes_towards_the_shape_that_the_prior_knows(ablation: Ablation) -> None:
    verts = deformed(ablation, PARAMS).verts()
    extent = verts.amax(0) - verts.amin(0)
    assert float(extent[1] / extent[0]) > 1.4, "the prior knows a spheroid, half as wide as tall"


@pytest.mark.parametrize("ablation", STRUCTURAL)
def test_each_gives_another_shape_than_the_method(ablation: Ablation) -> None:
    params = PARAMS.model_copy(update={"steps": 5})
    assert not torch.equal(deformed(ablation, params).verts(), deformed(None, params).verts())


@each_case(
    ("ablation", "weight"),
    [
        (Ablation.NO_JACOBIAN, "jacobian_reg_weight"),
        (Ablation.NO_LAPLACIAN, "laplacian_weight"),
        (Ablation.NO_NORMAL, "normal_weight"),
    ],
)
def test_a_regulariser_is_left_out_by_its_weight_alone(ablation: Ablation, weight: str) -> None:
    before, after = PARAMS.model_dump(), ablated_params(PARAMS, ablation).model_dump()
    assert after == {**before, weight: 0.0}
    assert before[weight] > 0


@each_case("ablation", [None, Ablation.VERTICES, Ablation.SINGLE_VIEWS])
def test_the_others_leave_the_parameters_alone(ablation: Ablation | None) -> None:
    assert ablated_params(PARAMS, ablation) == PARAMS


def test_single_views_are_as_large_as_the_grid_of_four() -> None:
    views = SingleViews(CameraRange(), RenderStyle(view_size=24))
    cameras = views.sample(torch.Generator().manual_seed(0), 1.05)
    turns = [(b - a) % 360 for a, b in zip(cameras.azimuths_deg, cameras.azimuths_deg[1:], strict=False)]
    assert turns == pytest.approx([90.0] * 3)
    assert views.style.view_size == 48
    assert views.arrange(torch.zeros(4, 48, 48, 3)).shape == (4, 3, 48, 48)


@pytest.mark.parametrize("ablation", STRUCTURAL)
def test_each_resumes_from_its_checkpoint_to_the_same_bits(ablation: Ablation) -> None:
    params = ablated_params(PARAMS.model_copy(update={"steps": 6}), ablation)

    def fresh() -> Deformation:
        return deformation_of(
            ablation, icosphere(1, 0.6), ScoreDistillation(FakePrior(), "", guidance_scale=1.0), params
        )

    whole, first, second = fresh(), fresh(), fresh()
    for _ in whole:
        pass
    for step in first:
        if step.step == 3:
            break
    second.restore(first.checkpoint())
    for _ in second:
        pass
    assert torch.equal(second.verts(), whole.verts())
