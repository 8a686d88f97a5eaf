"""The whole loop: a target is reached, seeds repeat, a resumed run is the uninterrupted one bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation.checkpoint import Checkpoint, dump_checkpoint, load_checkpoint
from meshdeform.deformation.loop import Deformation
from meshdeform.errors import CheckpointError, NumericalError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.target import TargetGuide
from meshdeform.rendering.shading import RenderStyle
from tests.cases import each_case
from tests.meshes import mesh_of
from tests.unit.deformation.test_degrees_of_freedom import sled
from tests.unit.deformation.worlds import params

STYLE = RenderStyle(view_size=32, supersample=2)


def ellipsoid() -> TriangleMesh:
    sphere = icosphere(3, 0.6)
    return mesh_of(verts_of(sphere) * torch.tensor([0.6, 1.4, 0.9], dtype=torch.float64), faces_of(sphere))


def run(deformation: Deformation, steps: int | None = None) -> list[dict[str, float]]:
    found = []
    for step in deformation:
        found.append(step.losses)
        if steps is not None and step.step >= steps:
            break
    return found


def test_another_seed_gives_another_result() -> None:
    results = []
    for seed in (3, 3, 4):
        deformation = Deformation(icosphere(1, 0.6), TargetGuide(ellipsoid(), style=STYLE), params(steps=4, seed=seed))
        run(deformation)
        results.append(deformation.verts())
    assert torch.equal(results[0], results[1])
    assert not torch.equal(results[0], results[2])


@each_case("stop", [1, 7, 19])
@each_case("preset, source", [("preview", icosphere(2, 0.6)), ("preview", sled()), ("paper", icosphere(2, 0.6))])
def test_a_resumed_run_is_the_uninterrupted_one_bit_for_bit(stop: int, preset: str, source: TriangleMesh) -> None:
    settings = params(preset=preset, steps=20, seed=11)
    guidance = TargetGuide(ellipsoid(), style=STYLE)
    whole = Deformation(source, guidance, settings)
    run(whole)
    first = Deformation(source, guidance, settings)
    run(first, stop)
    stored = dump_checkpoint(first.checkpoint(), "run")
    second = Deformation(source, guidance, settings, checkpoint=load_checkpoint(stored, "run"))
    assert second.step == stop
    rest = run(second)
    assert len(rest) == 20 - stop
    assert torch.equal(second.verts(), whole.verts())
    for name, value in whole.checkpoint().tensors.items():
        assert np.array_equal(second.checkpoint().tensors[name], value), name


def test_a_checkpoint_is_of_its_mesh_and_does_not_change_with_the_run() -> None:
    guidance = TargetGuide(ellipsoid(), style=STYLE)
    deformation = Deformation(icosphere(1, 0.6), guidance, params(steps=4))
    run(deformation, 2)
    state: Checkpoint = deformation.checkpoint()
    kept = {k: v.copy() for k, v in state.tensors.items()}
    run(deformation)
    assert all(np.array_equal(kept[k], v) for k, v in state.tensors.items())
    with pytest.raises(CheckpointError, match="mesh"):
        Deformation(icosphere(2, 0.6), guidance, params(steps=4), checkpoint=state)


def test_another_run_begins_with_the_shape_of_a_checkpoint_and_nothing_else_of_it() -> None:
    guidance = TargetGuide(ellipsoid(), style=STYLE)
    first = Deformation(icosphere(2, 0.6), guidance, params(steps=20, seed=11))
    run(first, 7)
    shape = first.checkpoint().tensors
    second = Deformation(icosphere(2, 0.6), guidance, params(steps=3, seed=12), initial=shape)
    assert second.step == 0
    assert torch.equal(second.verts(), first.verts())
    fresh = Deformation(icosphere(2, 0.6), guidance, params(steps=3, seed=12)).checkpoint().tensors
    begun = second.checkpoint().tensors
    assert set(begun) == set(fresh), "no moments of the optimiser"
    assert np.array_equal(begun["generator"], fresh["generator"])
    assert len(run(second)) == 3
    assert not torch.equal(second.verts(), first.verts())
    assert all(np.array_equal(shape[name], value) for name, value in first.checkpoint().tensors.items())
    with pytest.raises(CheckpointError, match="mesh"):
        Deformation(icosphere(1, 0.6), guidance, params(steps=3), initial=shape)


class _Troubled(TargetGuide):
    """Fails in the third step, after it has drawn random numbers: once for want of memory, or with no number."""

    def __init__(self, trouble: Exception | float | None = None) -> None:
        super().__init__(ellipsoid(), style=STYLE)
        self.trouble = trouble

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        torch.randn(3, generator=context.generator)
        loss, logs = super().loss(image, context)
        if context.step == 2 and self.trouble is not None:
            trouble, self.trouble = self.trouble, None
            if isinstance(trouble, Exception):
                raise trouble
            loss = loss * trouble
        return loss, logs


def test_a_step_that_raises_leaves_the_state_as_it_was() -> None:
    settings = params(steps=6, seed=3)
    whole = Deformation(icosphere(1, 0.6), _Troubled(), settings)
    run(whole)
    guidance = _Troubled(torch.OutOfMemoryError("CUDA out of memory."))
    broken = Deformation(icosphere(1, 0.6), guidance, settings)
    with pytest.raises(torch.OutOfMemoryError):
        run(broken)
    assert broken.step == 2
    resumed = Deformation(icosphere(1, 0.6), guidance, settings, checkpoint=broken.checkpoint())
    run(resumed)
    run(broken)
    for name, value in whole.checkpoint().tensors.items():
        assert np.array_equal(resumed.checkpoint().tensors[name], value), name
        assert np.array_equal(broken.checkpoint().tensors[name], value), name


def test_a_loss_that_is_not_finite_stops_the_run_with_the_step() -> None:
    deformation = Deformation(icosphere(1, 0.6), _Troubled(float("nan")), params(steps=5))
    with pytest.raises(NumericalError, match="step 3"):
        run(deformation)
    assert deformation.step == 2


def test_an_optimiser_that_fails_in_the_midst_leaves_no_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    deformation = Deformation(icosphere(1, 0.6), TargetGuide(ellipsoid(), style=STYLE), params(steps=5))
    run(deformation, 2)

    def fail() -> None:
        raise MemoryError

    monkeypatch.setattr(deformation._optimizer, "step", fail)
    with pytest.raises(MemoryError):
        run(deformation)
    with pytest.raises(CheckpointError, match="failed while it updated"):
        deformation.checkpoint()
