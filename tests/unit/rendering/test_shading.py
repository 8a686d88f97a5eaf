"""Shading: known colours, upright and not mirrored, gradients against finite differences."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from meshdeform.assets import load_asset
from meshdeform.errors import ShapeError
from meshdeform.geometry.appearance import Appearance, Paint
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.painted import PaintedRenderer, PaintedStyle
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.rendering.studio import SurfaceState, preview_png
from meshdeform.rendering.views import combine_views
from tests.cases import each_case
from tests.close import assert_close
from tests.fakes import plain_appearance
from tests.unit.assets.builders import Builder
from training.evaluation.relaxed import geodesic_sphere
from training.shapes import box, grid


def test_a_square_that_faces_the_camera_has_the_colour_of_its_normal() -> None:
    mesh = grid(2)
    renderer = Renderer(faces_of(mesh), 9, RenderStyle(view_size=32, supersample=1))
    images = renderer.render(verts_of(mesh), fixed_cameras(0.0, 0.0))
    assert_close(images[0, 16, 16], torch.tensor([0.5, 0.5, 1.0]), atol=1e-5, rtol=0)
    # From behind, the other side of the surface faces the camera just as well.
    assert_close(images[2, 16, 16], torch.tensor([0.5, 0.5, 1.0]), atol=1e-5, rtol=0)
    assert torch.equal(images[0, 0, 0], torch.zeros(3))


@each_case("shading", ["normals", "lambert"])
def test_pictures_are_upright_and_not_mirrored(shading) -> None:
    """A ball up on +Y is above, one on +X is on the right of the front view."""
    ball = icosphere(2, 0.15)
    for offset, rows, columns in (
        ([0.0, 0.6, 0.0], slice(0, 32), slice(16, 48)),
        ([0.6, 0.0, 0.0], slice(16, 48), slice(32, 64)),
    ):
        verts = verts_of(ball) + torch.tensor(offset, dtype=torch.float64)
        renderer = Renderer(faces_of(ball), verts.shape[0], RenderStyle(view_size=64, shading=shading))
        front = renderer.render(verts, fixed_cameras(0.0, 0.0))[0].sum(-1)
        inside = front[rows, columns].sum().item()
        assert inside > 1
        assert inside == pytest.approx(front.sum().item())


def test_normals_point_right_and_up_and_light_comes_from_the_upper_left() -> None:
    mesh, front = icosphere(4, 0.8), fixed_cameras(0.0, 0.0)
    image = Renderer(faces_of(mesh), len(mesh.verts), RenderStyle()).render(verts_of(mesh), front)[0]
    assert image[32, 50, 0] > 0.7 > 0.3 > image[32, 14, 0]
    assert image[14, 32, 1] > 0.7 > 0.3 > image[50, 32, 1]
    style = RenderStyle(view_size=64, shading="lambert", background=(1.0, 1.0, 1.0))
    images = Renderer(faces_of(mesh), len(mesh.verts), style).render(verts_of(mesh), front)
    assert (images[:, 22, 24, 0] > images[:, 42, 40, 0] + 0.2).all()
    assert torch.equal(images[0, 0, 0], torch.ones(3))


@each_case("shading", ["normals", "lambert"])
def test_gradients_agree_with_finite_differences(shading) -> None:
    """Directional derivatives of a weighted picture along smooth deformations, against a finer picture."""
    mesh = icosphere(3, 0.7)
    weights = torch.rand(4, 8, 8, 3, generator=torch.Generator().manual_seed(0))
    cameras = fixed_cameras(25.0, 12.0)
    v = verts_of(mesh)
    directions = [
        torch.stack([v[:, 0], 0 * v[:, 0], 0 * v[:, 0]], 1),
        torch.stack([0 * v[:, 0], torch.sin(3 * v[:, 0]), 0 * v[:, 0]], 1),
        torch.stack([v[:, 1] ** 2, v[:, 2], -v[:, 0]], 1),
    ]

    def value(verts: Tensor, size: int) -> Tensor:
        style = RenderStyle(view_size=size, supersample=2, shading=shading)
        image = Renderer(faces_of(mesh), v.shape[0], style).render(verts, cameras)
        pooled = torch.nn.functional.adaptive_avg_pool2d(image.permute(0, 3, 1, 2), 8).permute(0, 2, 3, 1)
        return (pooled * weights).sum()

    verts = v.clone().requires_grad_()
    value(verts, 64).backward()
    assert verts.grad is not None
    analytic = torch.stack([(verts.grad * d).sum() for d in directions])
    h = 0.005
    with torch.no_grad():
        numeric = torch.stack([(value(v + h * d, 512) - value(v - h * d, 512)).double() / (2 * h) for d in directions])
    assert (analytic - numeric).norm() < 0.08 * numeric.norm()


def test_shading_alone_is_exact() -> None:
    """With a silhouette outside of the picture only the shading is left, and there the derivative is exact."""
    side = grid(6, 6.0)
    bent = verts_of(side).clone()
    bent[:, 2] = 0.2 * torch.sin(2 * bent[:, 0]) * torch.cos(bent[:, 1])
    renderer = Renderer(faces_of(side), len(side.verts), RenderStyle(view_size=16, supersample=1, shading="lambert"))
    cameras = fixed_cameras(0.0, 0.0, views=1)
    direction = torch.zeros_like(bent)
    direction[:, 2] = torch.cos(bent[:, 0])

    def value(verts: Tensor) -> Tensor:
        return renderer.render(verts, cameras)[0, 4:12, 4:12, 0].double().sum()

    verts = bent.clone().requires_grad_()
    value(verts).backward()
    assert verts.grad is not None
    h = 1e-3
    numeric = (value(bent + h * direction) - value(bent - h * direction)) / (2 * h)
    assert (verts.grad * direction).sum().item() == pytest.approx(numeric.item(), rel=0.02, abs=1e-3)


def with_slivers(mesh: TriangleMesh, height: float) -> TriangleMesh:
    """The same shape with a face of nearly no area beside every sixth one, whose first edge is split in two.

    `height` is that of the sliver, as a share of the face that it was cut from.
    """
    a, b, c = mesh.faces[::6].T
    middle = (mesh.verts[a] + mesh.verts[b]) / 2
    middle = middle + height * (mesh.verts[c] - middle)
    m = len(mesh.verts) + np.arange(len(a))
    kept = np.arange(len(mesh.faces)) % 6 != 0
    pieces = [np.stack(corners, 1) for corners in ([a, m, c], [m, b, c], [a, b, m])]
    return TriangleMesh(np.concatenate([mesh.verts, middle]), np.concatenate([mesh.faces[kept], *pieces]))


@each_case("shading", ["normals", "lambert"])
@each_case("height", [0.0, 1e-6, 1e-5])
def test_pixels_on_slivers_do_not_drown_the_gradient(shading, height: float) -> None:
    """They show what they showed, and the gradient of the picture stays of the order of the plain sphere's."""
    plain = geodesic_sphere(10)
    weights = torch.rand(4, 64, 64, 3, generator=torch.Generator().manual_seed(0))

    def drawn(mesh: TriangleMesh, azimuth: float) -> tuple[Tensor, Tensor]:
        leaf = (0.8 * verts_of(mesh)).requires_grad_()
        image = Renderer(faces_of(mesh), len(leaf), RenderStyle(shading=shading)).render(
            leaf, fixed_cameras(azimuth, 12.0)
        )
        (image * weights).sum().backward()
        assert leaf.grad is not None
        return image.detach(), leaf.grad

    split = with_slivers(plain, height)
    for azimuth in (25.0, 60.0, 100.0):
        (image, grad), (image_of_split, grad_of_split) = drawn(plain, azimuth), drawn(split, azimuth)
        assert (image_of_split - image).abs().mean() < 0.02
        assert 0.5 * grad.norm() < grad_of_split.norm() < 1.5 * grad.norm()
        assert grad_of_split.norm(dim=1).max() < 1.5 * grad.norm(dim=1).max()


@each_case("shading", ["normals", "lambert"])
def test_pixels_on_faces_whose_area_rounds_to_zero_are_drawn(shading) -> None:
    """Snapped to the grid of the rasteriser such a face has an area, in clip space none to divide by."""
    mesh = with_slivers(geodesic_sphere(40), 0.0)
    renderer = Renderer(faces_of(mesh), len(mesh.verts), RenderStyle(shading=shading))
    leaf = (0.8 * verts_of(mesh)).requires_grad_()
    image = renderer.render(leaf, fixed_cameras(25.0, 12.0))
    image.square().sum().backward()
    assert torch.isfinite(image).all()
    assert leaf.grad is not None
    assert torch.isfinite(leaf.grad).all()


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ShapeError):
        Renderer(torch.tensor([[0, 1, 2]]), 3, RenderStyle()).render(torch.zeros(4, 3), fixed_cameras(0.0, 0.0))
    with pytest.raises(ShapeError):
        combine_views(torch.zeros(3, 2, 2, 3))


def _ribbon(height: float) -> TriangleMesh:
    """Two faces of length 1 and this height, in a square, on a row of pixel centres of a front view of 32 pixels."""
    distance = float(np.linalg.norm(fixed_cameras(0.0, 0.0).eye[0]))
    y = distance * float(torch.tan(torch.deg2rad(torch.tensor(37.5 / 2)))) / 32
    rows = [-0.5, y - height / 2, y + height / 2, 0.5]
    verts = np.array([[x, row, 0.0] for row in rows for x in (-0.5, 0.5)])
    faces = [[2 * r + a, 2 * r + b, 2 * r + c] for r in range(3) for a, b, c in ((0, 1, 2), (1, 3, 2))]
    return TriangleMesh(verts, np.array(faces))


@each_case("shading", ["normals", "lambert"])
def test_a_needle_that_fills_a_row_of_pixels_does_not_drown_the_rest(shading) -> None:
    """Its normal turns by 1 / height: without a limit, the thinnest needle that a pixel's centre can fall on pulls 45
    times as hard as a face that is a fiftieth as high as long."""
    largest = []
    for height in (0.02, 5e-4):
        mesh = _ribbon(height)
        renderer = Renderer(faces_of(mesh), len(mesh.verts), RenderStyle(view_size=32, supersample=1, shading=shading))
        verts = verts_of(mesh).clone().requires_grad_()
        front = renderer.render(verts, fixed_cameras(0.0, 0.0))[0]
        weights = torch.rand(front.shape, generator=torch.Generator().manual_seed(0))
        (front * weights).sum().backward()
        assert verts.grad is not None
        largest.append(float(verts.grad[2:6].abs().max()))
    assert 0.5 * largest[0] < largest[1] < 1.5 * largest[0]


@each_case("shading", ["normals", "lambert"])
def test_several_threads_draw_the_same_bits(shading, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = join(icosphere(4, 0.6), box(3))
    renderer = Renderer(faces_of(mesh), len(mesh.verts), RenderStyle(shading=shading))
    drawn = []
    for threads in (1, 2, 3):
        monkeypatch.setattr("meshdeform.support.threads._chosen", threads)
        verts = verts_of(mesh).clone().requires_grad_()
        image = renderer.render(verts, fixed_cameras(20.0, 10.0))
        image.square().sum().backward()
        assert verts.grad is not None
        drawn.append((image.detach(), verts.grad))
    for image, gradient in drawn[1:]:
        assert torch.equal(image, drawn[0][0])
        assert torch.equal(gradient, drawn[0][1])


# Pictures show the colours and the normals of the file: known pixels of generated assets.


SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * 0.7
UPWARDS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # the picture fills the square
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint16)
RED, GREEN, BLUE, YELLOW = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)
QUARTERS = np.array([[RED, GREEN], [BLUE, YELLOW]], np.uint8).repeat(8, 0).repeat(8, 1)


def encoded(pixels: Any, kind: str = "PNG") -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(out, kind, lossless=True)
    return out.getvalue()


def textured(
    image: bytes,
    *,
    uvs: Any = UPWARDS,
    sampler: Any = None,
    info: Any = None,
    material: Any = None,
    verts: Any = SQUARE,
    faces: Any = FACES,
    **more: Any,
) -> bytes:
    """Return an unlit square that faces +Z, or other faces, with a texture."""
    builder = Builder()
    builder.node(builder.mesh({**builder.primitive(verts, faces, TEXCOORD_0=uvs, **more), "material": 0}))
    builder.root["images"] = [{"bufferView": builder.view(image), "mimeType": "image/png"}]
    builder.root["samplers"] = [sampler or {}]
    builder.root["textures"] = [{"source": 0, "sampler": 0}]
    look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **(info or {})}}}
    builder.root["materials"] = [{**look, "extensions": {"KHR_materials_unlit": {}}, **(material or {})}]
    return builder.glb()


def drawn(asset: bytes, size: int = 64) -> Any:
    """Return the picture from the front, (size, size, 3), and what was left out."""
    loaded = load_asset(asset)
    appearance = loaded.appearance()
    renderer = PaintedRenderer(appearance, PaintedStyle(size, 1, (1.0, 0.0, 1.0)))
    cameras = fixed_cameras(0.0, 0.0, 20.0, views=1)
    picture = renderer.render(loaded.surface.positions, loaded.surface.normals, cameras)[0]
    return np.rint(picture * 255).astype(np.uint8), appearance.left_out


def quarters(picture: Any) -> list[tuple[int, ...]]:
    """Return the colours of the square's four quarters: above left, above right, below left, below right."""
    return [tuple(int(v) for v in picture[row, column]) for row in (20, 43) for column in (20, 43)]


def test_a_texture_is_drawn_as_the_file_places_it() -> None:
    png, half = encoded(QUARTERS), UPWARDS * 0.5
    upright = [RED, GREEN, BLUE, YELLOW]
    assert quarters(drawn(textured(png))[0]) == upright
    assert quarters(drawn(textured(encoded(QUARTERS, "WEBP")))[0]) == upright
    # Outside 0..1 every wrap mode shows something else: u and v of 1..2.
    mirrored = {"wrapS": 33648, "wrapT": 33648}
    clamped = {"wrapS": 33071, "wrapT": 33071}
    assert quarters(drawn(textured(png, uvs=UPWARDS + 1))[0]) == upright
    assert quarters(drawn(textured(png, uvs=UPWARDS + 1, sampler=mirrored))[0]) == upright[::-1]
    assert quarters(drawn(textured(png, uvs=UPWARDS + 1, sampler=clamped))[0]) == [YELLOW] * 4

    def moved(**transform: Any) -> dict[str, Any]:
        return {"extensions": {"KHR_texture_transform": transform}}

    assert quarters(drawn(textured(png, uvs=half, info=moved(scale=[2, 2])))[0]) == upright
    assert quarters(drawn(textured(png, uvs=half, info=moved(offset=[0.5, 0])))[0]) == [GREEN] * 4
    # A quarter turn counter-clockwise of the coordinates about the upper left corner: the same turn as in three.js.
    turned = textured(png, info=moved(rotation=np.pi / 2, offset=[0, 1]))
    assert quarters(drawn(turned)[0]) == [BLUE, RED, YELLOW, GREEN]


def test_factors_and_vertex_colours_multiply_the_texture() -> None:
    white = encoded(np.full((2, 2, 3), 255))
    shading = {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 1, 1, 1]}
    half = 188  # 0.5 in sRGB
    plain = textured(white, material={"pbrMetallicRoughness": shading})
    assert quarters(drawn(plain)[0]) == [(half, 255, 255)] * 4
    colors = np.tile(np.array([[0, 0.5, 1]], np.float32), (4, 1))
    both = textured(white, material={"pbrMetallicRoughness": shading}, COLOR_0=colors)
    assert quarters(drawn(both)[0]) == [(0, half, 255)] * 4


def test_cut_outs_and_glass_show_what_is_behind() -> None:
    """A square in front of a green one: its left half is cut out, then all of it is a half transparent red."""
    pixels = np.zeros((16, 16, 4), np.uint8)
    pixels[:, :, 0], pixels[:, 8:, 3] = 255, 255

    def behind(mode: str, image: Any) -> list[tuple[int, ...]]:
        builder = Builder()
        front = {**builder.primitive(SQUARE, FACES, TEXCOORD_0=UPWARDS), "material": 0}
        back = {**builder.primitive(SQUARE - [0, 0, 0.2], FACES), "material": 1}
        builder.node(builder.mesh(front, back))
        builder.root["images"] = [{"bufferView": builder.view(encoded(image)), "mimeType": "image/png"}]
        builder.root["textures"] = [{"source": 0}]
        unlit = {"extensions": {"KHR_materials_unlit": {}}}
        builder.root["materials"] = [
            {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, **unlit},
            {"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}, **unlit},
        ]
        return quarters(drawn(builder.glb())[0])

    assert behind("MASK", pixels) == [GREEN, RED, GREEN, RED]
    assert behind("OPAQUE", pixels) == [RED] * 4
    pixels[:, :, 3] = 128
    (mixed, *_) = behind("BLEND", pixels)
    assert mixed == pytest.approx((188, 188, 0), abs=2)  # half of each, in linear light


def test_hard_edges_are_hard_and_soft_ones_are_soft() -> None:
    """Draw a roof of two faces: two flat colours with split normals or without normals, a gradient with shared ones."""
    roof = np.array([[-0.8, -0.6, -0.4], [0, -0.6, 0], [0, 0.6, 0], [-0.8, 0.6, -0.4]], np.float32)
    other = roof * [-1, 1, 1]
    left, right = np.array([-0.447, 0, 0.894], np.float32), np.array([0.447, 0, 0.894], np.float32)

    def columns(**attributes: Any) -> int:
        builder = Builder()
        faces = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]], np.uint16)
        builder.node(builder.mesh(builder.primitive(np.concatenate([roof, other]), faces, **attributes)))
        picture = drawn(builder.glb())[0]
        return len(np.unique(picture[32, 14:50], axis=0))

    split = np.concatenate([np.tile(left, (4, 1)), np.tile(right, (4, 1))])
    soft = split.copy()
    soft[[1, 2, 5, 6]] = [0, 0, 1]
    assert columns(NORMAL=split) == 2
    assert columns() == 2
    assert columns(NORMAL=soft) > 8


def test_all_backends_find_the_next_layer() -> None:
    from meshdeform.rendering.rasterizer import rasterize_compiled, rasterize_spans
    from meshdeform.rendering.visibility import nearest_faces

    corners = torch.from_numpy(np.concatenate([SQUARE, SQUARE * 0.5 + [0, 0, 0.3], SQUARE + [0.2, 0, 0.6]])).float()
    clip = torch.cat([corners, torch.ones(12, 1)], 1)[None]
    faces = torch.from_numpy(np.concatenate([FACES, FACES + 4, FACES + 8]).astype(np.int64))

    def arrays(clip, faces, height, width, behind):
        return nearest_faces(clip.numpy(), faces.numpy(), height, width, behind)

    for backend in (rasterize_compiled, rasterize_spans, arrays):
        layers, behind = [], None
        for _ in range(4):
            found, depth = backend(clip, faces, 32, 32, behind)
            layers.append(
                [int(found[0, 16, column]) // 2 if found[0, 16, column] >= 0 else -1 for column in (5, 16, 29)]
            )
            behind = depth
        assert layers == [[0, 0, 2], [-1, 1, -1], [-1, 2, -1], [-1, -1, -1]]


def test_what_cannot_be_drawn_is_grey_and_counted_or_reduced_or_left_out() -> None:
    grey = [(150, 150, 150)] * 4
    broken = encoded(QUARTERS)[:40]
    for image, what in (
        (b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(64), "KTX2 texture"),
        (broken, "unreadable png image"),
        (b"no picture at all", "other image"),
    ):
        picture, left_out = drawn(textured(image))
        assert quarters(picture) == grey
        assert left_out == {what: 1}
    picture, left_out = drawn(textured(encoded(QUARTERS), uvs=UPWARDS[:3]))
    assert left_out == {"invalid TEXCOORD_0": 1, "missing texture coordinates": 1}
    large = np.zeros((64, 4096, 3), np.uint8)
    large[:, 2048:] = 255
    found = load_asset(textured(encoded(large))).appearance().paints[0].texture
    assert found is not None
    assert found.pixels.shape == (16, 1024, 4)
    assert found.pixels[0, [0, -1]].tolist() == [[0, 0, 0, 255], [255] * 4]
    # The back of a single-sided material is invisible.
    for double, seen in ((True, GREEN), (False, (255, 0, 255))):
        look = {"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}, "doubleSided": double}
        back = textured(encoded(QUARTERS), material=look, faces=FACES[:, ::-1].copy())
        assert quarters(drawn(back)[0]) == [seen] * 4


@pytest.mark.as_shipped
def test_a_preview_shows_both_states_at_one_scale() -> None:
    faces = FACES.astype(np.int64)
    small, large = (SurfaceState(SQUARE * s, np.tile([0.0, 0.0, 1.0], (4, 1))) for s in (0.5, 1.0))
    look = plain_appearance(4, faces)
    red = Appearance(look.rows, faces, look.texcoords, look.colors, look.paint_of_triangle, (Paint((1, 0, 0, 1)),))
    image = np.asarray(Image.open(io.BytesIO(preview_png(red, small, large)))).astype(int)
    assert image.shape == (512, 1024, 3)
    reds = (image[..., 0] - image[..., 1]) > 60
    areas = [reds[row : row + 256, column : column + 256].sum() for row in (0, 256) for column in (0, 256, 512, 768)]
    assert min(areas) > 100
    for before, after in zip(areas[:4], areas[4:], strict=True):
        assert after / before == pytest.approx(4, rel=0.15)
