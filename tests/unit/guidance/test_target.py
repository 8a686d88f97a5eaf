"""A target mesh: zero where the views agree, downhill where they do not."""

from __future__ import annotations

import pytest
import torch

from meshdeform.errors import NumericalError, ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle, combine_views
from tests.close import assert_close

STYLE = RenderStyle(view_size=32, supersample=1, shading="normals")
CONTEXT = StepContext(0, 10, fixed_cameras(20.0, 15.0), torch.Generator().manual_seed(0))
SPHERE = icosphere(3)


def picture(scale: torch.Tensor) -> torch.Tensor:
    renderer = Renderer(SPHERE.faces, SPHERE.verts.shape[0], STYLE)
    return combine_views(renderer.render(SPHERE.verts * scale, CONTEXT.cameras))


def scaled(*factors: float) -> TriangleMesh:
    return TriangleMesh(SPHERE.verts * torch.tensor(factors, dtype=torch.float64), SPHERE.faces)


def test_the_target_itself_costs_nothing() -> None:
    loss, logs = TargetGuidance(scaled(0.7, 0.7, 0.7), style=STYLE).loss(
        picture(torch.full((3,), 0.7, dtype=torch.float64)), CONTEXT
    )
    assert loss.item() == 0.0
    assert logs == {"target_mse": 0.0}


def test_a_difference_of_a_tenth_costs_one() -> None:
    guidance = TargetGuidance(scaled(0.7, 0.7, 0.7), style=STYLE)
    shifted = picture(torch.full((3,), 0.7, dtype=torch.float64)) + 0.1
    loss, logs = guidance.loss(shifted, CONTEXT)
    assert loss.item() == pytest.approx(1.0, rel=1e-4)
    assert logs["target_mse"] == pytest.approx(0.01, rel=1e-4)


def test_descent_finds_the_three_axes_of_an_ellipsoid() -> None:
    axes = (0.5, 0.9, 0.7)
    guidance = TargetGuidance(scaled(*axes), style=STYLE)
    scale = torch.full((3,), 0.7, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([scale], lr=0.02)
    losses = []
    for _ in range(60):
        loss, _ = guidance.loss(picture(scale), CONTEXT)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.02 * losses[0]
    assert_close(scale.detach(), torch.tensor(axes, dtype=torch.float64), rtol=0.0, atol=0.01)


def test_the_identity_is_the_meshs_own() -> None:
    one, same, other = (TargetGuidance(scaled(x, 1.0, 1.0), style=STYLE).identity for x in (0.5, 0.5, 0.6))
    assert one == same != other
    assert TargetGuidance(SPHERE, style=STYLE, identity={"id": "cow.glb"}).identity == {"id": "cow.glb"}


def test_a_picture_of_another_size_is_a_mistake() -> None:
    with pytest.raises(ShapeError, match="expected an image"):
        TargetGuidance(SPHERE, style=STYLE).loss(torch.zeros(1, 3, 16, 16), CONTEXT)


def test_a_picture_that_is_not_finite_stops_the_run() -> None:
    with pytest.raises(NumericalError):
        TargetGuidance(SPHERE, style=STYLE).loss(torch.full((1, 3, 64, 64), torch.nan), CONTEXT)
