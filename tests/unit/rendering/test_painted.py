"""Pictures show the colours and the normals of the file: known pixels of generated assets."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from meshdeform.assets import load_asset
from meshdeform.geometry.appearance import Appearance, Paint, plain_appearance
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.studio import PaintedRenderer, PaintedStyle, Pose, preview_png
from tests.unit.assets.builders import Builder

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
    positions, normals = (torch.from_numpy(a) for a in (loaded.surface.positions, loaded.surface.normals))
    picture = renderer.render(positions, normals, fixed_cameras(0.0, 0.0, 20.0, views=1))[0]
    return (picture * 255).round().byte().numpy(), appearance.left_out


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


def test_both_backends_find_the_next_layer() -> None:
    from meshdeform.rendering.rasterizer import rasterize_compiled, rasterize_spans

    corners = torch.from_numpy(np.concatenate([SQUARE, SQUARE * 0.5 + [0, 0, 0.3], SQUARE + [0.2, 0, 0.6]])).float()
    clip = torch.cat([corners, torch.ones(12, 1)], 1)[None]
    faces = torch.from_numpy(np.concatenate([FACES, FACES + 4, FACES + 8]).astype(np.int64))
    for backend in (rasterize_compiled, rasterize_spans):
        layers, behind = [], None
        for _ in range(4):
            found, depth = backend(clip, faces, 32, 32, behind)
            layers.append(
                [int(found[0, 16, column]) // 2 if found[0, 16, column] >= 0 else -1 for column in (5, 16, 29)]
            )
            behind = depth
        assert layers == [[0, 0, 2], [-1, 1, -1], [-1, 2, -1], [-1, -1, -1]]


def test_the_back_of_a_single_sided_material_is_invisible() -> None:
    for double, seen in ((True, (0, 255, 0)), (False, (255, 0, 255))):
        builder = Builder()
        builder.node(builder.mesh({**builder.primitive(SQUARE, FACES[:, ::-1].copy()), "material": 0}))
        look = {"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}, "doubleSided": double}
        builder.root["materials"] = [{**look, "extensions": {"KHR_materials_unlit": {}}}]
        assert quarters(drawn(builder.glb())[0]) == [seen] * 4


def test_what_cannot_be_drawn_is_grey_and_counted() -> None:
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


def test_large_textures_are_reduced() -> None:
    large = np.zeros((64, 4096, 3), np.uint8)
    large[:, 2048:] = 255
    found = load_asset(textured(encoded(large))).appearance().paints[0].texture
    assert found is not None
    assert found.pixels.shape == (16, 1024, 4)
    assert tuple(found.pixels[0, 0]) == (0, 0, 0, 255)
    assert tuple(found.pixels[0, -1]) == (255, 255, 255, 255)


def test_the_picture_has_gradients_in_the_positions() -> None:
    """Moving a textured square to the right lowers the difference from its picture further right."""
    asset = load_asset(textured(encoded(QUARTERS)))
    surface = asset.surface
    renderer = PaintedRenderer(asset.appearance(), PaintedStyle(32, 1, (0.0, 0.0, 0.0)))
    normals, cameras = torch.from_numpy(surface.normals), fixed_cameras(0.0, 0.0, 20.0, views=1)
    positions = torch.from_numpy(surface.positions).requires_grad_()
    wanted = renderer.render(positions.detach() + torch.tensor([0.05, 0, 0]), normals, cameras)
    loss = (renderer.render(positions, normals, cameras) - wanted).square().mean()
    loss.backward()  # type: ignore[no-untyped-call]
    assert positions.grad is not None
    assert positions.grad.isfinite().all()
    assert positions.grad[:, 0].sum() < 0


@pytest.mark.as_shipped
def test_a_preview_shows_both_states_at_one_scale() -> None:
    faces = FACES.astype(np.int64)
    small, large = (Pose(SQUARE * s, np.tile([0.0, 0.0, 1.0], (4, 1))) for s in (0.5, 1.0))
    look = plain_appearance(4, faces)
    red = Appearance(look.rows, faces, look.texcoords, look.colors, look.paint_of_triangle, (Paint((1, 0, 0, 1)),))
    image = np.asarray(Image.open(io.BytesIO(preview_png(red, small, large)))).astype(int)
    assert image.shape == (512, 1024, 3)
    reds = (image[..., 0] - image[..., 1]) > 60
    areas = [reds[row : row + 256, column : column + 256].sum() for row in (0, 256) for column in (0, 256, 512, 768)]
    assert min(areas) > 100
    for before, after in zip(areas[:4], areas[4:], strict=True):
        assert after / before == pytest.approx(4, rel=0.15)
