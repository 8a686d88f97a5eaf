"""What of its materials an asset is drawn with."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from meshdeform.assets import load_asset
from meshdeform.geometry.appearance import Texture
from tests.unit.assets.builders import QUAD_VERTS, Builder

NEAREST, LINEAR, CLAMP, MIRROR = 9728, 9729, 33071, 33648


def textures_of(*samplers: dict[str, int] | None) -> list[Texture | None]:
    """Return the textures as they are drawn, one for each sampler; None is a texture without one."""
    builder, png = Builder(), io.BytesIO()
    Image.new("RGB", (2, 2), "red").save(png, "png")
    root = builder.root
    root["images"] = [{"bufferView": builder.view(png.getvalue()), "mimeType": "image/png"}]
    root["samplers"] = [sampler for sampler in samplers if sampler is not None]
    root["textures"] = [
        {"source": 0} if sampler is None else {"source": 0, "sampler": root["samplers"].index(sampler)}
        for sampler in samplers
    ]
    root["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}} for number in range(len(samplers))
    ]
    places = np.zeros((len(QUAD_VERTS), 2), np.float32)
    drawn = [builder.primitive(TEXCOORD_0=places) | {"material": number} for number in range(len(samplers))]
    builder.node(builder.mesh(*drawn))
    return [paint.texture for paint in load_asset(builder.glb()).appearance().paints]


def test_a_texture_is_magnified_and_repeated_as_its_sampler_says() -> None:
    plain, squares, smooth = textures_of(
        None, {"magFilter": NEAREST, "wrapS": CLAMP}, {"magFilter": LINEAR, "wrapS": MIRROR, "wrapT": CLAMP}
    )
    assert plain is not None
    assert squares is not None
    assert smooth is not None
    assert (plain.nearest, plain.wrap) == (False, ("repeat", "repeat"))
    assert (squares.nearest, squares.wrap) == (True, ("clamp", "repeat"))
    assert (smooth.nearest, smooth.wrap) == (False, ("mirror", "clamp"))
