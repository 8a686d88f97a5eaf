"""What the guidance sees of an asset's colours, and that its gradients are those of the picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.geometry.appearance import Appearance, Paint, Texture
from meshdeform.geometry.srgb import linear_from_srgb
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from tests.cases import each_case
from tests.close import assert_close

F64 = torch.float64
SQUARE = torch.tensor([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=F64)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UVS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
FRONT = fixed_cameras(0.0, 0.0, 20.0, views=1)
NOISE = np.random.default_rng(0).integers(0, 256, (6, 6, 4), np.uint8)
NOISE[..., 3] = 255
LIT = 0.25 + 0.75 * 0.7 / 1.01**0.5
"""Light on what faces the camera."""
BLUE = (0.1, 0.2, 0.6)


def appearance(texture: np.ndarray | None = NOISE, copies: int = 1, **paint: object) -> Appearance:
    """Return the look of `copies` squares, the first of which has the texture, and the others none."""
    first = Paint((1.0, 1.0, 1.0, 1.0), None if texture is None else Texture(texture, ("clamp", "clamp")))
    count = 4 * copies
    return Appearance(
        np.arange(count),
        np.concatenate([FACES + 4 * k for k in range(copies)]),
        np.tile(UVS, (copies, 1)),
        np.ones((count, 4), np.float32),
        np.repeat(np.minimum(np.arange(copies), 1), 2),
        (replace(first, **paint), Paint((0.8, 0.1, 0.1, 1.0))),  # type: ignore[arg-type]
    )


def renderer(look: Appearance, size: int = 24, supersample: int = 1) -> Renderer:
    faces = torch.from_numpy(look.rows[look.triangles])
    style = RenderStyle(size, supersample, shading="textured", background=BLUE)
    return Renderer(faces, int(look.rows.max()) + 1, style, appearance=look, dtype=F64)


def linear(look: Appearance, verts: Tensor, size: int = 24) -> Tensor:
    return linear_from_srgb(renderer(look, size).render(verts, FRONT)[0], torch)


def test_colours_are_lit_like_clay_in_linear_light() -> None:
    quarters = np.full((8, 8, 4), 255, np.uint8)
    quarters[:4, :4, :3], quarters[4:, 4:, :3] = (255, 0, 0), (0, 188, 0)
    look = appearance(quarters, factor=(0.5, 1.0, 1.0, 1.0))
    look = replace(look, colors=np.tile(np.array([[1, 0.25, 1, 1]], np.float32), (4, 1)))
    found = linear(look, 0.7 * SQUARE)
    assert found[8, 8].tolist() == pytest.approx([0.5 * LIT, 0, 0], abs=1e-4)
    assert found[8, 15].tolist() == pytest.approx([0.5 * LIT, 0.25 * LIT, LIT], abs=1e-4)
    half = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert found[15, 15].tolist() == pytest.approx([0, 0.25 * half * LIT, 0], abs=1e-4)
    # What is not covered keeps its colour exactly.
    assert renderer(look).render(0.7 * SQUARE, FRONT)[0, 0, 0].tolist() == pytest.approx(list(BLUE), abs=1e-6)


@each_case("size", [1.4, 0.7], ids=["inside", "silhouettes"])
def test_gradients_are_those_of_the_picture(size: float) -> None:
    """Every coordinate's derivative against finite differences: texture, light, perspective, and edges."""
    look = appearance()
    turn = torch.linalg.matrix_exp(torch.tensor([[0, -0.3, 0.4], [0.3, 0, -0.2], [-0.4, 0.2, 0]], dtype=F64))
    verts = (size * SQUARE @ turn.T + torch.tensor([0.013, -0.027, 0.1], dtype=F64)).requires_grad_()
    weights = torch.rand(24, 24, 3, generator=torch.Generator().manual_seed(1), dtype=F64)
    picture = renderer(look)

    def value(v: Tensor) -> Tensor:
        return (picture.render(v, FRONT)[0] * weights).sum()

    (analytic,) = torch.autograd.grad(value(verts), verts)
    h, numeric = 1e-6, torch.zeros(4, 3, dtype=F64)
    with torch.no_grad():
        for at in np.ndindex(4, 3):
            step = torch.zeros(4, 3, dtype=F64)
            step[at] = h
            numeric[at] = (value(verts + step) - value(verts - step)) / (2 * h)
    assert_close(analytic, numeric, rtol=1e-4, atol=1e-4 * float(numeric.abs().max()))


def test_the_edge_of_a_cut_out_moves_with_its_texture() -> None:
    """The area that is left, and its derivative, of a square larger than the view whose left half is cut out."""
    half = np.full((8, 8, 4), 255, np.uint8)
    half[:, :4, 3] = 0
    look = appearance(half, alpha_mode="MASK")
    size, scale = 40, 20 / (np.tan(np.radians(10)) * 1.05 / np.sin(np.radians(10)))  # pixels per unit at z = 0
    style = RenderStyle(size, 1, shading="textured")
    picture = Renderer(torch.from_numpy(look.triangles), 4, style, appearance=look, dtype=F64)

    def area(verts: Tensor) -> Tensor:
        return linear_from_srgb(picture.render(verts, FRONT)[0], torch)[..., 0].sum() / LIT

    # Twice as high as wide, so that a texel is no square of pixels.
    verts = (torch.tensor([1.5, 3.0, 0], dtype=F64) * SQUARE + torch.tensor([0.011, 0, 0])).requires_grad_()
    left = area(verts)
    assert left.item() == pytest.approx((size / 2 - 0.011 * scale) * size, rel=1e-4)
    (gradient,) = torch.autograd.grad(left, verts)
    expected = -scale * size
    assert float(gradient[:, 0].sum()) == pytest.approx(expected, rel=1e-4)
    step = torch.tensor([1e-4, 0, 0], dtype=F64)
    with torch.no_grad():
        numeric = (area(verts + step) - area(verts - step)) / 2e-4
    assert float(numeric) == pytest.approx(expected, rel=1e-4)


def test_what_is_cut_away_neither_shows_nor_separates() -> None:
    """A card that is cut out everywhere, in front of a textured square, has no effect and no gradient."""
    empty = np.zeros((4, 4, 4), np.uint8)
    look = appearance(empty, copies=2, alpha_mode="MASK")
    look = replace(look, paints=(look.paints[0], Paint((1.0, 1.0, 1.0, 1.0), Texture(NOISE, ("clamp", "clamp")))))
    alone = appearance()
    back = 0.7 * SQUARE
    verts = torch.cat([0.4 * SQUARE + torch.tensor([0.01, 0.02, 0.3], dtype=F64), back]).requires_grad_()
    picture = renderer(look).render(verts, FRONT)
    assert_close(picture.detach(), renderer(alone).render(back, FRONT))
    (gradient,) = torch.autograd.grad(picture.square().sum(), verts)
    assert not gradient[:4].any()
    assert gradient[4:].any()
    half = np.full((8, 8, 4), 255, np.uint8)
    half[:, :4, 3] = 0
    for cutoff in (0.0, 0.1, 1.0):
        look = appearance(half, alpha_mode="MASK", alpha_cutoff=cutoff)
        kept = (renderer(look).render(back, FRONT)[0, 12] - torch.tensor(BLUE)).abs().amax(-1) > 1e-6
        assert [bool(kept[6]), bool(kept[17])] == [cutoff == 0, True]


def test_glass_shows_what_is_behind_it() -> None:
    look = appearance(None, copies=2, factor=(0.0, 1.0, 0.0, 0.25), alpha_mode="BLEND")
    verts = torch.cat([0.4 * SQUARE + torch.tensor([0, 0, 0.3], dtype=F64), 0.7 * SQUARE])
    found = linear(look, verts)
    assert found[12, 12].tolist() == pytest.approx([0.75 * 0.8 * LIT, (0.25 + 0.075) * LIT, 0.075 * LIT], abs=1e-4)


def test_mixed_draws_follow_the_seed_and_colourless_assets_are_clay() -> None:
    look = appearance()
    style = RenderStyle(16, 1, shading="mixed")
    mixed = Renderer(torch.from_numpy(look.triangles), 4, style, appearance=look)
    first, second = (torch.Generator().manual_seed(3) for _ in range(2))
    draws = [mixed.sample_shading(first) for _ in range(40)]
    assert [mixed.sample_shading(second) for _ in range(40)] == draws
    assert 10 < draws.count("textured") < 30
    assert set(draws) == {"textured", "lambert"}
    clay = Renderer(torch.from_numpy(look.triangles), 4, style)
    generator = torch.Generator().manual_seed(3)
    before = generator.get_state()
    assert clay.sample_shading(generator) == clay.shading == "lambert"
    assert torch.equal(generator.get_state(), before)


def test_only_colours_make_an_asset_coloured() -> None:
    grey, red = (0.5, 0.5, 0.5, 1.0), (0.5, 0.1, 0.1, 1.0)
    flat = np.full((2, 2, 4), 150, np.uint8)

    def coloured(*paints: Paint, colors: float = 1.0) -> bool:
        look = appearance(copies=2)
        tint = np.ones((8, 4), np.float32)
        tint[3, :3] = colors
        return replace(look, paints=paints, colors=tint).coloured

    assert not coloured(Paint(grey), Paint(grey))
    assert not coloured(Paint((1.0, 1.0, 1.0, 1.0), Texture(flat)), Paint((1.0, 1.0, 1.0, 1.0), Texture(flat)))
    assert coloured(Paint(red), Paint(red))
    assert coloured(Paint(grey), Paint((0.1, 0.1, 0.1, 1.0)))
    assert coloured(Paint(grey), Paint(grey, Texture(NOISE)))
    assert coloured(Paint(grey), Paint(grey), colors=0.2)
