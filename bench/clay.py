"""Fit a sphere to the nouns, which moulds it, and draw the results on sheets.

``python -m bench.clay FOLDER [NOUN ...]`` prints for each noun the CPU seconds and the faces that turned over and that
newly cut others; it writes sheets of 20 pictures without titles, and the nouns of each sheet in order.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from bench.label_sheets import picture, sheet
from meshdeform.exemplar.engine import ExemplarFit
from meshdeform.exemplar.shapes import Wish
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors.builtin.vocabulary import NOUNS

_LEVEL = 5
"""Of 20,480 faces."""
_PER_SHEET = 20


def main(folder: Path, nouns: Sequence[str]) -> None:
    """Mould, measure and draw."""
    folder.mkdir(parents=True, exist_ok=True)
    ball = icosphere(_LEVEL)
    verts, faces = ball.verts.numpy(), ball.faces.numpy()
    pictures: list[Image.Image] = []
    for noun in nouns:
        start = time.process_time()
        run = ExemplarFit(verts, faces, None, Wish(noun))
        out = [stage.verts for stage in run][-1]
        assert out is not None
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
    main(Path(sys.argv[1]), sys.argv[2:] or list(NOUNS))
