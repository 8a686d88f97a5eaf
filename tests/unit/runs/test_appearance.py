"""Runs whose model sees the asset's colours: what is drawn, what the report says, and that they resume exactly."""

from __future__ import annotations

import numpy as np
import pytest
import safetensors.torch
import torch

from meshdeform.deformation import stand_in
from meshdeform.deformation.surface_colours import baked_appearance, welded_appearance
from meshdeform.geometry.appearance import Appearance, Paint, Texture
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.shapes import icosphere, simplified
from meshdeform.geometry.weld import weld
from meshdeform.rendering.base_colours import BaseColours
from meshdeform.runs.optimised import TextDeformRun
from tests.fakes import FakePrior
from tests.unit.assets.builders import Builder
from tests.unit.runs.jobs import finished, started

BALL = icosphere(3, 0.5)
CORNERS = BALL.faces.reshape(-1)
POINTS = BALL.verts[CORNERS].astype(np.float32)
"""Every face has vertices of its own: all edges are seams."""


def asset(*, coloured: bool = True) -> bytes:
    builder = Builder()
    colors = {"COLOR_0": (POINTS + 0.5).astype(np.float32)} if coloured else {}
    builder.node(
        builder.mesh(builder.primitive(POINTS, np.arange(len(POINTS), dtype=np.uint32).reshape(-1, 3), **colors))
    )
    return builder.glb()


def drawn(*, coloured: bool = True, **params: object) -> TextDeformRun:
    target = [1.2, 0.8, 1.0] * BALL.verts
    prior = FakePrior(type(BALL)(target, BALL.faces), view_size=24)
    run: TextDeformRun = started(asset(coloured=coloured), model="some/model", steps=4, prior=prior, **params)
    return run


@pytest.mark.parametrize("case", ["surface", "lattice", "stand_in"])
def test_a_resumed_run_draws_what_the_whole_one_did(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if case == "stand_in":
        monkeypatch.setattr(stand_in, "MAX_FACES", 600)
        monkeypatch.setattr(stand_in, "FACES", 500)
    params = {"carrier": "auto" if case == "stand_in" else case}
    whole = drawn(**params)
    _, report = finished(whole)
    first = drawn(**params)
    for step, _ in zip(range(2), first, strict=False):
        assert step < 2
    resumed = drawn(checkpoint=first.checkpoint(), **params)
    list(resumed)
    states = [safetensors.torch.load(run.checkpoint()) for run in (whole, resumed)]
    assert states[0].keys() == states[1].keys()
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    source = "stand_in" if case == "stand_in" else "asset"
    assert report["texture_stretch"] is None
    assert report["appearance"] == {"drawn": "mixed", "colours": source, "notice": ""}
    if case == "surface":
        clay = drawn(**params, appearance="clay")
        list(clay)
        assert not np.array_equal(clay.positions(), whole.positions()), "the colours change what the model sees"


def test_an_asset_without_colours_is_clay_and_the_report_says_so() -> None:
    plain, clay = drawn(coloured=False), drawn(coloured=False, appearance="clay")
    found = finished(plain)[1]["appearance"]
    assert finished(clay)[1]["appearance"] == {"drawn": "clay", "colours": None, "notice": ""}
    assert found == {
        "drawn": "clay", "colours": None, "notice": "The asset has no colours, so the model saw it as clay."
    }  # fmt: skip
    assert np.array_equal(plain.positions(), clay.positions())


def test_a_stand_in_takes_the_colours_of_the_nearest_places() -> None:
    """A picture laid on a ball from the front: red to the right, green upwards, and holes at the top."""
    whole = RestMesh.of(icosphere(5, 0.5))
    ramp = np.linspace(0, 255, 64).astype(np.uint8)
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[..., 0], pixels[..., 1], pixels[..., 2] = ramp[None, :], ramp[::-1, None], 0
    pixels[:8, :, 3] = 0
    points = whole.verts.astype(np.float32)
    look = Appearance(
        np.arange(len(points)),
        whole.faces,
        np.stack([points[:, 0] + 0.5, 0.5 - points[:, 1]], 1),
        np.ones((len(points), 4), np.float32),
        np.zeros(len(whole.faces), np.int64),
        (Paint((1.0, 1.0, 1.0, 1.0), Texture(pixels, ("clamp", "clamp")), "MASK"),),
    )
    simple = RestMesh.of(simplified(whole, 1000))
    found = baked_appearance(look, whole, simple)
    assert np.array_equal(found.rows[found.triangles], simple.faces)
    assert found.paints[0].alpha_mode == "MASK"
    # At the corners and between them, where no vertex is.
    colours = BaseColours(found)
    for weights in ([1.0, 0, 0], [0, 0.5, 0.5], [0.2, 0.5, 0.3]):
        values = (colours.values[:, colours.faces] * np.array(weights, np.float32)).sum(-1)
        seen = colours.colours(colours.paint, values, np.zeros(len(colours.paint), np.float32))
        place = np.einsum("fkd,k->fd", simple.verts[simple.faces], weights)
        inside = np.abs(place[:, 1]) < 0.33
        shown = seen[:2, inside].T ** (1 / 2.2)
        assert np.abs(shown - np.clip(place[inside, :2] + 0.5, 0, 1)).max() < 0.06
        opacity = colours.opacity(colours.paint, seen)
        assert opacity[place[:, 1] > 0.42].max() == 0
        assert opacity[place[:, 1] < 0.33].min() == 1


def test_seams_and_dropped_faces_keep_each_face_its_colours() -> None:
    positions = np.concatenate([POINTS, POINTS[:1]]).astype(np.float64)
    triangles = np.concatenate([[[0, 1, len(POINTS)]], np.arange(len(POINTS)).reshape(-1, 3)])
    welded = weld(positions, triangles)
    assert welded.skipped["degenerate_faces"] == 1
    colors = np.concatenate([positions + 0.5, np.ones((len(positions), 1))], 1).astype(np.float32)
    count = len(positions)
    paint = np.zeros(len(triangles), np.int64)
    look = Appearance(np.arange(count), triangles, np.zeros((count, 2), np.float32), colors, paint, (Paint(),))
    found = welded_appearance(look, welded)
    assert found is not None
    assert np.array_equal(found.rows[found.triangles], welded.mesh.faces)
    drawn = welded.mesh.verts[welded.mesh.faces] + 0.5
    np.testing.assert_allclose(found.colors[found.triangles][..., :3], drawn, atol=1e-5)
