"""Build the solids of which blueprints consist: wheels, rods, side views given a width, cabins, wings, hulls.

Lengths are in the family's own unit; (z, y) are the coordinates of a side view, ahead and up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Array, Part, box, extrude, lathe, limb, plate, turned

__all__ = ["arc", "bar", "block", "cabin", "drum", "hull", "shaped", "shell", "side", "spoked", "wheel", "wing"]


def block(centre: ArrayLike, size: ArrayLike, round_by: float = 0.12) -> Part:
    """Return a box of few faces."""
    return box(centre, size, round_by=round_by, cells=3)


def bar(radii: ArrayLike, path: ArrayLike) -> Part:
    """Return a thin rod along points (N, 3); one radius, or one at each point."""
    points = np.asarray(path, float)
    return limb(points, np.broadcast_to(np.asarray(radii, float), len(points)), segments=8, samples=1)


def drum(radius: float, half: float, axis: str = "x", segments: int = 16) -> Part:
    """Return a cylinder about an axis, `half` its length, its rims cut off a little."""
    edge = 0.25 * min(radius, half)
    profile = [(radius - edge, -half), (radius, edge - half), (radius, half - edge), (radius - edge, half)]
    solid = lathe(profile, segments=segments)
    return {"x": turned(solid, 90, "z"), "y": solid, "z": turned(solid, 90, "x")}[axis]


def wheel(radius: float, half: float) -> Part:
    """Return a tyre about a sunk rim with a hub, its axle along X."""
    dish = np.array([(0.0, 0.75), (0.22, 0.75), (0.3, 0.45), (0.62, 1.0), (0.86, 1.0), (1.0, 0.55)])
    outer = dish * [radius, half]
    return turned(lathe(np.concatenate([outer * [1, -1], outer[::-1]]), segments=16), 90, "z")


def spoked(radius: float, half: float, spokes: int) -> list[Part]:
    """Return a rim about a thin disc, which leaves no hole, a hub, and spokes right across; the axle along X."""
    outer = np.array([(0.0, 0.2), (0.84, 0.2), (0.85, 1.0), (1.0, 1.0)]) * [radius, half]
    rim = turned(lathe(np.concatenate([outer * [1, -1], outer[::-1]]), segments=22), 90, "z")
    spoke = box([0, 0, 0], [1.3 * half, 1.8 * radius, 0.1 * radius], round_by=0.1, cells=2)
    across = [turned(spoke, k * 180 / spokes, "x") for k in range(spokes)]
    return [rim, drum(0.2 * radius, 1.6 * half, segments=10), *across]


def side(outline: ArrayLike, width: float, bevel: float = 0.06) -> Part:
    """Return a solid whose side view is an outline (N, 2) of (z, y) in either sense, `width` along X."""
    rim = np.asarray(outline, float)
    after = np.roll(rim, -1, axis=0)
    if float((rim[:, 0] * after[:, 1] - rim[:, 1] * after[:, 0]).sum()) < 0:
        rim = rim[::-1]
    return turned(extrude(rim, width, bevel=bevel), -90, "y")


def shaped(part: Part, axis: int, by: float) -> Part:
    """Narrow a solid along X by a share, from none at the middle of the other axis, or at its foot, to `by`."""
    along = part.verts[:, axis]
    low = along.min() if axis == 1 else max(0.0, float(along.min()))
    scale = 1 - by * np.clip((along - low) / (along.max() - low), 0, 1)
    return part._replace(verts=part.verts * np.column_stack([scale, np.ones_like(scale), np.ones_like(scale)]))


def cabin(outline: ArrayLike, width: float, narrow: float, posts: int) -> dict[str, list[Part]]:
    """Return a cabin of a side view (N, 2) that narrows upward, with a roof, posts, and raised windows all around."""
    rim = np.asarray(outline, float)
    low, high = rim.min(0), rim.max(0)
    deep = high[1] - low[1]
    middle = np.array([rim[:, 0].mean(), (low[1] + 2 * high[1]) / 3])
    panes = [side(middle + (rim - middle) * [0.86, 0.68], width + 0.025, 0.02)]
    panes += [side(middle + (rim - middle) * [1.0, 0.7] + [push, 0], 0.82 * width) for push in (-0.02, 0.02)]
    tops = rim[rim[:, 1] > high[1] - 0.06 * deep][:, 0]
    solids = [
        side(rim, width),
        block([0, high[1], tops.mean()], [width + 0.02, 0.1 * deep + 0.02, np.ptp(tops) + 0.06]),
    ]
    for z in np.linspace(low[0], high[0], posts + 2)[1:-1]:
        solids.append(block([0, middle[1], z], [width + 0.035, 0.86 * deep, 0.06]))
    together = {"cabin": solids, "window": panes}
    return {name: [_leaning(each, low[1], deep, narrow) for each in several] for name, several in together.items()}


def _leaning(part: Part, low: float, deep: float, narrow: float) -> Part:
    scale = 1 - narrow * np.clip((part.verts[:, 1:2] - low) / deep, 0, 1)
    return part._replace(verts=part.verts * np.concatenate([scale, np.ones_like(scale), np.ones_like(scale)], 1))


def wing(span: float, chord: float, sweep: float, taper: float, thick: float, rise_deg: float) -> Part:
    """Return the left wing, its root's front edge at the origin; `sweep`: how far its tip is behind."""
    end = chord * taper
    outline = [(-0.02, 0), (0.5 * span, -0.5 * sweep), (0.94 * span, -sweep), (span, -sweep - 0.3 * end)]
    outline += [(span, -sweep - 0.85 * end), (0.94 * span, -sweep - end), (-0.02, -chord)]
    return turned(plate(outline, thick, across="y"), rise_deg, "z")


def hull(long: float, beam: float, depth: float, bow: float, stern: float, sheer: float, keel: float) -> Part:
    """Return a ship's hull with a flat deck at height `depth`, half its length and its beam given.

    `bow` and `stern` say how far it narrows to its ends, `sheer` by how much the ends rise, `keel` how far it narrows
    downward.
    """
    solid = box([0, 0, 0], [2, 2, 2], round_by=0.06, cells=10)
    x, y, z = solid.verts.T
    ahead, behind, up = np.clip(z, 0, 1), np.clip(-z, 0, 1), (y + 1) / 2
    wide = (1 - bow * ahead**2.6) * (1 - stern * behind**3) * (1 - keel * (1 - up) ** 1.5)
    height = depth * up + sheer * (ahead**2 + 0.4 * behind**2) * (0.3 + 0.7 * up)
    return solid._replace(verts=np.column_stack([x * beam * wide, height, (z + 0.12 * ahead * up) * long]))


def shell(long: float, beam: float, depth: float, rise: float, stern: float) -> Part:
    """Return a boat's shell, open above; its ends rise, and it is pointed ahead, and behind unless `stern` is 1."""
    wall = [(0.25, 0.0), (0.7, 0.12), (0.92, 0.5), (1.0, 1.0), (0.93, 1.0), (0.84, 0.5), (0.6, 0.24), (0.2, 0.2)]
    solid = lathe(wall, segments=32)
    x, y, z = solid.verts.T
    power = np.where(z < 0, 1.5 - 1.1 * stern, 1.5)
    across = np.sign(x) * np.abs(np.sin(np.arctan2(x, z))) ** power * np.hypot(x, z)
    along = np.where(z < 0, (1 - 0.2 * stern) * z, z)
    lift = rise * np.abs(along) ** 3 * (0.4 + 0.6 * y)
    return solid._replace(verts=np.column_stack([across * beam, y * depth + lift, along * long]))


def arc(z: float, y: float, radius: float, first_deg: float, last_deg: float) -> Array:
    """Return seven points (7, 2) of an arc about (z, y), 0 degrees ahead and 90 up."""
    angle = np.radians(np.linspace(first_deg, last_deg, 7))
    return np.column_stack([z + radius * np.cos(angle), y + radius * np.sin(angle)])
