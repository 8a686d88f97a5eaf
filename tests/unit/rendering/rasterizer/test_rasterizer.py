"""The raster step: pixels by hand, both backends alike, watertight, order of faces without influence."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh, edges_of
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.rendering.antialiasing import SilhouetteEdges, antialias
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.interpolation import interpolate, interpolate_torch
from meshdeform.rendering.rasterizer import EMPTY_DEPTH, projected, rasterize, rasterize_compiled, rasterize_spans
from meshdeform.rendering.visibility import interpolated, nearest_faces
from tests.cases import each_case
from tests.close import assert_close
from training.shapes import grid, torus


def rasterize_arrays(
    clip: Tensor, faces: Tensor, height: int, width: int, behind: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Rasterise in numpy, as pictures are drawn."""
    found = nearest_faces(clip.numpy(), faces.numpy(), height, width, None if behind is None else behind.numpy())
    return torch.from_numpy(found[0]), torch.from_numpy(found[1])


BACKENDS = [rasterize_compiled, rasterize_spans, rasterize_arrays]


def to_clip(verts: Tensor, azimuth: float = 20.0) -> Tensor:
    return projected(verts.float(), fixed_cameras(azimuth, 15.0))


def flat(points: list[tuple[float, float, float]]) -> Tensor:
    """Points given in pixels of an 8 x 8 image (x right, y down) and depth, as clip coordinates."""
    rows = [[x / 4 - 1, 1 - y / 4, z, 1.0] for x, y, z in points]
    return torch.tensor([rows])


@each_case("backend", BACKENDS)
def test_a_triangle_covers_the_pixels_that_it_should(backend) -> None:
    clip = flat([(1, 1, 0), (7, 1, 0), (1, 7, 0)])
    ids, depth = backend(clip, torch.tensor([[0, 1, 2]]), 8, 8)
    assert torch.equal(ids, backend(clip, torch.tensor([[0, 2, 1]]), 8, 8)[0])  # both sides are seen
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
def test_neighbours_neither_overlap_nor_leave_gaps(backend) -> None:
    """A tessellated square covers each pixel once: removing any face uncovers exactly its own pixels."""
    mesh = grid(5, 1.8)
    clip = torch.cat([verts_of(mesh).float(), torch.ones(len(mesh.verts), 1)], 1)[None]
    ids, _ = backend(clip, faces_of(mesh), 64, 64)
    covered = int((ids >= 0).sum())
    alone = sum(int((backend(clip, faces_of(mesh)[[f]], 64, 64)[0] >= 0).sum()) for f in range(len(mesh.faces)))
    assert covered == alone
    inner = ids[0, 8:56, 8:56]
    assert (inner >= 0).all()


@each_case("size", [(64, 64), (33, 97), (256, 256)])
def test_the_backends_agree(size: tuple[int, int]) -> None:
    for mesh in (torus(n=71, m=71), icosphere(4)):
        clip = to_clip(verts_of(mesh) * 0.9)
        ids, depth = rasterize_compiled(clip, faces_of(mesh), *size)
        other, other_depth = rasterize_spans(clip, faces_of(mesh), *size)
        assert (ids != other).float().mean() < 1e-3
        assert_close(depth, other_depth, atol=1e-5, rtol=0)


def soup(count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Triangles of all sizes and directions: on half pixels, off the picture, behind the camera, without area."""
    random = np.random.default_rng(seed)
    size = 10.0 ** random.uniform(-3, 0.5, (count, 1, 1))
    corners = random.uniform(-1.2, 1.2, (count, 1, 3)) + size * random.uniform(-1, 1, (count, 3, 3))
    corners[::3, :, :2] = np.rint(corners[::3, :, :2] * 64) / 64
    corners[1::7, 2] = corners[1::7, 1]
    clip = np.concatenate([corners, random.choice([1.0, 0.7, -0.1], (count, 3, 1), p=[0.5, 0.49, 0.01])], -1)
    faces = np.arange(3 * count).reshape(-1, 3)
    return torch.from_numpy(clip.reshape(1, -1, 4)), torch.from_numpy(faces)


@each_case(("count", "at_once"), [(30, 1 << 16), (3000, 1 << 16), (3000, 100)])
def test_numpy_sees_exactly_what_the_compiled_loop_sees(
    count: int, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Layer by layer, whatever is drawn at once."""
    monkeypatch.setattr("meshdeform.rendering.visibility._AT_ONCE", at_once)
    clip, faces = soup(count, 0)
    behind = None
    for _ in range(4):
        ids, depth = rasterize_compiled(clip, faces, 48, 64, behind)
        found, found_depth = rasterize_arrays(clip, faces, 48, 64, behind)
        assert torch.equal(found, ids)
        assert_close(found_depth, depth, atol=2e-7, rtol=0)
        behind = depth


@each_case("backend", BACKENDS)
def test_triangles_behind_the_camera_and_empty_meshes_draw_nothing(backend) -> None:
    clip = torch.tensor([[[0.0, 0, 0, -1], [1, 0, 0, 1], [0, 1, 0, 1]]])
    assert (backend(clip, torch.tensor([[0, 1, 2]]), 8, 8)[0] == -1).all()
    assert (backend(clip, torch.zeros(0, 3, dtype=torch.int64), 8, 8)[0] == -1).all()
    far_away = flat([(1e9, 1e9, 0), (-1e9, 1e9, 0), (0, -1e9, 0)])
    assert (backend(far_away, torch.tensor([[0, 1, 2]]), 8, 8)[0] == 0).all()


def test_wrong_shapes_are_refused() -> None:
    for function in (rasterize, rasterize_arrays):
        with pytest.raises(ShapeError, match="clip"):
            function(torch.zeros(3, 4), torch.zeros(1, 3, dtype=torch.int64), 8, 8)


# Interpolation: linear functions come back, perspective included; gradients checked twice.


SIZE = 24


def scene(subdivisions: int = 1) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    mesh = icosphere(subdivisions, 0.8)
    clip = to_clip(verts_of(mesh))
    ids = rasterize(clip, faces_of(mesh), SIZE, SIZE).face_ids.view(-1)
    pixels = (ids >= 0).nonzero()[:, 0]
    return verts_of(mesh), clip, faces_of(mesh), pixels, ids[pixels]


def test_a_function_that_is_linear_in_space_is_exact() -> None:
    """The clip coordinates themselves, interpolated, project back to the pixel: perspective is right."""
    _, clip, faces, pixels, face = scene()
    found = interpolate(clip, clip, faces, pixels, face, SIZE, SIZE)
    one = (pixels < SIZE * SIZE).numpy()
    arrays = [each.numpy() for each in (clip[0], clip[0].T, faces, pixels[one], face[one])]
    np.testing.assert_allclose(interpolated(*arrays, SIZE, SIZE).T, found[one], rtol=1e-5, atol=1e-6)
    # Exactly, so that a coordinate between two texels does not flicker.
    arrays[1] = np.full((1, clip.shape[1]), 0.1, np.float32)
    assert np.unique(interpolated(*arrays, SIZE, SIZE)).tolist() == [np.float32(0.1)]
    within = pixels % (SIZE * SIZE)
    x = (within % SIZE + 0.5) * 2 / SIZE - 1
    y = 1 - (within // SIZE + 0.5) * 2 / SIZE
    assert_close(found[:, 0] / found[:, 3], x, atol=1e-5, rtol=0)
    assert_close(found[:, 1] / found[:, 3], y, atol=1e-5, rtol=0)


@each_case("subdivisions", [1, 5])
def test_the_backends_agree_in_values_and_gradients(subdivisions: int) -> None:
    """Also on 20,480 faces of few pixels: x - p w cancels, and float32 would leave percents of the gradients."""
    verts, clip, faces, pixels, face = scene(subdivisions)
    values = torch.stack([verts.float().sin()] * 4)
    weights = torch.rand(len(pixels), 3, generator=torch.Generator().manual_seed(0))
    found = []
    for function in (interpolate, interpolate_torch):
        c, v = clip.clone().requires_grad_(), values.clone().requires_grad_()
        out = function(c, v, faces, pixels, face, SIZE, SIZE)
        (out * weights).sum().backward()
        found.append((out, c.grad, v.grad))
    for a, b in zip(*found, strict=True):
        assert float((a - b).detach().abs().max()) < 1e-5 * float(a.detach().abs().max())


def test_gradcheck() -> None:
    verts, clip, faces, pixels, face = scene()
    values = torch.stack([verts.sin()] * 4)
    some = slice(None, None, 37)

    def function(c: Tensor, v: Tensor) -> Tensor:
        return interpolate(c, v, faces, pixels[some], face[some], SIZE, SIZE)

    inputs = (clip.double().requires_grad_(), values.requires_grad_())
    assert torch.autograd.gradcheck(function, inputs, atol=1e-6)


def test_a_face_seen_exactly_edge_on_gives_its_mean_and_pushes_nothing() -> None:
    """Three corners on one line through the pixel's centre: the areas sum to zero in exact arithmetic."""
    clip = torch.tensor([[[-0.5, 0.25, 0.0, 1.0], [0.0, 0.25, 0.5, 1.0], [0.5, 0.25, 0.2, 1.0]]])
    values = torch.tensor([[[3.0], [6.0], [0.0]]])
    pixels, face = torch.tensor([5]), torch.tensor([0])
    for function in (interpolate, interpolate_torch):
        c, v = clip.clone().requires_grad_(), values.clone().requires_grad_()
        out = function(c, v, torch.tensor([[0, 1, 2]]), pixels, face, 4, 4)
        assert_close(out, torch.tensor([[3.0]]))
        corners = np.array([[0, 1, 2]])
        alone = interpolated(clip[0].numpy(), values[0].numpy().T, corners, pixels.numpy(), face.numpy(), 4, 4)
        assert alone == pytest.approx(3.0)
        out.sum().backward()
        assert c.grad is not None
        assert v.grad is not None
        assert torch.equal(c.grad, torch.zeros_like(clip))
        assert_close(v.grad, torch.full_like(values, 1 / 3))


# Silhouette gradients against finite differences of a fine picture, at triangles from coarse to subpixel.


def draw(
    verts: Tensor, faces: Tensor, edges: SilhouetteEdges, size: int, weights: Tensor | None, smooth: bool
) -> Tensor:
    """Mean over the picture of (weighted) coverage."""
    clip = projected(verts, fixed_cameras(13.0, 10.0))
    fragments = rasterize(clip, faces, size, size)
    image = (fragments.face_ids >= 0).float()[..., None]
    if smooth:
        image = antialias(image, clip, edges, fragments.depth)
    if weights is None:
        return image.mean()
    scaled = torch.nn.functional.interpolate(weights, size=(size, size), mode="bilinear", align_corners=False)
    return (image[..., 0] * scaled[:, 0]).mean()


def silhouette_edges(faces: Tensor) -> SilhouetteEdges:
    edges = edges_of(faces.numpy())
    return SilhouetteEdges(torch.from_numpy(edges.edges), torch.from_numpy(edges.opposite))


@each_case(
    ("mesh", "size"), [(icosphere(1), 64), (icosphere(3), 64), (icosphere(5), 64), (icosphere(2), 256), (grid(8), 64)]
)
def test_the_area_of_a_sphere_and_of_an_open_grid_grows_as_it_should(mesh: TriangleMesh, size: int) -> None:
    edges = silhouette_edges(faces_of(mesh))
    verts = verts_of(mesh).float()
    scale = torch.tensor(0.6, requires_grad=True)
    draw(verts * scale, faces_of(mesh), edges, size, None, True).backward()
    with torch.no_grad():
        above = draw(verts * 0.61, faces_of(mesh), edges, 1024, None, False)
        below = draw(verts * 0.59, faces_of(mesh), edges, 1024, None, False)
    assert scale.grad is not None
    assert scale.grad.item() == pytest.approx(((above - below) / 0.02).item(), rel=0.05)


def test_a_torus_moves_and_stretches_as_finite_differences_say() -> None:
    mesh = torus(n=60, m=40)
    edges = silhouette_edges(faces_of(mesh))
    verts = verts_of(mesh).float()
    weights = torch.rand(4, 1, 9, 9, generator=torch.Generator().manual_seed(1))

    def value(p: Tensor, size: int, smooth: bool) -> Tensor:
        return draw(verts * (1 + p[3:]) + p[:3], faces_of(mesh), edges, size, weights, smooth)

    p = torch.zeros(6, requires_grad=True)
    value(p, 128, True).backward()
    differences = []
    for i in range(6):
        e = torch.zeros(6)
        e[i] = 0.02
        with torch.no_grad():
            differences.append(((value(e, 768, False) - value(-e, 768, False)) / 0.04).item())
    expected = torch.tensor(differences)
    assert p.grad is not None
    assert (p.grad - expected).norm() < 0.06 * expected.norm()


def test_hidden_edges_change_nothing() -> None:
    """A small sphere behind a large one leaves the picture as it is, and gets no gradient."""
    front, back = icosphere(3), icosphere(2, 0.2)
    faces = torch.cat([faces_of(front), faces_of(back) + len(front.verts)])
    shift = torch.zeros(3, requires_grad=True)
    cameras = fixed_cameras(0.0, 0.0, views=1)
    verts = torch.cat([verts_of(front).float() * 0.6, verts_of(back).float() + torch.tensor([0.0, 0.0, -0.75]) + shift])
    clip = projected(verts, cameras)
    fragments = rasterize(clip, faces, 64, 64)
    image = antialias((fragments.face_ids >= 0).float()[..., None], clip, silhouette_edges(faces), fragments.depth)
    image.sum().backward()
    assert shift.grad is not None
    assert shift.grad.abs().max() == 0
