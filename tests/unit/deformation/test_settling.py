"""When a run is over: shaking does not count, going somewhere does; a run that ends so is whole, and resumes."""

from __future__ import annotations

import pytest
import torch

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.settling import Settling
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import DeformParams, resolve

F64 = torch.float64


def test_a_steady_motion_has_its_own_speed_and_never_settles() -> None:
    settling = Settling(0.5, diagonal=2.0)
    for step in range(100):
        settling.add(torch.full((4, 3), 0.01 * step, dtype=F64))
        assert not settling.settled
    # Each vertex goes 0.01 sqrt(3) a step; in units of the diagonal half of that.
    assert settling.speed == pytest.approx(0.005 * 3**0.5, rel=1e-9)


def test_shaking_after_a_motion_settles_though_its_steps_are_as_long() -> None:
    generator = torch.Generator().manual_seed(0)
    settling, at = Settling(0.25, diagonal=1.0), torch.zeros(200, 3, dtype=F64)
    for _ in range(60):
        at = at + 0.01
        settling.add(at)
    assert not settling.settled
    shaken = 0
    while not settling.settled and shaken < 150:
        settling.add(at + 0.01 * torch.randn(200, 3, generator=generator, dtype=F64))
        shaken += 1
    assert 20 < shaken < 150


def test_a_run_that_settles_ends_whole_before_its_last_step_and_resumes_to_the_bit() -> None:
    mesh = icosphere(1, 0.6)
    goal = TriangleMesh(mesh.verts * torch.tensor([0.8, 1.2, 1.0], dtype=F64), mesh.faces)
    guidance = TargetGuidance(goal, style=RenderStyle(view_size=16, supersample=1))
    params = resolve(DeformParams.model_validate({
        "guidance": "target", "preset": "preview", "steps": 300, "learning_rate": 0.02, "stop_when_settled": 0.3,
    }))  # fmt: skip
    whole = Deformation(mesh, guidance, params)
    steps = [step.step for step in whole]
    assert whole.settled
    assert whole.done
    assert 25 < len(steps) < 200
    assert len(steps) % 5 == 0, "the guard has looked at the last shape"
    assert list(whole) == [], "and it stays so"
    first = Deformation(mesh, guidance, params)
    for step in first:
        if step.step == 33:
            break
    second = Deformation(mesh, guidance, params, checkpoint=first.checkpoint())
    assert [step.step for step in second] == steps[33:]
    assert torch.equal(second.verts(), whole.verts())
    ended = Deformation(mesh, guidance, params, checkpoint=whole.checkpoint())
    assert ended.settled, "a checkpoint of the end is the end"
