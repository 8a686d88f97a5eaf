"""Known answers of the benchmark's measures."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from meshdeform.assets import load_asset
from meshdeform.errors import AssetFormatError, NumericalError, ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import box, grid, join
from tests.cases import each_case
from training.evaluation.measures import chamfer_distance, displacement, measures, surface_points
from training.evaluation.mesh_file import read_ply, write_ply
from training.evaluation.neighbours import neighbour_offsets
from training.evaluation.relaxed import geodesic_sphere


def moved(mesh: TriangleMesh, matrix: list[list[float]] | torch.Tensor, by: float = 0.0) -> TriangleMesh:
    return TriangleMesh(mesh.verts @ torch.as_tensor(matrix, dtype=torch.float64).T + by, mesh.faces)


def test_a_mesh_is_perfect_beside_itself() -> None:
    sphere = geodesic_sphere(4)
    figures = measures(sphere, sphere)
    assert figures["displacement"] == figures["chamfer"] == figures["area_ratio_spread"] == 0
    assert figures["symmetric_dirichlet_mean"] == pytest.approx(1)
    assert figures["volume_ratio"] == pytest.approx(1)
    assert not any(figures[name] for name in ("flipped_faces", "collapsed_faces", "self_intersections_added"))


@each_case("scale", [0.5, 2.0])
def test_a_similarity_distorts_nothing_and_has_the_volume_of_its_scale_cubed(scale: float) -> None:
    c, s = math.cos(0.7), math.sin(0.7)
    turned = moved(geodesic_sphere(4), [[scale * c, 0, scale * s], [0, scale, 0], [-scale * s, 0, scale * c]], 0.3)
    figures = measures(geodesic_sphere(4), turned)
    assert figures["symmetric_dirichlet_mean"] == pytest.approx(1)
    assert figures["symmetric_dirichlet_p99"] == pytest.approx(1)
    assert figures["area_ratio_spread"] == pytest.approx(0, abs=1e-12)
    assert figures["volume_ratio"] == pytest.approx(scale**3)
    assert figures["area_ratio"] == pytest.approx(scale**2)


def test_a_plane_stretched_to_double_width_has_the_energy_of_singular_values_root_2_and_1_over_root_2() -> None:
    # After the mean area scale: s1 = 2 / sqrt 2, s2 = 1 / sqrt 2, so (2 + 1/2 + 1/2 + 2) / 4.
    figures = measures(grid(4), moved(grid(4), [[2, 0, 0], [0, 1, 0], [0, 0, 1]]))
    assert figures["symmetric_dirichlet_mean"] == pytest.approx(1.25)
    assert figures["min_angle_p1_deg_after"] == pytest.approx(math.degrees(math.atan(0.5)))
    assert figures["volume_ratio"] == 0


def test_a_vertex_pulled_across_its_ring_flips_faces() -> None:
    plane = grid(4)
    verts = plane.verts.clone()
    centre = int((verts.norm(dim=1)).argmin())
    verts[centre, 0] += 0.4
    assert measures(plane, TriangleMesh(verts, plane.faces))["flipped_faces"] > 0


def test_a_vertex_put_onto_its_neighbour_collapses_two_faces() -> None:
    plane = grid(4)
    verts = plane.verts.clone()
    centre = int((verts.norm(dim=1)).argmin())
    neighbour = int(((verts - verts[centre] - torch.tensor([0.25, 0, 0])).norm(dim=1)).argmin())
    verts[centre] = verts[neighbour]
    assert measures(plane, TriangleMesh(verts, plane.faces))["collapsed_faces"] == 2


def test_only_self_intersections_that_were_not_there_are_added() -> None:
    one = geodesic_sphere(2)
    apart = join(one, TriangleMesh(one.verts + torch.tensor([3.0, 0, 0]), one.faces))
    touching = join(one, TriangleMesh(one.verts + torch.tensor([0.9, 0.11, 0.07]), one.faces))
    assert (
        measures(apart, touching)["self_intersections_added"]
        == measures(apart, touching)["self_intersecting_faces_after"]
    )
    assert measures(apart, touching)["self_intersections_added"] > 0
    assert measures(touching, touching)["self_intersecting_faces_before"] > 0
    assert measures(touching, touching)["self_intersections_added"] == 0
    assert measures(touching, apart)["self_intersections_added"] == 0


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


def test_other_programs_read_the_file() -> None:
    mesh = geodesic_sphere(3)
    surface = load_asset(write_ply(mesh), "mesh.ply").surface
    assert len(surface.triangles) == len(mesh.faces)
    assert surface.positions == pytest.approx(mesh.verts.numpy())


@each_case("cut", [-1, 40, 0])
def test_a_file_that_is_not_whole_is_refused(cut: int) -> None:
    with pytest.raises(AssetFormatError):
        read_ply(write_ply(geodesic_sphere(1))[:cut])
