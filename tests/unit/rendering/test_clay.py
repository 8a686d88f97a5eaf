"""Clay in numpy: known light and coverage, and the picture of the renderer that is differentiated."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.clay import AMBIENT, LIGHT, ClayRenderer
from tests.cases import each_case
from tests.unit.rendering.test_shading import with_slivers
from training.shapes import box, grid, torus

AROUND = fixed_cameras((20.0, 110.0, -75.0), (-15.0, 10.0, 45.0), 24.0)


def drawn(mesh: TriangleMesh, size: int = 32, supersample: int = 2) -> np.ndarray:
    return ClayRenderer(mesh.faces, size, supersample).render(mesh.verts, AROUND)


def test_light_and_coverage_of_a_square_that_faces_the_camera() -> None:
    """Its edges cut pixels, which are then as bright as the share that is covered."""
    mesh, cameras = grid(3, 0.87), fixed_cameras(0.0, 0.0, 20.0, views=1)
    lit = AMBIENT + (1 - AMBIENT) * LIGHT[2] / np.linalg.norm(LIGHT)
    picture = ClayRenderer(mesh.faces, 33, 1).render(mesh.verts, cameras)[0]
    assert picture[16, 16] == pytest.approx(lit, abs=1e-5)
    assert picture[0, 0] == 0
    pixels = 0.87 * 33 / 2 / (1.05 * np.tan(np.radians(10)) / np.sin(np.radians(10)))
    assert picture.sum() / lit == pytest.approx(pixels**2, rel=1e-2)
    behind = ClayRenderer(mesh.faces[:, ::-1].copy(), 33, 1).render(mesh.verts, cameras)[0]
    np.testing.assert_allclose(behind, picture, atol=1e-6)


def flipped(mesh: TriangleMesh) -> TriangleMesh:
    """The same surface with every fifth face turned over, and one edge with three faces."""
    faces = mesh.faces.copy()
    faces[::5] = faces[::5, ::-1]
    return TriangleMesh(mesh.verts, np.concatenate([faces, [[*mesh.faces[0, :2], mesh.faces[-1, 2]]]]))


def test_faces_and_their_backs_are_in_shade_whatever_rounding_leaves_of_their_normals() -> None:
    ball = icosphere(3, 0.9)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    both = TriangleMesh(ball.verts @ turn, np.concatenate([ball.faces, ball.faces[:, [1, 0, 2]]]))
    picture = drawn(both)
    assert picture.max() == pytest.approx(AMBIENT, abs=1e-6)
    assert (picture > 0.99 * AMBIENT).mean() > 0.3


@each_case(
    "name, mesh",
    [
        ("closed", torus(n=40, m=30)),
        ("coarse", box(2)),
        ("open", TriangleMesh(icosphere(3).verts, icosphere(3).faces[::2].copy())),
        ("behind each other", join(icosphere(3, 0.5), grid(4, 1.2))),
        ("not oriented", flipped(icosphere(3, 0.8))),
        ("faces without area", with_slivers(icosphere(3, 0.8), 0.0)),
    ],
)
def test_it_is_the_picture_of_the_differentiable_renderer(
    name: str, mesh: TriangleMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of vertices at the same places to the last bit, which decides what of two edges at one place is nearer."""
    torch = pytest.importorskip("torch")
    from meshdeform.rendering import shading
    from meshdeform.rendering.shading import Renderer, RenderStyle

    monkeypatch.setattr(shading, "projected", lambda verts, cameras: torch.from_numpy(cameras.project(verts.numpy())))
    renderer = Renderer(torch.from_numpy(mesh.faces), len(mesh.verts), RenderStyle(32, 2, "lambert"))
    expected = renderer.render(torch.from_numpy(mesh.verts), AROUND)[..., 0].numpy()
    assert np.abs(drawn(mesh) - expected).max() < 1e-5, name
    assert expected.max() > 0.5
