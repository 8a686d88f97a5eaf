"""Draw animals with flat fins."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, ellipsoid, join, limb, moved, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["dolphin", "fish", "shark"]


def dolphin(rng: Rng, traits: Traits) -> Part:
    """Draw a leaping dolphin: an arched smooth body, a round brow over a beak, a curved back fin, level flukes."""
    fins = traits.draw(rng, "fins", (0.1, 0.14), (0.34, 0.42), (0.72, 0.85))
    nose = traits.draw(rng, "nose", (0.0, 0.03), (0.26, 0.33), (0.7, 0.85))
    girth, arch = rng.uniform(0.26, 0.34), rng.uniform(0.35, 0.55)
    along = np.array([0.62, 0.35, 0.0, -0.4, -0.75, -1.05])
    spine = np.stack([np.zeros(6), -arch * along**2, along], 1)
    parts = [limb(spine, girth * np.array([0.75, 0.95, 1.0, 0.78, 0.45, 0.26]), segments=20)]
    brow = spine[0] + [0, -0.06, 0.1]
    down = np.array([0.0, -1.1 * arch, 1.0]) / np.hypot(1.1 * arch, 1.0)
    parts.append(limb([brow, brow + (girth * 0.6 + nose) * down], [[0.12, 0.14], [0.075, 0.09]], segments=12))
    hook = fins * np.array([(0.5, 0.0), (0.0, 0.75), (-0.45, 1.0), (-0.25, 0.5), (-0.35, 0.0)])
    parts.append(moved(plate(hook, 0.11, across="x"), [0, girth * 0.8, -0.08]))
    fluke = plate(
        [(-0.06, 0.12), (0.3, 0.05), (0.52, -0.2), (0.5, -0.3), (0.2, -0.2), (-0.06, -0.18)], 0.11, across="y"
    )
    parts += pair(moved(turned(fluke, 2 * 45 * arch, "x"), spine[-1] + [0, 0, -0.05]))
    paddle = plate(fins * np.array([(0.0, 0.3), (0.6, 0.0), (0.95, -0.55), (0.5, -0.5), (0.0, -0.3)]), 0.11, across="y")
    return join([*parts, *pair(moved(turned(paddle, -28, "z"), [girth * 0.65, -girth * 0.55, 0.3]))])


def fish(rng: Rng, traits: Traits) -> Part:
    """Draw a fish: a round-bellied body, a flat forked tail, a flat back fin and belly fin, two side fins, eyes."""
    fins = traits.draw(rng, "fins", (0.08, 0.12), (0.28, 0.36), (0.62, 0.75))
    tail = traits.draw(rng, "tail", (0.14, 0.19), (0.4, 0.5), (0.85, 1.0))
    length, height = rng.uniform(0.66, 0.86), rng.uniform(0.4, 0.52)
    parts = [ellipsoid([0, 0, 0], [rng.uniform(0.25, 0.35), height, length])]
    root = -length * 0.85
    fork = np.array([(0.0, 0.12), (-0.55, 0.8), (-0.95, 0.95), (-0.8, 0.4), (-0.7, 0.0)])
    fork = np.concatenate([fork, (fork * [1, -1])[-2::-1]]) * tail
    stem = limb([[0, 0, root + 0.2], [0, 0, root - 0.12 - 0.1 * tail]], [[0.14, 0.1], [0.11, 0.07]], segments=10)
    parts += [stem, moved(plate(fork, 0.11, across="x"), [0, 0, root])]
    spread = 0.75 + 0.25 * fins
    back = [(0.34 * spread, -0.12), (0.1, 0.75 * fins), (-0.35 * spread, fins), (-0.5 * spread, -0.12)]
    parts.append(moved(plate(back, 0.11, across="x"), [0, height * 0.9, 0.0]))
    belly = [(0.14, 0.12), (-0.12, -0.8 * fins), (-0.42 * spread, -0.75 * fins), (-0.3 * spread, 0.12)]
    parts.append(moved(plate(belly, 0.11, across="x"), [0, -height * 0.88, -0.1]))
    side = plate(
        [(0.1, 0.1), (-0.5 * fins, 0.45 * fins), (-fins, 0.0), (-0.6 * fins, -0.45 * fins), (0.1, -0.1)],
        0.11,
        across="x",
    )
    parts += pair(moved(turned(side, -38, "y"), [0.24, -height * 0.22, length * 0.25]))
    return join([*parts, *pair(ellipsoid([0.17, height * 0.2, length * 0.66], 0.085, rings=8))])


def shark(rng: Rng, traits: Traits) -> Part:
    """Draw a shark: a pointed body, a tall triangular back fin, level side fins, an upright crescent tail."""
    fins = traits.draw(rng, "fins", (0.12, 0.16), (0.44, 0.54), (0.9, 1.05))
    tail = traits.draw(rng, "tail", (0.16, 0.22), (0.52, 0.62), (1.0, 1.15))
    girth, length = rng.uniform(0.26, 0.34), rng.uniform(0.9, 1.15)
    spine = np.stack(
        [np.zeros(6), [0.04, 0.0, 0.0, 0.0, 0.03, 0.06], np.array([0.95, 0.55, 0.1, -0.4, -0.8, -1.05]) * length], 1
    )
    parts = [limb(spine, girth * np.array([0.22, 0.75, 1.0, 0.85, 0.42, 0.28]), segments=20)]
    end = spine[-1] + [0, 0, 0.04]
    parts.append(
        moved(
            plate(
                tail * np.array([(0.3, -0.1), (-0.1, 0.55), (-0.55, 1.15), (-0.65, 1.05), (-0.4, 0.3), (-0.2, -0.12)]),
                0.11,
                across="x",
            ),
            end,
        )
    )
    parts.append(
        moved(
            plate(
                tail * np.array([(0.3, 0.1), (-0.1, -0.4), (-0.4, -0.75), (-0.5, -0.65), (-0.3, -0.2), (-0.2, 0.1)]),
                0.11,
                across="x",
            ),
            end,
        )
    )
    hook = fins * np.array([(0.55, 0.0), (0.0, 0.75), (-0.35, 1.05), (-0.3, 0.5), (-0.3, 0.0)])
    parts.append(moved(plate(hook, 0.12, across="x"), [0, girth * 0.75, 0.0]))
    blade = fins * np.array([(0.0, 0.35), (0.6, 0.0), (1.1, -0.55), (0.95, -0.65), (0.4, -0.4), (0.0, -0.3)])
    parts += pair(moved(turned(plate(blade, 0.11, across="y"), -18, "z"), [girth * 0.6, -girth * 0.45, length * 0.35]))
    rear = 0.45 * fins * np.array([(0.5, 0.0), (-0.3, 0.9), (-0.4, 0.0)])
    parts += [moved(plate(rear, 0.1, across="x"), [0, girth * 0.4, -length * 0.62])]
    return join([*parts, *pair(ellipsoid([girth * 0.5, 0.06, length * 0.68], 0.07, rings=8))])
