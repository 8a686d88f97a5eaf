"""Mould a sphere into members of the nouns, and draw them on sheets.

``python -m bench.clay FOLDER [NOUN ...]`` prints for each noun the CPU seconds and the faces that turned over and that
newly cut others; it writes sheets of 20 pictures without titles, and the nouns of each sheet in order.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bench.label_sheets import picture, sheet
from meshdeform.exemplar.clay import moulded
from meshdeform.exemplar.shapes import Shape
from meshdeform.geometry.quality import measure
from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.labels import labelled_member

_ROWS, _COLUMNS = 72, 144
_PER_SHEET = 20


def ball(rows: int = _ROWS, columns: int = _COLUMNS) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a sphere of rings and columns, of diagonal 1."""
    polar, turn = np.linspace(0, np.pi, rows + 1)[1:-1], np.arange(columns) * 2 * np.pi / columns
    ring = np.stack(np.broadcast_arrays(np.sin(polar)[:, None] * np.sin(turn), np.cos(polar)[:, None],
                                        np.sin(polar)[:, None] * np.cos(turn)), -1)  # fmt: skip
    verts = np.concatenate([[[0.0, 1, 0]], ring.reshape(-1, 3), [[0, -1, 0]]]) / math.sqrt(12)
    side, after = np.arange(columns), (np.arange(columns) + 1) % columns
    faces = [np.stack([np.zeros_like(side), 1 + side, 1 + after], 1)]
    for row in range(rows - 2):
        low, high = 1 + row * columns, 1 + (row + 1) * columns
        faces.append(np.stack([low + side, high + side, high + after], 1))
        faces.append(np.stack([low + side, high + after, low + after], 1))
    last = 1 + (rows - 2) * columns
    faces.append(np.stack([last + side, np.full_like(side, len(verts) - 1), last + after], 1))
    return verts, np.concatenate(faces)


def member_shape(noun: str, seed: int = 1) -> Shape:
    """Draw a member in a box of diagonal 1 about the origin."""
    member = labelled_member(noun, (), np.random.default_rng(seed))
    low, high = member.verts.min(0), member.verts.max(0)
    verts = (member.verts - (low + high) / 2) / np.linalg.norm(high - low)
    return Shape(noun, verts, member.faces, member.labels)


def main(folder: Path, nouns: Sequence[str]) -> None:
    """Mould, measure and draw."""
    folder.mkdir(parents=True, exist_ok=True)
    verts, faces = ball()
    source = Shape("", verts, faces, np.zeros(len(faces), np.int64))
    moulded(source, member_shape("mug"))
    moulded(source, member_shape("apple"))
    pictures: list[Image.Image] = []
    for noun in nouns:
        goal, start = member_shape(noun), time.process_time()
        out = moulded(source, goal)
        seconds = time.process_time() - start
        quality = measure(verts, faces, out)
        cut = quality.self_intersections_added
        print(f"{noun:12} {seconds:5.2f} s  flipped {quality.flipped_faces:4}  cut {cut}", flush=True)
        pictures.append(picture(out, faces, ["body"] * len(faces), room=1.05))
    for first in range(0, len(pictures), _PER_SHEET):
        name = folder / f"clay-{first // _PER_SHEET:02}"
        sheet(pictures[first : first + _PER_SHEET]).save(name.with_suffix(".png"))
        name.with_suffix(".txt").write_text("\n".join(nouns[first : first + _PER_SHEET]) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or list(FAMILIES))
