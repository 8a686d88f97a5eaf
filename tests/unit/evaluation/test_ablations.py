"""The paper's ablations: what each takes out, and that each still runs to a shape."""

from __future__ import annotations

import pytest
import torch

from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import DeformParams, resolve
from tests.cases import each_case
from tests.fakes import FakePrior
from training.evaluation.ablations import Ablation, SingleViews, ablated_params, deformation_of

PARAMS = resolve(DeformParams.model_validate({"preset": "paper", "steps": 60, "learning_rate": 0.02}))
WEIGHTS = {
    Ablation.NO_JACOBIAN: "jacobian_reg_weight",
    Ablation.NO_LAPLACIAN: "laplacian_weight",
    Ablation.NO_NORMAL: "normal_weight",
}


@each_case("ablation", Ablation)
def test_a_regulariser_is_left_out_by_its_weight_alone_and_the_others_leave_the_parameters(ablation: Ablation) -> None:
    before, after = PARAMS.model_dump(), ablated_params(PARAMS, ablation).model_dump()
    assert after == {**before, WEIGHTS.get(ablation, "steps"): 0.0 if ablation in WEIGHTS else 60}
    assert all(before[weight] > 0 for weight in WEIGHTS.values())


@each_case("ablation", [Ablation.VERTICES, Ablation.SINGLE_VIEWS])
def test_what_changes_more_comes_towards_the_shape_that_the_prior_knows(ablation: Ablation) -> None:
    guidance = ScoreDistillation(FakePrior(), "", guidance_scale=1.0)
    deformation = deformation_of(ablation, icosphere(2, 0.6), guidance, PARAMS)
    for _ in deformation:
        pass
    extent = deformation.verts().amax(0) - deformation.verts().amin(0)
    assert float(extent[1] / extent[0]) > 1.4, "the prior knows a spheroid, half as wide as tall"


def test_single_views_are_as_large_as_the_grid_of_four() -> None:
    views = SingleViews(CameraRange(), RenderStyle(view_size=24))
    cameras = views.sample(torch.Generator().manual_seed(0), 1.05)
    turns = [(b - a) % 360 for a, b in zip(cameras.azimuths_deg, cameras.azimuths_deg[1:], strict=False)]
    assert turns == pytest.approx([90.0] * 3)
    assert views.style.view_size == 48
    assert views.arrange(torch.zeros(4, 48, 48, 3)).shape == (4, 3, 48, 48)
