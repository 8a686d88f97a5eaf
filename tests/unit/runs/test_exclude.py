"""Ground planes: a small object stays on a large ground; what is left out, or is a backdrop, stays as it is."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets import Primitive, build_glb, load_asset
from meshdeform.assets.accessors import read_accessor
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.errors import CheckpointError, ParameterError
from meshdeform.geometry.shapes import icosphere
from meshdeform.runs.strength import with_strength
from tests.cases import each_case
from tests.unit.assets.builders import pack, unpack
from tests.unit.runs.jobs import finished, started
from training.shapes import grid

BALL = icosphere(2)


def scene(cells: int, *, half_width: float = 5000.0) -> bytes:
    """Return a ball of two units that stands on a square ground."""
    flat = grid(cells)
    points = (flat.verts[:, [0, 2, 1]] - flat.verts[:, [0, 2, 1]].mean(0)) * half_width
    ball = Primitive(BALL.verts / np.linalg.norm(BALL.verts[0]) + [0, 1, 0], BALL.faces, name="ball")
    return build_glb([ball, Primitive(points, flat.faces[:, ::-1], name="Ground")])


def height_above(positions: np.ndarray, triangles: np.ndarray, point: np.ndarray) -> float:
    """Return how far a point is above the triangle below or above it."""
    for a, b, c in positions[triangles]:
        edges = np.stack([b - a, c - a], axis=1)
        if abs(np.linalg.det(edges[[0, 2]])) > 0:
            u, v = np.linalg.solve(edges[[0, 2]], (point - a)[[0, 2]])
            if min(u, v, 1 - u - v) >= -1e-9:
                return float(point[1] - (a + edges @ [u, v])[1])
    raise AssertionError("no triangle is there")


def test_a_small_ball_stays_on_a_large_ground() -> None:
    asset = scene(21)
    result, report = finished(started(asset, steps=40, backdrop="deform"))
    assert report["carrier"]["kind"] == "lattice"
    found = load_asset(result).surface
    is_ball = found.instance_of_vertex == 0
    ball = found.positions[is_ball]
    ground = found.triangles[~is_ball[found.triangles[:, 0]]]
    diagonal = float(np.linalg.norm(np.ptp(load_asset(asset).surface.positions, axis=0)))
    moved = found.positions - load_asset(asset).surface.positions
    assert np.linalg.norm(moved, axis=1).max() > 0.1 * diagonal
    assert abs(height_above(found.positions, ground, ball[ball[:, 1].argmin()])) < 1e-3 * diagonal
    assert np.ptp(ball, axis=0).max() < 4 * 2  # as the ground around it is stretched


def test_a_ground_of_one_quad_stays_and_the_ball_on_it_is_deformed_alone() -> None:
    asset = scene(1)
    run = started(asset, steps=20)
    result, report = finished(run)
    before, after = load_asset(asset).surface, load_asset(result).surface
    ball = after.instance_of_vertex == 0
    np.testing.assert_array_equal(after.positions[~ball], before.positions[~ball])
    moved = np.linalg.norm(after.positions - before.positions, axis=1)[ball]
    assert 0.1 < moved.max() < 2  # of a ball of two units on a ground of 10,000
    assert report["carrier"]["kind"] == "surface"  # one part is left
    assert report["mesh"]["same_faces"]
    assert report["mesh"]["welded_vertices"] == len(BALL.verts)
    (said,) = report["input"]["warnings"]
    assert "'Ground' (node 1) looks like a ground plane" in said
    assert "neither drawn nor deformed" in said

    # A strength takes the same way, without the ground.
    half = load_asset(with_strength(load_asset(asset), result, 0.5)).surface.positions
    np.testing.assert_array_equal(half[~ball], before.positions[~ball])
    assert np.linalg.norm(half - before.positions, axis=1)[ball].max() < moved.max()

    saved = run.checkpoint()
    with pytest.raises(CheckpointError, match=r"params\.control\.backdrop"):
        started(asset, steps=1, initial=saved, backdrop="deform")


def contents(data: bytes, mesh: int) -> list[bytes]:
    """Return the bytes of every accessor of a mesh."""
    document = Document.parse(data, Limits(), glb=True)
    primitives = document.root["meshes"][mesh]["primitives"]
    slots = [at for p in primitives for at in (*p["attributes"].values(), p["indices"])]
    return [read_accessor(document, at).tobytes() for at in slots]


@each_case("output", [{}, {"compact": True}, {"subdivide": True}])
def test_an_excluded_ground_is_not_drawn_and_comes_back_as_it_was(output: dict[str, bool]) -> None:
    asset = scene(1)
    assert any("params.control.backdrop" in text for text in load_asset(asset).summary.warnings)
    run = started(asset, exclude=["Ground"], output=output, steps=20)
    result, report = finished(run)
    assert contents(result, 1) == contents(asset, 1)
    assert unpack(result)[0]["nodes"] == unpack(asset)[0]["nodes"]
    before, after = (load_asset(data).without([1]).surface.positions for data in (asset, result))
    assert len(before) == len(BALL.verts)
    if "subdivide" not in output:
        assert np.abs(after - before).max() > 0.1  # of a ball of two units: it fills the pictures now
    assert report["input"]["warnings"] == []
    assert report["mesh"]["same_faces"]
    assert report["mesh"]["welded_vertices"] == len(after)
    saved = run.checkpoint()
    with pytest.raises(CheckpointError, match=r"params\.control\.exclude"):
        started(asset, steps=1, initial=saved)


def test_a_mesh_that_an_excluded_node_shows_as_well_stays_there() -> None:
    root, binary, _ = unpack(scene(1))
    root["nodes"] += [{"name": "group", "children": [3]}, {"mesh": 0, "translation": [9, 0, 0]}]
    root["scenes"][0]["nodes"].append(2)
    asset = pack(root, binary)
    for output in ({}, {"subdivide": True}):
        result, _ = finished(started(asset, exclude=["Ground", 2], output=output, steps=2))
        after = unpack(result)[0]["nodes"]
        assert contents(result, after[3]["mesh"]) == contents(asset, 0)
        assert contents(result, after[0]["mesh"])[0] != contents(asset, 0)[0]


def test_what_excludes_nothing_or_everything_is_refused() -> None:
    with pytest.raises(ParameterError, match="no node named 'ground'") as caught:
        started(scene(1), exclude=["ground"])
    assert "'Ground'" in caught.value.advice_text
    with pytest.raises(ParameterError, match="nothing is left"):
        started(scene(1), exclude=[0, 1])
