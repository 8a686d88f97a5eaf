"""Draw what is of no family, so that the network learns to be unsure of it (Hendrycks et al. 2019, outlier exposure).

Half of the drawings are solids of several families, put together anyhow; half are figures of ovals, boxes and curves,
as other things that people draw consist of. None of them means anything.
"""

from __future__ import annotations

import numpy as np

from meshdeform.kinds.sketch.families import FAMILIES
from meshdeform.kinds.sketch.solids import Floats, Solid
from training.sketch.habits import random_view
from training.sketch.lines import joined, visible_lines


def stranger_lines(random: np.random.Generator) -> list[Floats]:
    """Return the lines of a drawing that shows nothing known, as `visible_lines` does."""
    return _assembly(random) if random.random() < 0.5 else _figure(random)


def _assembly(random: np.random.Generator) -> list[Floats]:
    """Return the lines of three to eight solids of any families, each turned and stretched, anywhere."""
    solids: dict[str, Solid] = {}
    for number in range(random.integers(3, 9)):
        family = FAMILIES[str(random.choice(list(FAMILIES)))]
        members = list(family.solids(family.draw(random)).values())
        solid = members[random.integers(len(members))]
        centred = (solid.verts - solid.verts.mean(0)) / np.ptp(solid.verts, axis=0).max()
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        if random.random() < 0.5:  # things mostly stand and lie
            turn = np.eye(3)[random.permutation(3)]
        turn *= np.sign(np.linalg.det(turn))
        placed = (centred * random.uniform(0.4, 1.2, 3)) @ turn.T + random.normal(0, 0.3, 3)
        solids[f"part_{number}"] = Solid(placed, solid.faces)
    return visible_lines(joined(solids), random_view(random))


def _figure(random: np.random.Generator) -> list[Floats]:
    """Return two to nine ovals, boxes, polygons and curves, some with their mirror image."""
    lines: list[Floats] = []
    for _ in range(random.integers(2, 10)):
        middle, size = random.uniform(0.25, 0.75, 2), random.uniform(0.03, 0.3, 2)
        kind = random.random()
        if kind < 0.3:
            angle = np.linspace(0, 2 * np.pi, 33)
            size = size if random.random() < 0.5 else size[:1].repeat(2)
            line = np.stack([np.cos(angle), np.sin(angle)], 1) * size
        elif kind < 0.45:
            line = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * size
        elif kind < 0.75:
            line = random.uniform(-1, 1, (random.integers(2, 6), 2)) * size
            line = np.concatenate([line, line[:1]]) if random.random() < 0.5 else line
        else:
            angle = np.linspace(0, random.uniform(1, 6), 25)
            waves = random.normal(0, 0.5, (2, 3))
            line = np.stack([angle / 3 - 1, np.sin(angle[:, None] * [1, 2, 3]) @ waves[0]], 1) * size
            turn = random.uniform(0, 2 * np.pi)
            line = line @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        line = line + middle
        lines.append(line)
        if random.random() < 0.3:
            lines.append(line * [-1, 1] + [1, 0])
    return lines
