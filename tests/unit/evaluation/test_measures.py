"""Known answers of the benchmark's measures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from meshdeform.assets import build_glb
from meshdeform.errors import AssetFormatError, NumericalError, ParameterError, ShapeError
from meshdeform.geometry.mesh import TriangleMesh, edges_of, face_cross
from meshdeform.geometry.shapes import join
from tests.cases import each_case
from tests.unit.rendering.test_shading import encoded, textured
from training.evaluation.measures import chamfer_distance, displacement, measures
from training.evaluation.mesh_file import read_ply, read_texels, write_ply, write_texels
from training.evaluation.relaxed import geodesic_sphere
from training.evaluation.sources import SOURCES, source_mesh, source_texels
from training.evaluation.suite import SUITES, find_suite
from training.shapes import box, grid


def moved(mesh: TriangleMesh, matrix: list[list[float]] | torch.Tensor, by: float = 0.0) -> TriangleMesh:
    return TriangleMesh(mesh.verts @ torch.as_tensor(matrix, dtype=torch.float64).T + by, mesh.faces)


def test_known_meshes_have_known_figures() -> None:
    """A mesh beside itself, a shift, two parallel planes, and a surface that slides on itself."""
    sphere, cube = geodesic_sphere(8), box(3)
    figures = measures(sphere, sphere)
    assert figures["displacement"] == figures["chamfer"] == figures["area_ratio_spread"] == 0
    assert figures["symmetric_dirichlet_mean"] == pytest.approx(1)
    assert figures["volume_ratio"] == pytest.approx(1)
    assert not any(figures[name] for name in ("flipped_faces", "collapsed_faces", "self_intersections_added"))
    shifted = TriangleMesh(cube.verts + torch.tensor([0.3, 0.4, 0.0]), cube.faces)
    assert displacement(cube.verts.numpy(), cube.faces.numpy(), shifted.verts.numpy()) == pytest.approx(0.5)
    assert measures(cube, shifted)["displacement"] == pytest.approx(0.5 / math.sqrt(3))
    verts, faces = grid(4).verts.numpy(), grid(4).faces.numpy()
    assert chamfer_distance(verts, verts + [0, 0, 0.2], faces) == pytest.approx(0.2, rel=1e-3)
    c, s = math.cos(0.5), math.sin(0.5)
    slid = measures(sphere, moved(sphere, [[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    assert (slid["displacement"] > 0.1, slid["chamfer"] < 0.01) == (True, True)


def test_other_faces_and_broken_positions_are_refused() -> None:
    sphere = geodesic_sphere(2)
    with pytest.raises(ShapeError):
        measures(sphere, TriangleMesh(sphere.verts, sphere.faces.flip(1)))
    broken = sphere.verts.clone()
    broken[0, 0] = math.nan
    with pytest.raises(NumericalError):
        measures(sphere, TriangleMesh(broken, sphere.faces))


def test_the_offsets_of_neighbouring_parts_count_as_a_share_of_the_diagonal() -> None:
    one = geodesic_sphere(3)
    pair = join(one, TriangleMesh(one.verts + torch.tensor([2.05, 0.0, 0.0]), one.faces))
    diagonal = float(np.linalg.norm(np.ptp(pair.verts.numpy(), axis=0)))
    turned = measures(pair, moved(pair, torch.eye(3) * 1.0, 5.0))
    assert turned["neighbour_offset"] == 0
    apart = pair.verts.clone()
    apart[len(one.verts) :, 1] += 0.3
    found = measures(pair, TriangleMesh(apart, pair.faces))["neighbour_offset"]
    assert found == pytest.approx(0.3 / diagonal)
    assert measures(one, moved(one, torch.eye(3) * 3.0))["neighbour_offset"] == 0
    far = join(one, TriangleMesh(one.verts + 9.0, one.faces))
    assert measures(far, TriangleMesh(far.verts * 2, far.faces))["neighbour_offset"] == 0


# The benchmark's PLY files.


def test_a_mesh_comes_back_bit_for_bit_and_a_file_that_is_not_whole_is_refused() -> None:
    mesh = geodesic_sphere(3)
    back = read_ply(write_ply(mesh))
    assert torch.equal(back.verts, mesh.verts)
    assert torch.equal(back.faces, mesh.faces)
    for cut in (-1, 40, 0):
        with pytest.raises(AssetFormatError):
            read_ply(write_ply(mesh)[:cut])


# The benchmark's sources are what their table says, and its suites are whole.


def volume(mesh: TriangleMesh) -> float:
    return float((mesh.verts[mesh.faces[:, 0]] * face_cross(mesh.verts, mesh.faces)).sum() / 6)


@each_case("name", SOURCES)
def test_sources_are_closed_consistently_oriented_outwards_and_of_the_promised_size(name: str) -> None:
    mesh = source_mesh(name)
    edges = edges_of(mesh.faces)
    assert 1_500 <= len(mesh.faces) <= 2_600
    assert bool((edges.counts == 2).all())
    assert bool(edges.consistent.all())
    assert volume(mesh) > 0


_COUNTS = [("small", 48), ("turned", 48), ("full", 192), ("nouns", 149), ("unseen", 40), ("seen", 40), ("paper", 48)]


@each_case(("name", "count"), _COUNTS)
def test_a_suite_is_every_source_by_every_prompt_by_every_seed(name: str, count: int) -> None:
    suite = SUITES[name]
    items = suite.items()
    assert len(items) == len(set(items)) == len({item.name for item in items}) == count
    assert set(suite.sources) <= set(SOURCES)
    assert {item.seed for item in suite.with_seeds((3, 4)).items()} == {3, 4}


def test_a_mesh_of_ones_own_takes_the_place_of_the_sources(tmp_path: Path) -> None:
    path, mesh = tmp_path / "my cow.glb", box(2)
    path.write_bytes(build_glb(mesh.verts.numpy(), mesh.faces.numpy()))
    suite = find_suite("small").with_sources((str(path),))
    assert {item.source for item in suite.items()} == {str(path)}
    assert suite.items()[0].name.startswith("my cow--")
    assert len(source_mesh(str(path)).faces) == len(mesh.faces)
    with pytest.raises(ParameterError, match="called 'my cow'"):
        suite.with_sources((str(path), str(tmp_path / "other" / "my cow.obj")))
    with pytest.raises(ParameterError, match="no suite 'large'"):
        find_suite("large")


def test_the_texture_of_a_file_stays_with_its_faces(tmp_path: Path) -> None:
    (tmp_path / "square.glb").write_bytes(textured(encoded(np.zeros((64, 32, 3)))))
    name = str(tmp_path / "square.glb")
    mesh, texels = source_mesh(name), source_texels(name)
    assert texels is not None
    assert np.array_equal(read_texels(write_texels(texels)), texels)
    corners = mesh.verts.numpy()[mesh.faces.numpy()]
    np.testing.assert_allclose(texels, [16, 32] + corners[..., :2] / 0.7 * [16, -32], atol=1e-4)
    found = measures(mesh, TriangleMesh(2 * mesh.verts, mesh.faces), texels)
    assert (found["texture_stretch_p95"], found["texture_stretch_above_2"]) == (pytest.approx(1), 0)
    assert source_texels("sphere") is None
