"""Build what vehicles and machines share: wheels, bars, side views given a width, and the archetypes of what drives.

An archetype returns its solids by the names of their parts, to which a noun adds what it is known by.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Array, Part, box, extrude, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Range, Rng, Traits

__all__ = [
    "Motor", "Solids", "bar", "block", "circle", "drum", "motor", "narrowed", "share", "side", "spoked", "wheel",
    "wheels",
]  # fmt: skip

Solids = dict[str, list[Part]]
Outline = Sequence[tuple[float, float]]

WHEELS = ((0.5, 0.6), (0.95, 1.05), (1.55, 1.8))
"""Radii of small, plain and big wheels, as shares of the usual one."""


def share(rng: Rng, low: float, high: float) -> float:
    """Draw a number between two."""
    return float(rng.uniform(low, high))


def block(centre: ArrayLike, size: ArrayLike, round_by: float = 0.12) -> Part:
    """Return a box of few faces."""
    return box(centre, size, round_by=round_by, cells=3)


def bar(*path: ArrayLike, radius: float | Sequence[float] = 0.05, segments: int = 8) -> Part:
    """Return a rod along points, of one radius or of one at each point."""
    radii = [radius] * len(path) if isinstance(radius, float | int) else radius
    return limb(list(path), radii, segments=segments, samples=1)


def drum(radius: float, half: float, centre: ArrayLike = (0, 0, 0), axis: str = "x", segments: int = 16) -> Part:
    """Return a cylinder about an axis, `half` its length, its rims cut off a little."""
    edge = 0.25 * min(radius, half)
    profile = [(radius - edge, -half), (radius, edge - half), (radius, half - edge), (radius - edge, half)]
    solid = lathe(profile, segments=segments)
    return moved({"x": turned(solid, 90, "z"), "y": solid, "z": turned(solid, 90, "x")}[axis], centre)


def wheel(radius: float, half: float, centre: ArrayLike = (0, 0, 0)) -> Part:
    """Return a tyre about a sunk rim with a hub, its axle along X."""
    tyre = [(0.62 * radius, half), (0.86 * radius, half), (radius, 0.55 * half)]
    dish = [(0.0, 0.75 * half), (0.22 * radius, 0.75 * half), (0.28 * radius, 0.45 * half), (0.55 * radius, 0.5 * half)]
    outer = [*dish, *tyre]
    profile = [*((r, -y) for r, y in outer), *outer[::-1]]
    return moved(turned(lathe(profile, segments=18), 90, "z"), centre)


def wheels(radius: float, half: float, x: float, places: Sequence[float]) -> list[Part]:
    """Return wheels on the ground left and right at places along Z."""
    return [each for z in places for each in pair(wheel(radius, half, [x, radius, z]))]


def spoked(radius: float, half: float, centre: ArrayLike, spokes: int = 4) -> list[Part]:
    """Return a rim about a thin sunk disc, and `spokes` bars across it, the axle along X."""
    outer = [(0.0, 0.2 * half), (0.84 * radius, 0.2 * half), (0.85 * radius, half), (radius, half)]
    rim = turned(lathe([*((r, -y) for r, y in outer), *outer[::-1]], segments=22), 90, "z")
    spoke = box([0, 0, 0], [1.3 * half, 1.8 * radius, 0.1 * radius], round_by=0.1, cells=2)
    across = [turned(spoke, k * 180 / spokes, "x") for k in range(spokes)]
    hub = drum(0.2 * radius, 1.6 * half, segments=10)
    return [moved(each, centre) for each in (rim, hub, *across)]


def side(outline: ArrayLike, width: float, *, at: float = 0.0, bevel: float = 0.08) -> Part:
    """Return a solid whose side view is an outline (N, 2) of (z, y) in either sense, `width` along X about `at`."""
    rim = np.asarray(outline, float)
    after = np.roll(rim, -1, axis=0)
    if float((rim[:, 0] * after[:, 1] - rim[:, 1] * after[:, 0]).sum()) < 0:
        rim = rim[::-1]
    return moved(turned(extrude(rim, width, bevel=bevel), -90, "y"), [at, 0, 0])


def narrowed(part: Part, low: float, high: float, by: float) -> Part:
    """Narrow a solid along X by a share that grows from none at one height to `by` at another."""
    scale = 1 - by * np.clip((part.verts[:, 1] - low) / (high - low), 0, 1)
    return part._replace(verts=part.verts * np.column_stack([scale, np.ones_like(scale), np.ones_like(scale)]))


def circle(radius: float, y: float, z: float, first: float = 0.0, last: float = 360.0, corners: int = 12) -> Array:
    """Return points (N, 2) of an arc as (z, y), from one angle to another in degrees, 0 ahead and 90 up."""
    angle = np.radians(np.linspace(first, last, corners, endpoint=last - first < 360))
    return np.column_stack([z + radius * np.cos(angle), y + radius * np.sin(angle)])


class Motor(NamedTuple):
    """A kind of what drives on four wheels: ranges of its extents, and side views of (z, y).

    In side views z is -1 behind and 1 ahead, y is 0 at the floor and 1 at the roof.
    """

    long: Range
    wide: Range
    tall: Range
    body: Outline
    cabin: Outline
    axles: tuple[float, ...] = (-0.6, 0.62)
    radius: Range = (0.2, 0.23)
    posts: tuple[float, ...] = (0.5,)
    """Where posts divide the side windows, as shares of the cabin's length."""
    narrow: float = 0.22
    bevel: float = 0.1


class Drawn(NamedTuple):
    """Solids of a vehicle by their parts, half its length and width, the heights of its floor and its roof."""

    solids: Solids
    long: float
    wide: float
    floor: float
    top: float

    def at(self, z: float, y: float) -> tuple[float, float]:
        """Return the place (z, y) of a point of a side view."""
        return self.long * z, self.floor + (self.top - self.floor) * y


def motor(rng: Rng, traits: Traits, model: Motor) -> Drawn:
    """Draw a vehicle of a kind: body, cabin with windows, wheels, bumpers, lamps."""
    long, wide, tall = share(rng, *model.long) / 2, share(rng, *model.wide) / 2, share(rng, *model.tall)
    radius = share(rng, *model.radius) * traits.draw(rng, "wheels", *WHEELS)
    floor = 0.6 * radius
    scale, lift = np.array([long, tall]), np.array([0.0, floor])
    nose = 1 + rng.uniform(-0.05, 0.05)  # the highest points of body and cabin wander a little
    body, cabin = (np.asarray(outline, float) for outline in (model.body, model.cabin))
    body, cabin = body * [1, nose] * scale + lift, (cabin + [rng.uniform(-0.04, 0.04), 0]) * scale + lift
    solids: Solids = {"body": [side(body, 2 * wide, bevel=model.bevel)], "bumper": [], "lamp": []}
    solids |= _cabin(cabin, 1.88 * wide, model)
    solids["wheel"] = wheels(radius, 0.45 * radius, wide - 0.2 * radius, [z * long for z in model.axles])
    low, front = floor + 0.2 * tall, [z * long for z in (-1, 1)]
    solids["bumper"] = [block([0, low, z], [1.94 * wide, 0.1 * tall + 0.02, 0.09], 0.4) for z in front]
    nose_y = floor + 0.34 * tall
    solids["lamp"] = [each for z in front for each in pair(drum(0.065, 0.035, [0.72 * wide, nose_y, 0.985 * z], "z"))]
    return Drawn(solids, long, wide, floor, floor + tall)


def _cabin(outline: Array, width: float, model: Motor) -> Solids:
    """Return a cabin of a side view (N, 2), its windows, posts and roof; it narrows upward."""
    low, high = outline.min(0), outline.max(0)
    middle = np.array([outline[:, 0].mean(), (low[1] + 2 * high[1]) / 3])
    panes = [side(middle + (outline - middle) * [0.86, 0.68], width + 0.025, bevel=0.02)]
    panes += [side(middle + (outline - middle) * [1.0, 0.7] + [push, 0], 0.82 * width) for push in (-0.02, 0.02)]
    deep = high[1] - low[1]
    solids = [side(outline, width, bevel=0.05)]
    for place in model.posts:
        z = low[0] + place * (high[0] - low[0])
        solids.append(block([0, middle[1], z], [width + 0.035, 0.86 * deep, 0.06]))
    tops = outline[outline[:, 1] > high[1] - 0.06 * deep][:, 0]
    roof = block([0, high[1], tops.mean()], [width + 0.02, 0.1 * deep + 0.02, float(np.ptp(tops)) + 0.06], 0.4)
    return {
        "cabin": [narrowed(each, low[1], high[1], model.narrow) for each in [*solids, roof]],
        "window": [narrowed(each, low[1], high[1], model.narrow) for each in panes],
    }
