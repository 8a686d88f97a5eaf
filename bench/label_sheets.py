"""Draw meshes coloured by the parts of their faces, with the names of the colours; sheets of such pictures.

``python -m bench.label_sheets FOLDER [NOUN ...]`` draws members of the families, two of each noun, and one for each
pose that the noun has.
"""

from __future__ import annotations

import colorsys
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.forms import drawn
from meshdeform.nouns.labels import LabelledMember, labelled_member
from meshdeform.nouns.poses import POSES, posed
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.visibility import nearest_faces
from meshdeform.vocabulary.solids import PART_NAMES

SIDE = 190
AZIMUTHS = (35.0, 215.0)
_FIXED = {
    "body": (200, 200, 200), "leg": (70, 120, 230), "head": (240, 200, 60), "ear": (220, 50, 50),
    "tail": (150, 70, 190), "wheel": (60, 60, 60), "wing": (60, 190, 200), "arm": (60, 190, 200),
    "neck": (250, 150, 50), "foot": (30, 60, 150), "hand": (20, 120, 110), "nose": (150, 90, 30),
}  # fmt: skip


def colour(name: str) -> tuple[int, int, int]:
    """Return the colour of a part, always the same for a name."""
    if name not in _FIXED:
        number = sum((place + 3) * ord(letter) for place, letter in enumerate(name))
        red, green, blue = colorsys.hsv_to_rgb(
            number * 0.381966 % 1, 0.55 + 0.1 * (number % 4), 0.95 - 0.1 * (number % 3)
        )
        return int(255 * red), int(255 * green), int(255 * blue)
    return _FIXED[name]


def picture(
    verts: NDArray[np.float64], faces: NDArray[np.int64], labels: Sequence[str], title: str = "", room: float = 0.93
) -> Image.Image:
    """Draw a mesh from two sides; `labels` (F,) are names of parts; `room`: share of its radius shown."""
    centred = verts - (verts.min(0) + verts.max(0)) / 2
    radius = float(np.linalg.norm(centred, axis=1).max())
    cameras = fixed_cameras(AZIMUTHS, 18.0, fitting_radius=room * radius)
    ids, _ = nearest_faces(cameras.project(centred.astype(np.float32)), faces, 2 * SIDE, 2 * SIDE)
    a, b, c = verts[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    names, of_face = np.unique(np.asarray(labels), return_inverse=True)
    paint = np.array([colour(str(name)) for name in names], float)[of_face]
    image = Image.new("RGB", (2 * SIDE, SIDE), "white")
    for view, back in enumerate(cameras.view[:, :3, :3]):
        light = 0.55 + 0.45 * np.abs(normals @ (back.T @ np.array([0.25, 0.5, 0.83])))
        shown = np.where(ids[view][..., None] >= 0, (paint * light[:, None])[ids[view]], 255.0)
        half = Image.fromarray(shown.clip(0, 255).astype(np.uint8)).resize((SIDE, SIDE), Image.Resampling.BOX)
        image.paste(half, (view * SIDE, 0))
    draw = ImageDraw.Draw(image)
    draw.text((2, 0), title, "black")
    for row, name in enumerate(names):
        draw.text((2, SIDE - 11 * (len(names) - row)), str(name), tuple(int(0.75 * part) for part in colour(str(name))))
    return image


def sheet(images: Sequence[Image.Image], columns: int = 4) -> Image.Image:
    """Return pictures side by side, row by row."""
    rows = -(-len(images) // columns)
    whole = Image.new("RGB", (columns * images[0].width, rows * images[0].height), "white")
    for number, image in enumerate(images):
        whole.paste(image, (number % columns * image.width, number // columns * image.height))
    return whole


def member_picture(member: LabelledMember, title: str = "") -> Image.Image:
    """Draw a labelled member."""
    return picture(member.verts, member.faces, np.array(PART_NAMES)[member.labels].tolist(), title or member.noun)


def main(folder: Path, nouns: Sequence[str]) -> None:
    """Write sheets of members and of poses into a folder, 24 pictures each."""
    folder.mkdir(parents=True, exist_ok=True)
    images = [
        member_picture(labelled_member(noun, (), np.random.default_rng(seed)), f"{noun} {seed}")
        for noun in nouns
        for seed in (1, 4)
    ]
    images += [
        member_picture(
            posed(drawn(form, (), np.random.default_rng(1)), pose, np.random.default_rng(1)), f"{form} {pose}"
        )
        for form, poses in POSES.items()
        for pose in poses
        if form in nouns or form not in FAMILIES
    ]
    for first in range(0, len(images), 24):
        sheet(images[first : first + 24]).save(folder / f"members-{first // 24:02}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or list(FAMILIES))
