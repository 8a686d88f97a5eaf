"""Draw assets in grey, and beside it with the parts that were found in colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.visibility import nearest_faces

SIDE = 250
_AZIMUTHS = (35.0, 35.0, 215.0)
_GREY = (205, 205, 205)
PAINTS = (
    (220, 50, 50), (60, 110, 230), (245, 190, 40), (40, 160, 70), (150, 70, 190), (30, 180, 190), (245, 130, 40),
    (235, 110, 180), (120, 80, 40), (130, 200, 60), (30, 50, 120), (110, 110, 110), (180, 160, 240), (90, 20, 50),
    (0, 90, 60), (250, 160, 140), (170, 170, 20), (90, 60, 160), (200, 0, 120), (110, 170, 170), (60, 40, 20),
)  # fmt: skip
_LETTERS, _LINE = 12, 14


def drawn(
    verts: NDArray[np.float64], faces: NDArray[np.int64], parts: Mapping[str, NDArray[np.bool_]], title: str
) -> Image.Image:
    """Draw a mesh that faces +Z; `parts`: mapping of str to (F,) bool, of which `body` stays grey."""
    names, grey = [name for name in parts if name != "body"], np.tile(np.array(_GREY, float), (len(faces), 1))
    colours = painted(len(faces), parts)
    views = [
        shaded(verts, faces, colours if number else grey, azimuth, SIDE) for number, azimuth in enumerate(_AZIMUTHS)
    ]
    image = Image.new("RGB", (len(views) * SIDE, SIDE + _LINE), "white")
    for place, view in enumerate(views):
        image.paste(view, (place * SIDE, _LINE))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(_LETTERS)
    draw.text((2, 0), title, "black", font)
    for number, name in enumerate(names):
        draw.text((SIDE + 2, _LINE * (1 + number)), name, PAINTS[number % len(PAINTS)], font)
    return image


def painted(faces: int, parts: Mapping[str, NDArray[np.bool_]]) -> NDArray[np.float64]:
    """Return colours (F, 3), 0 to 255: `PAINTS` of the parts in their order, `body` and the rest grey."""
    colours = np.tile(np.array(_GREY, float), (faces, 1))
    for number, name in enumerate(name for name in parts if name != "body"):
        colours[parts[name]] = PAINTS[number % len(PAINTS)]
    return colours


def shaded(
    verts: NDArray[np.float64], faces: NDArray[np.int64], colours: NDArray[np.float64], azimuth: float, side: int
) -> Image.Image:
    """Draw a mesh from one side, `side` pixels square, twice as fine at first; `colours` (F, 3): 0 to 255."""
    centred = verts - (verts.min(0) + verts.max(0)) / 2
    cameras = fixed_cameras((azimuth,), 18.0, fitting_radius=float(np.linalg.norm(centred, axis=1).max()))
    ids = nearest_faces(cameras.project(centred.astype(np.float32)), faces, 2 * side, 2 * side)[0][0]
    a, b, c = verts[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    back = cameras.view[0, :3, :3]
    light = 0.5 + 0.5 * np.abs(normals @ (back.T @ np.array([0.25, 0.5, 0.83])))
    shown = np.where(ids[..., None] >= 0, (colours * light[:, None])[ids], 255.0)
    return Image.fromarray(shown.clip(0, 255).astype(np.uint8)).resize((side, side), Image.Resampling.BOX)


def write_sheets(images: Sequence[Image.Image], folder: Path, columns: int = 2, rows: int = 6) -> list[Path]:
    """Write pictures into a folder, side by side, so many on a sheet; return the sheets."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for first in range(0, len(images), columns * rows):
        shown = images[first : first + columns * rows]
        whole = Image.new("RGB", (columns * shown[0].width, -(-len(shown) // columns) * shown[0].height), "white")
        for number, image in enumerate(shown):
            whole.paste(image, (number % columns * image.width, number // columns * image.height))
        paths.append(folder / f"parts-{first // (columns * rows):02}.png")
        whole.save(paths[-1])
    return paths
