"""Draw sketches with their guesses beside them: ``python -m bench.sketch_sheet docs/pictures/sketch_guesses.png``.

Each row has a drawing of a random member, drawn as the training draws but from a seed that it does not use, and the
guesses in clay.
"""

from __future__ import annotations

import io
import sys

import numpy as np
import torch
from PIL import Image

from meshdeform.assets import load_asset
from meshdeform.kinds.sketch.families import FAMILIES, member_glb
from meshdeform.kinds.sketch.looking import guess
from meshdeform.rendering.cameras import Frame, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from training.sketch.habits import Habits, drawn_lines
from training.sketch.strokes import draw

SIZE = 220
STYLE = RenderStyle(view_size=SIZE, supersample=2, shading="lambert", background=(1.0, 1.0, 1.0))
SEED = 4001


def clay(glb: bytes) -> Image.Image:
    """Draw a mesh from its front, a little from the side and above."""
    surface = load_asset(glb, "guess.glb").surface
    verts = torch.from_numpy(np.ascontiguousarray(surface.positions, np.float64))
    verts = Frame.around(verts).enter(verts)
    faces = torch.from_numpy(np.ascontiguousarray(surface.triangles, np.int64))
    image = Renderer(faces, len(verts), STYLE).render(verts, fixed_cameras(30.0, 20.0))[0]
    return Image.fromarray((255 * image.numpy()).clip(0, 255).astype(np.uint8))


def main() -> None:
    """Draw the sheet."""
    torch.set_num_threads(1)
    rows = []
    for number, name in enumerate(FAMILIES):
        random = np.random.default_rng([SEED, number])
        family = FAMILIES[name]
        values = family.draw(random)
        choices = {each.name: str(values[each.name]) for each in family.choices}
        drawing = draw(drawn_lines(name, values, Habits.some(name, choices, random)), random, size=SIZE)
        written = io.BytesIO()
        drawing.convert("L").save(written, "PNG")
        found = guess(written.getvalue())
        print(name, values)
        print("  ", *(f"{each.family} {each.probability:.0%}" for each in found), found[0].values)
        cells = [
            drawing.convert("RGB").resize((SIZE, SIZE)),
            *(clay(member_glb(each.family, each.values)) for each in found),
        ]
        rows.append(np.concatenate([np.asarray(cell) for cell in cells], 1))
    Image.fromarray(np.concatenate(rows)).quantize(64).save(sys.argv[1], optimize=True)


if __name__ == "__main__":
    main()
