"""Known answers of the benchmark's measures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from meshdeform.assets import build_glb
from meshdeform.errors import AssetFormatError, NumericalError, ParameterError, ShapeError
from meshdeform.geometry.intersections import intersecting_faces
from meshdeform.geometry.mesh import TriangleMesh, connected_components, edges_of, face_cross
from meshdeform.geometry.shapes import join
from meshdeform.priors.builtin.grammar import parse
from tests.cases import each_case
from tests.unit.rendering.test_shading import encoded, textured
from training.evaluation.measures import chamfer_distance, displacement, measures, surface_points
from training.evaluation.mesh_file import read_ply, read_texels, write_ply, write_texels
from training.evaluation.neighbours import neighbour_offsets
from training.evaluation.relaxed import capsule, geodesic_sphere, relaxed_surface
from training.evaluation.sources import SOURCES, mesh_sha256, source_mesh, source_texels
from training.evaluation.suite import SUITES, find_suite
from training.prior.held_out import is_held_out
from training.shapes import box, grid


def moved(mesh: TriangleMesh, matrix: list[list[float]] | torch.Tensor, by: float = 0.0) -> TriangleMesh:
    return TriangleMesh(mesh.verts @ torch.as_tensor(matrix, dtype=torch.float64).T + by, mesh.faces)


def test_a_mesh_is_perfect_beside_itself() -> None:
    sphere = geodesic_sphere(4)
    figures = measures(sphere, sphere)
    assert figures["displacement"] == figures["chamfer"] == figures["area_ratio_spread"] == 0
    assert figures["symmetric_dirichlet_mean"] == pytest.approx(1)
    assert figures["volume_ratio"] == pytest.approx(1)
    assert not any(figures[name] for name in ("flipped_faces", "collapsed_faces", "self_intersections_added"))


def test_a_shift_moves_every_vertex_by_its_length() -> None:
    cube = box(3)
    shifted = TriangleMesh(cube.verts + torch.tensor([0.3, 0.4, 0.0]), cube.faces)
    assert displacement(cube.verts.numpy(), cube.faces.numpy(), shifted.verts.numpy()) == pytest.approx(0.5)
    assert measures(cube, shifted)["displacement"] == pytest.approx(0.5 / math.sqrt(3))


def test_two_parallel_planes_are_as_far_apart_as_they_are() -> None:
    verts, faces = grid(4).verts.numpy(), grid(4).faces.numpy()
    assert chamfer_distance(verts, verts + [0, 0, 0.2], faces) == pytest.approx(0.2, rel=1e-3)


def test_a_surface_that_slides_on_itself_is_displaced_and_not_distant() -> None:
    sphere = geodesic_sphere(8)
    c, s = math.cos(0.5), math.sin(0.5)
    figures = measures(sphere, moved(sphere, [[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    assert figures["displacement"] > 0.1
    assert figures["chamfer"] < 0.01


def test_points_are_uniform_by_area() -> None:
    # Two triangles of areas 1 and 3.
    verts = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [9, 0, 0], [9, 2, 0], [6, 0, 0]], float)
    points = surface_points(verts, np.array([[0, 1, 2], [3, 4, 5]]), 20_000, 0)
    assert (points[:, 0] > 3).mean() == pytest.approx(0.75, abs=0.01)
    assert points[points[:, 0] <= 3].mean(0) == pytest.approx([1 / 3, 2 / 3, 0], abs=0.02)


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


def test_thousands_of_parts_are_sampled_or_left_out() -> None:
    tetrahedron = TriangleMesh(
        torch.eye(4, 3, dtype=torch.float64) * 0.9, torch.tensor([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    )

    def row(count: int) -> TriangleMesh:
        shift = torch.arange(count, dtype=torch.float64)[:, None, None] * torch.tensor([1.0, 0.0, 0.0])
        verts = (tetrahedron.verts[None] + shift).reshape(-1, 3)
        return TriangleMesh(verts, (tetrahedron.faces[None] + 4 * torch.arange(count)[:, None, None]).reshape(-1, 3))

    assert neighbour_offsets(row(300), row(300).verts).pairs > 299
    assert neighbour_offsets(row(1500), row(1500).verts).pairs == 0


# The benchmark's PLY files.


def test_a_mesh_comes_back_bit_for_bit() -> None:
    mesh = geodesic_sphere(3)
    back = read_ply(write_ply(mesh))
    assert torch.equal(back.verts, mesh.verts)
    assert torch.equal(back.faces, mesh.faces)


@each_case("cut", [-1, 40, 0])
def test_a_file_that_is_not_whole_is_refused(cut: int) -> None:
    with pytest.raises(AssetFormatError):
        read_ply(write_ply(geodesic_sphere(1))[:cut])


# The benchmark's sources are what their table says, and its suites are whole.


SINGLE = [name for name in SOURCES if name != "toy"]


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


@each_case("name", SINGLE)
def test_sources_of_one_piece_do_not_cut_themselves_and_have_the_genus_they_should(name: str) -> None:
    mesh = source_mesh(name)
    euler = len(mesh.verts) - len(edges_of(mesh.faces).edges) + len(mesh.faces)
    assert euler == (0 if name == "torus" else 2)
    assert not intersecting_faces(mesh.verts.numpy(), mesh.faces.numpy()).any()


def test_the_toy_is_of_seven_parts_that_hang_together() -> None:
    mesh = source_mesh("toy")
    part = connected_components(mesh.faces, len(mesh.verts)).numpy()
    cut = intersecting_faces(mesh.verts.numpy(), mesh.faces.numpy())
    assert len(set(part)) == 7
    assert set(part[mesh.faces.numpy()[cut]].ravel()) == set(part)


@each_case("frequency", [1, 2, 5])
def test_a_geodesic_sphere_has_20_n_squared_faces_and_the_volume_of_a_ball_in_the_limit(frequency: int) -> None:
    mesh = geodesic_sphere(frequency)
    assert len(mesh.faces) == 20 * frequency**2
    assert len(mesh.verts) == 10 * frequency**2 + 2
    assert torch.allclose(mesh.verts.norm(dim=1), torch.ones(len(mesh.verts), dtype=torch.float64))
    assert volume(geodesic_sphere(20)) == pytest.approx(4 / 3 * torch.pi, rel=0.01)


def test_a_relaxed_surface_lies_on_its_solid() -> None:
    def ball(points: torch.Tensor) -> torch.Tensor:
        return points.norm(dim=1) - 0.7

    mesh = relaxed_surface(ball, 3, rounds=5)
    assert torch.allclose(mesh.verts.norm(dim=1), torch.full((len(mesh.verts),), 0.7, dtype=torch.float64), atol=1e-6)


def test_a_capsule_is_negative_inside_and_its_radius_goes_from_one_to_the_other() -> None:
    limb = capsule((0, 0, 0), (0, 2, 0), 0.5, 0.1)
    points = torch.tensor([[0, 0, 0], [0.5, 0, 0], [0.3, 1, 0], [0.1, 2, 0], [0, 3, 0]], dtype=torch.float64)
    assert limb(points).tolist() == pytest.approx([-0.5, 0, 0, 0, 0.9])


def test_the_hash_tells_meshes_apart_and_not_rounding() -> None:
    mesh = geodesic_sphere(2)
    assert mesh_sha256(mesh) == mesh_sha256(TriangleMesh(mesh.verts + 1e-14, mesh.faces))
    assert mesh_sha256(mesh) != mesh_sha256(TriangleMesh(mesh.verts * 1.001, mesh.faces))


_COUNTS = [("small", 48), ("turned", 48), ("full", 192), ("nouns", 149), ("unseen", 40), ("seen", 40), ("paper", 48)]


@each_case(("name", "count"), _COUNTS)
def test_a_suite_is_every_source_by_every_prompt_by_every_seed(name: str, count: int) -> None:
    suite = SUITES[name]
    items = suite.items()
    assert len(items) == len(set(items)) == len({item.name for item in items}) == count
    assert set(suite.sources) <= set(SOURCES)


@each_case("name", ["small", "full"])
def test_the_builtin_prior_understands_each_prompt_and_no_two_are_of_one_noun(name: str) -> None:
    nouns = [parse(prompt).noun for prompt in SUITES[name].prompts]
    assert len(nouns) == len(set(nouns)) == 12


@each_case(("name", "held_out"), [("unseen", True), ("seen", False)])
def test_the_training_showed_either_none_of_the_pairs_or_all(name: str, held_out: bool) -> None:
    for prompt in map(parse, SUITES[name].prompts):
        assert [is_held_out(prompt.noun, attribute) for attribute in prompt.attributes] == [held_out]


def test_each_item_of_turned_has_its_own_angle_and_other_suites_have_none() -> None:
    small, turned = SUITES["small"], SUITES["turned"]
    assert turned.items() == small.items()
    angles = [turned.turn_of(item) for item in turned.items()]
    assert len(set(angles)) == 48
    assert all(sum(90 * k <= angle < 90 * (k + 1) for angle in angles) >= 6 for k in range(4))
    assert {small.turn_of(item) for item in small.items()} == {0.0}


def test_seeds_can_be_replaced_and_unknown_suites_are_refused() -> None:
    assert {item.seed for item in SUITES["small"].with_seeds((3, 4)).items()} == {3, 4}
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


def test_a_mesh_of_ones_own_takes_the_place_of_the_sources(tmp_path: Path) -> None:
    path = tmp_path / "my cow.glb"
    mesh = box(2)
    path.write_bytes(build_glb(mesh.verts.numpy(), mesh.faces.numpy()))
    suite = find_suite("small").with_sources((str(path),))
    assert {item.source for item in suite.items()} == {str(path)}
    assert suite.items()[0].name.startswith("my cow--")
    read = source_mesh(str(path))
    assert len(read.faces) == len(mesh.faces)
    with pytest.raises(ParameterError, match="called 'my cow'"):
        suite.with_sources((str(path), str(tmp_path / "other" / "my cow.obj")))
