"""Fits: nearer with every step, the same whether interrupted or not."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from meshdeform.errors import CheckpointError
from meshdeform.fields.base_mesh import base_of
from meshdeform.fields.cleaning import clean
from meshdeform.fields.container import encode_base
from meshdeform.fields.fitting import FieldFit, FieldFrame, FitOptions
from meshdeform.fields.patches import level_of
from meshdeform.fields.rounding import rounded
from meshdeform.fields.surface_sources import Surface, surface_of
from meshdeform.geometry.shapes import icosphere


@pytest.fixture(scope="module")
def sphere() -> tuple[Surface, FieldFrame, np.ndarray, np.ndarray]:
    mesh = icosphere(4)
    surface = surface_of(clean(mesh.verts.numpy(), mesh.faces.numpy()))
    frame = FieldFrame.around(surface.reference.verts)
    verts, faces = base_of(surface.reference, 60)
    base = encode_base(frame.enter(verts), faces)
    return surface, frame, base.verts, base.faces


def radii(fit: FieldFit, frame: FieldFrame) -> np.ndarray:
    level = level_of(fit.faces, len(fit.verts), 2)
    return np.linalg.norm(frame.leave(fit.positions(level.corners, level.weights)), axis=1)


def test_a_coarse_base_becomes_a_sphere(sphere: tuple[Surface, FieldFrame, np.ndarray, np.ndarray]) -> None:
    options = FitOptions(steps=120, octaves=2, batch_faces=16)
    fit = FieldFit(*sphere, options)
    before = np.abs(radii(fit, sphere[1]) - 1)
    steps = list(fit)
    after = np.abs(radii(fit, sphere[1]) - 1)
    assert [step.step for step in steps] == list(range(1, 121))
    assert after.mean() < before.mean() / 3
    assert steps[-1].losses["distance"] < steps[0].losses["distance"] / 2


def test_a_resumed_fit_equals_an_uninterrupted_one(
    sphere: tuple[Surface, FieldFrame, np.ndarray, np.ndarray],
) -> None:
    options = FitOptions(steps=8, octaves=1, width=8, depth=1, batch_faces=6, seed=5)
    whole = FieldFit(*sphere, options)
    steps = iter(whole)
    for _ in range(3):
        next(steps)
    state = whole.checkpoint()
    list(steps)
    resumed = FieldFit(*sphere, options, checkpoint=state)
    assert resumed.step == 3
    late = whole.checkpoint()
    list(resumed)
    for one, other in zip(whole.field.tensors, resumed.field.tensors, strict=True):
        assert torch.equal(one, other)
    assert whole.rounding == resumed.rounding
    # The field of the end is what a file can hold, and what another resumption goes on with.
    for one, other in zip(whole.field.tensors, rounded(whole.field.tensors, whole.rounding), strict=True):
        assert torch.equal(one, other)
    again = FieldFit(*sphere, options, checkpoint=late)
    assert again.rounding == whole.rounding
    assert torch.equal(again.field.features, whole.field.features)
    branch = FieldFit(*sphere, options, initial=state.tensors)
    assert branch.step == 0
    assert torch.equal(branch.field.features.detach(), state.tensors["field.0"])
    with pytest.raises(CheckpointError, match="another base or network"):
        FieldFit(*sphere, FitOptions(steps=8, width=9), checkpoint=state)
