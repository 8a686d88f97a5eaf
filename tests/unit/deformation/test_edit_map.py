"""Maps that take the deformation of one surface to others."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save
from scipy.spatial.distance import pdist

from meshdeform.deformation.edit_map import EditMap, Outside
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from tests.unit.deformation.worlds import moved
from training.shapes import box, cylinder

FINE = RestMesh.of(cylinder(0.25, 4.0, 40, 80))
COARSE = cylinder(0.25, 4.0, 8, 10)


def bent(points: NDArray[np.float64], degrees: float = 60.0) -> NDArray[np.float64]:
    radius = 4.0 / math.radians(degrees)
    angle, arm = (points[:, 1] + 2) / radius, radius - points[:, 0]
    return np.stack([radius - arm * np.cos(angle), arm * np.sin(angle) - 2, points[:, 2]], 1)


def test_levels_of_detail_and_what_is_near_follow_a_bend_through_few_triangles() -> None:
    edit = EditMap.between(FINE, bent(FINE.verts))
    assert len(edit.rest.faces) < len(FINE.faces) / 4
    assert edit.error < 0.01
    pouch = TriangleMesh(0.2 * box().verts, box().faces)
    for near in (FINE, COARSE, moved(pouch, 0.3, 0.5, 0.0)):
        apart = np.linalg.norm(edit.move(near) - bent(near.verts), axis=1)
        assert float(apart.max()) < 0.02 * 4


def test_every_similarity_is_exact_and_what_stays_keeps_its_bits() -> None:
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3))).Q
    turn = turn * np.sign(np.linalg.det(turn))
    shift = np.array([0.5, -1.0, 2.0], np.float64)
    near = moved(COARSE, 0.05, 0.02, -0.03)
    for scale in (1.0, 1.7):
        edit = EditMap.between(FINE, scale * FINE.verts @ turn.T + shift)
        assert len(edit.rest.faces) <= 250
        np.testing.assert_allclose(edit.move(near), scale * near.verts @ turn.T + shift, atol=1e-9)
    assert np.array_equal(EditMap.between(FINE, FINE.verts).move(near), near.verts)


def test_pieces_that_reach_out_of_the_box_are_refused_or_keep_their_shape() -> None:
    edit = EditMap.between(FINE, bent(FINE.verts))
    sword = moved(TriangleMesh(np.array([4.0, 0.1, 0.1]) * box().verts, box().faces), 2.2, 1.0, 0.0)
    both = join(COARSE, sword)
    with pytest.raises(ParameterError, match=r"1 of 2 pieces reach out of what the map deforms: from \(-0.6"):
        edit.move(both)
    found = edit.move(both, Outside.RIGID)
    np.testing.assert_array_equal(found[: len(COARSE.verts)], edit.move(COARSE))
    blade = found[len(COARSE.verts) :]
    np.testing.assert_allclose(pdist(blade), pdist(sword.verts), atol=1e-9)
    # The end that touches the bar goes where the bar goes.
    hilt = sword.verts[:, 0] < 1
    assert float(np.linalg.norm(blade[hilt] - bent(sword.verts[hilt]), axis=1).max()) < 0.15


@each_case("outside", list(Outside))
def test_another_origin_or_unit_is_refused(outside: Outside) -> None:
    edit = EditMap.between(FINE, bent(FINE.verts))
    with pytest.raises(ParameterError, match="all outside of what the map deforms") as error:
        edit.move(moved(COARSE, 100.0, 0.0, 0.0), outside)
    assert "same origin, axes and units" in error.value.advice_text


def test_a_file_holds_the_map(tmp_path: Path) -> None:
    joints = {"hip": np.array([0, 1, 0, 0.5, 0, 0, 1.25])}
    edit = EditMap.between(RestMesh.of(icosphere(2)), 2 * icosphere(2).verts, joints)
    path = tmp_path / "edit.safetensors"
    path.write_bytes(edit.to_bytes())
    assert path.stat().st_size < 10_000
    read = EditMap.read(str(path))
    near = icosphere(1, 1.05)
    np.testing.assert_allclose(read.move(near), edit.move(near), atol=1e-6)
    assert read.same_joint("hip", np.array([0, 1.0001, 0])).tolist() == [0.5, 0, 0, 1.25]  # type: ignore[union-attr]
    assert read.same_joint("hip", np.array([0, 1.1, 0])) is None
    assert read.same_joint("knee", np.array([0, 1, 0])) is None
    assert EditMap.read(str(path)).error == pytest.approx(edit.error, rel=0.01)


def test_what_is_no_map_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "edit.safetensors"

    def refused(data: bytes) -> str:
        path.write_bytes(data)
        with pytest.raises(ParameterError) as error:
            EditMap.read(str(path))
        return error.value.detail

    about = {"format": "meshdeform-edit-map", "version": "1", "error": "0", "joints": "[]"}
    rest, faces = np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.uint16)
    good = {"rest": rest, "moved": rest, "faces": faces}
    assert "not a map" in refused(save(good, {}))
    assert "not a map" in refused(save(good, about | {"version": "2"}))
    for changed in (
        {"faces": faces + 1},
        {"moved": rest[:2]},
        {"rest": rest + np.inf},
        {"faces": faces[:0]},
        {"joints": np.zeros((1, 7), np.float32)},
    ):
        assert refused(save(good | changed, about)) == "The map is damaged."
    assert refused(b"no safetensors") == "The map is damaged."
    assert refused(save({"rest": rest}, about)) == "The map is damaged."
