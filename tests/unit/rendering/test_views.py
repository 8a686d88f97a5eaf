"""The arrangements of views: which cameras, which pictures."""

from __future__ import annotations

import pytest
import torch

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.views import Views
from meshdeform.requests.document import DeformParams, ViewMode, resolve
from meshdeform.testing import FakePrior
from tests.cases import each_case

SHAPES = {
    ViewMode.ORTHOGONAL_GRID: (1, 3, 48, 48),
    ViewMode.ORTHOGONAL_BATCH: (4, 3, 48, 48),
    ViewMode.RANDOM_BATCH: (4, 3, 48, 48),
    ViewMode.RANDOM_SINGLE: (1, 3, 48, 48),
}


@each_case("mode", list(ViewMode))
def test_pictures_have_the_size_that_the_prior_wants(mode: ViewMode) -> None:
    guidance = ScoreDistillation(FakePrior(view_size=24), "", guidance_scale=1.0)
    views = Views(mode, CameraRange(), guidance)
    cameras = views.sample(torch.Generator().manual_seed(0))
    turns = [(b - a) % 360 for a, b in zip(cameras.azimuths_deg, cameras.azimuths_deg[1:], strict=False)]
    assert (turns == pytest.approx([90.0] * 3)) is mode.name.startswith("ORTHOGONAL")
    images = torch.zeros(len(cameras.azimuths_deg), views.style.view_size, views.style.view_size, 3)
    assert views.arrange(images).shape == SHAPES[mode]


@each_case("mode", list(ViewMode))
def test_every_arrangement_reaches_the_shape_that_the_prior_knows(mode: ViewMode) -> None:
    params = resolve(DeformParams(views=mode, preset="paper", steps=60, learning_rate=0.02, guidance_scale=1.0))
    mesh = icosphere(2, 0.6)
    deformation = Deformation(mesh, ScoreDistillation(FakePrior(), "", guidance_scale=1.0), params)
    for _ in deformation:
        pass
    extent = deformation.verts().amax(0) - deformation.verts().amin(0)
    assert float(extent[1] / extent[0]) > 1.4, "the prior knows a spheroid, half as wide as tall"
