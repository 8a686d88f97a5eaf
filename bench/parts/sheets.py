"""Draw assets in grey, and beside it with the parts that were found in colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.rasterizer import rasterize

SIDE = 250
_AZIMUTHS = (35.0, 35.0, 215.0)
_GREY = (205, 205, 205)
_PAINTS = (
    (220, 50, 50), (60, 110, 230), (245, 190, 40), (40, 160, 70), (150, 70, 190), (30, 180, 190), (245, 130, 40),
    (235, 110, 180), (120, 80, 40), (130, 200, 60), (30, 50, 120), (110, 110, 110), (180, 160, 240), (90, 20, 50),
    (0, 90, 60), (250, 160, 140), (170, 170, 20), (90, 60, 160), (200, 0, 120), (110, 170, 170), (60, 40, 20),
)  # fmt: skip
_LETTERS, _LINE = 12, 14


def drawn(
    verts: NDArray[np.float64], faces: NDArray[np.int64], parts: Mapping[str, NDArray[np.bool_]], title: str
) -> Image.Image:
    """Draw a mesh that faces +Z; `parts`: mapping of str to (F,) bool, of which `body` stays grey."""
    paint, names = np.zeros(len(faces), np.int64), [name for name in parts if name != "body"]
    for number, name in enumerate(names):
        paint[parts[name]] = 1 + number % len(_PAINTS)
    views = _views(verts, faces, np.array([_GREY, *_PAINTS], float), paint)
    image = Image.new("RGB", (len(views) * SIDE, SIDE + _LINE), "white")
    for place, view in enumerate(views):
        image.paste(view, (place * SIDE, _LINE))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(_LETTERS)
    draw.text((2, 0), title, "black", font)
    for number, name in enumerate(names):
        draw.text((SIDE + 2, _LINE * (1 + number)), name, _PAINTS[number % len(_PAINTS)], font)
    return image


def _views(
    verts: NDArray[np.float64], faces: NDArray[np.int64], paints: NDArray[np.float64], paint: NDArray[np.int64]
) -> list[Image.Image]:
    """Return a picture from each azimuth, the first in grey."""
    centred = torch.tensor(verts - (verts.min(0) + verts.max(0)) / 2)
    cameras = fixed_cameras(_AZIMUTHS, 18.0, fitting_radius=0.93 * float(centred.norm(dim=1).max()))
    matrices = cameras.view_proj.double()
    clip = centred @ matrices[:, :, :3].mT + matrices[:, None, :, 3]
    ids = rasterize(clip.float(), torch.tensor(faces), 2 * SIDE, 2 * SIDE).face_ids.numpy()
    a, b, c = verts[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    images = []
    for view, back in enumerate(cameras.view.double().numpy()[:, :3, :3]):
        light = 0.5 + 0.5 * np.abs(normals @ (back.T @ np.array([0.25, 0.5, 0.83])))
        colours = paints[paint if view else np.zeros_like(paint)] * light[:, None]
        shown = np.where(ids[view][..., None] >= 0, colours[ids[view]], 255.0)
        images.append(Image.fromarray(shown.clip(0, 255).astype(np.uint8)).resize((SIDE, SIDE), Image.Resampling.BOX))
    return images


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
