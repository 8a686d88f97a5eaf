"""The raster step: pixels by hand, both backends alike, watertight, order of faces without influence."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.geometry.shapes import grid, icosphere, torus
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.rasterizer import EMPTY_DEPTH, rasterize, rasterize_compiled, rasterize_spans
from tests.cases import each_case
from tests.close import assert_close

BACKENDS = [rasterize_compiled, rasterize_spans]


def to_clip(verts: Tensor, azimuth: float = 20.0) -> Tensor:
    cameras = fixed_cameras(azimuth, 15.0)
    return verts.float() @ cameras.view_proj[:, :, :3].mT + cameras.view_proj[:, None, :, 3]


def flat(points: list[tuple[float, float, float]]) -> Tensor:
    """Points given in pixels of an 8 x 8 image (x right, y down) and depth, as clip coordinates."""
    rows = [[x / 4 - 1, 1 - y / 4, z, 1.0] for x, y, z in points]
    return torch.tensor([rows])


@each_case("backend", BACKENDS)
def test_a_triangle_covers_the_pixels_that_it_should(backend) -> None:
    clip = flat([(1, 1, 0), (7, 1, 0), (1, 7, 0)])
    ids, depth = backend(clip, torch.tensor([[0, 1, 2]]), 8, 8)
    expected = torch.full((8, 8), -1)
    for row in range(8):
        for column in range(8):
            # On the hypotenuse x + y = 8 the top-left rule gives the pixel away: it is a bottom-right edge.
            if column >= 1 and row >= 1 and (column + 0.5) + (row + 0.5) < 8:
                expected[row, column] = 0
    assert torch.equal(ids[0], expected)
    assert torch.equal(depth[0] == EMPTY_DEPTH, expected == -1)


@each_case("backend", BACKENDS)
def test_the_nearer_triangle_wins_whatever_the_order(backend) -> None:
    near, far = [(0, 0, -0.5), (8, 0, -0.5), (0, 8, -0.5)], [(0, 0, 0.5), (8, 0, 0.5), (0, 8, 0.5)]
    for points, winner in ((near + far, 0), (far + near, 1)):
        ids, _ = backend(flat(points), torch.tensor([[0, 1, 2], [3, 4, 5]]), 8, 8)
        assert set(ids.unique().tolist()) == {-1, winner}


@each_case("backend", BACKENDS)
@each_case("far", [0.99, 1.0, 1.5, 2.9, 3.5])
def test_what_lies_at_or_beyond_the_far_plane_stays_behind(backend, far: float) -> None:
    near = [(0, 0, 0.0), (8, 0, 0.0), (0, 8, 0.0)]
    behind = [(0, 0, far), (8, 0, far), (0, 8, far)]
    faces = torch.tensor([[0, 1, 2], [3, 4, 5]])
    for points, winner in ((near + behind, 0), (behind + near, 1)):
        ids, depth = backend(flat(points), faces, 8, 8)
        assert set(ids.unique().tolist()) == {-1, winner}
        assert float(depth[ids >= 0].abs().max()) < 1e-6
    _, depth = backend(flat(behind), faces[:1], 8, 8)
    assert_close(depth[0, 1, 1], torch.tensor(min(far, EMPTY_DEPTH)))


@each_case("backend", BACKENDS)
def test_both_sides_are_seen(backend) -> None:
    clip = flat([(1, 1, 0), (7, 1, 0), (1, 7, 0)])
    front, _ = backend(clip, torch.tensor([[0, 1, 2]]), 8, 8)
    back, _ = backend(clip, torch.tensor([[0, 2, 1]]), 8, 8)
    assert torch.equal(front, back)


@each_case("backend", BACKENDS)
def test_neighbours_neither_overlap_nor_leave_gaps(backend) -> None:
    """A tessellated square covers each pixel once: removing any face uncovers exactly its own pixels."""
    mesh = grid(5, 1.8)
    clip = torch.cat([mesh.verts.float(), torch.ones(mesh.verts.shape[0], 1)], 1)[None]
    ids, _ = backend(clip, mesh.faces, 64, 64)
    covered = int((ids >= 0).sum())
    alone = sum(int((backend(clip, mesh.faces[[f]], 64, 64)[0] >= 0).sum()) for f in range(len(mesh.faces)))
    assert covered == alone
    inner = ids[0, 8:56, 8:56]
    assert (inner >= 0).all()


@each_case("size", [(64, 64), (33, 97), (256, 256)])
def test_the_backends_agree(size: tuple[int, int]) -> None:
    for mesh in (torus(n=71, m=71), icosphere(4)):
        clip = to_clip(mesh.verts * 0.9)
        ids, depth = rasterize_compiled(clip, mesh.faces, *size)
        other, other_depth = rasterize_spans(clip, mesh.faces, *size)
        assert (ids != other).float().mean() < 1e-3
        assert_close(depth, other_depth, atol=1e-5, rtol=0)


def test_a_fan_of_slivers_is_exact() -> None:
    n = 2000
    angle = torch.arange(n, dtype=torch.float64) / n * 2 * torch.pi
    rim = torch.stack([angle.cos(), angle.sin(), torch.zeros(n)], 1) * 0.9
    verts = torch.cat([torch.zeros(1, 3), rim])
    faces = torch.stack([torch.zeros(n, dtype=torch.int64), 1 + torch.arange(n), 1 + (torch.arange(n) + 1) % n], 1)
    clip = torch.cat([verts.float(), torch.ones(n + 1, 1)], 1)[None]
    ids, _ = rasterize_spans(clip, faces, 128, 128)
    other, _ = rasterize_compiled(clip, faces, 128, 128)
    assert torch.equal(ids >= 0, other >= 0)
    area = (ids >= 0).float().mean() * 4
    assert area.item() == pytest.approx(torch.pi * 0.81, rel=5e-3)


@each_case("backend", BACKENDS)
def test_triangles_behind_the_camera_and_empty_meshes_draw_nothing(backend) -> None:
    clip = torch.tensor([[[0.0, 0, 0, -1], [1, 0, 0, 1], [0, 1, 0, 1]]])
    assert (backend(clip, torch.tensor([[0, 1, 2]]), 8, 8)[0] == -1).all()
    assert (backend(clip, torch.zeros(0, 3, dtype=torch.int64), 8, 8)[0] == -1).all()
    far_away = flat([(1e9, 1e9, 0), (-1e9, 1e9, 0), (0, -1e9, 0)])
    assert (backend(far_away, torch.tensor([[0, 1, 2]]), 8, 8)[0] == 0).all()


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ShapeError, match="clip"):
        rasterize(torch.zeros(3, 4), torch.zeros(1, 3, dtype=torch.int64), 8, 8)
