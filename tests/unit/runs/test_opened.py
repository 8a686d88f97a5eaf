"""Assets that a process has read already: the same as read anew, and another where what decides it differs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from meshdeform.assets import Limits, build_glb
from meshdeform.errors import AssetTooLargeError
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.document import DeformParams, OutputParams, resolve
from meshdeform.runs import opened as module
from meshdeform.runs.base import InputFile
from meshdeform.runs.opened import opened
from meshdeform.support.recent import Recent
from tests.unit.plain.test_change import two_nodes

BALL = icosphere(2)
FILE = InputFile(build_glb(BALL.verts, BALL.faces), "a.glb")
PARAMS = resolve(DeformParams())
PLAIN = OutputParams()


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_recent", Recent(4, 2**20))


def test_an_asset_is_read_once() -> None:
    first = opened(FILE, PARAMS, PLAIN, None)
    assert opened(InputFile(FILE.data, "another.glb"), PARAMS, PLAIN, None) is first
    assert len(first.welded.mesh.faces) == len(BALL.faces)
    assert first.drawn.all()


def test_what_decides_how_it_is_read_is_not_shared() -> None:
    file = InputFile(two_nodes("Plinth", "Head"), "a.glb")
    whole = opened(file, PARAMS, PLAIN, None)
    less = opened(file, PARAMS.model_copy(update={"exclude": ("Head",)}), PLAIN, None)
    assert len(less.asset.surface.triangles) < len(whole.asset.surface.triangles)
    assert np.array_equal(opened(file, PARAMS, PLAIN, None).welded.vertex_map, whole.welded.vertex_map)


def test_the_limits_count_although_the_asset_was_read_with_others() -> None:
    opened(FILE, PARAMS, PLAIN, None)
    with pytest.raises(AssetTooLargeError):
        opened(FILE, PARAMS, PLAIN, Limits(max_triangles=10))


def test_assets_that_take_too_much_are_read_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_recent", Recent(4, 1000))
    first: Any = opened(FILE, PARAMS, PLAIN, None)
    assert opened(FILE, PARAMS, PLAIN, None) is not first
