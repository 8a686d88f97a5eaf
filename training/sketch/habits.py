"""Draw members as people see them: from the front or the side, slanted, in single lines, and not with all their legs.

A renderer shows each leg in sight, with two outlines, in one perspective. People draw what a thing is known by. What
they do is a habit here, with a probability in the training.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from meshdeform.kinds.sketch.families import FAMILIES
from meshdeform.kinds.sketch.solids import Floats, Solid, lathe
from training.sketch.lines import View, joined, visible_lines

AZIMUTHS = (-70.0, 70.0)
ELEVATIONS = (0.0, 40.0)
FIELDS = (12.0, 40.0)
_LOOKS: dict[str, dict[str, float]] = {
    "chair": {"any": 0.5, "front": 0.2, "side": 0.1, "slanted": 0.2},
    "table": {"any": 0.5, "front": 0.2, "side": 0.1, "slanted": 0.2},
    "airplane": {"any": 0.55, "front": 0.2, "side": 0.15, "above": 0.1},
}
"""How probable it is that a thing of a family is seen so."""
_OTHERS = {"any": 0.7, "front": 0.3}
_FLAT = 0.012
"""Thickness of a seat or a top that is drawn without one."""
_PLATES = ("seat_thickness", "top_thickness")
_NEVER_THIN = ("body", "engine")
_LONG = 2.5
"""Length of what may be drawn as one line, in widths."""


@dataclass(frozen=True)
class Habits:
    """How a person simplifies a thing."""

    view: View
    slant: tuple[float, float] = (0.0, 0.0)
    """How far to the right and up a unit of depth goes on the page, as in drawings that show the front as it is and the
    depth at an angle. (0, 0): perspective alone."""
    thin: float = 0.0  # what looks narrower than this share of the whole is one line
    flat: bool = False  # seats and tops have no thickness
    legs_left_out: int = 0  # so many of four legs are left out, the farthest first
    engines: float = 1.0  # engines are so many times as large
    blades: int = 2  # blades of a propeller, in pairs; 0: a disc, as it looks while it turns
    turn_deg: float = 0.0  # how far the propeller is turned
    contours: bool = False  # suggestive contours are drawn too

    @classmethod
    def some(cls, name: str, choices: Mapping[str, str], random: np.random.Generator) -> Habits:
        """Return the habits of a person who draws a member of a family.

        Nobody draws side panels from the front, where they look like legs.
        """
        looks = _LOOKS.get(name, _OTHERS)
        look = str(random.choice(list(looks), p=list(looks.values())))
        if look == "front" and choices.get("legs") == "sides":
            look = "any"
        thin = random.uniform(0.02, 0.14) if random.random() < 0.3 else 0.0
        habits = cls(
            random_view(random),
            thin=thin,
            flat=bool(random.random() < (0.4 if thin else 0.1)),
            legs_left_out=1 if random.random() < 0.1 else 0,
            engines=random.uniform(1.0, 2.2) if random.random() < 0.6 else 1.0,
            blades=int(random.choice([0, 2, 4], p=[0.2, 0.6, 0.2])),
            turn_deg=random.uniform(0, 180),
            contours=bool(random.random() < 0.3),
        )
        if look == "any":
            return habits
        field = random.uniform(*FIELDS)
        some_legs = 2 if random.random() < 0.7 else 0
        if look == "above":
            return replace(habits, view=View(random.uniform(*AZIMUTHS), random.uniform(50, 80), field))
        if look == "slanted":
            angle, size = random.uniform(0.3, 1.2), random.uniform(0.3, 0.9)
            slant = float(random.choice([-1, 1]) * size * np.cos(angle)), float(size * np.sin(angle))
            return replace(habits, view=View(0.0, 0.0, FIELDS[0]), slant=slant)
        azimuth = 0.0 if look == "front" else float(random.choice([-90.0, 90.0]))
        view = View(azimuth + random.normal(0, 4), random.uniform(0, 12), field)
        return replace(habits, view=view, legs_left_out=some_legs)


def random_view(random: np.random.Generator) -> View:
    """Return a view from the front half, at or above the height of the thing."""
    return View(random.uniform(*AZIMUTHS), random.uniform(*ELEVATIONS), random.uniform(*FIELDS))


def drawn_lines(name: str, values: Mapping[str, object], habits: Habits) -> list[Floats]:
    """Return the lines of a member of a family as `visible_lines` does, simplified by habits."""
    family = FAMILIES[name]
    every = family.checked(values)
    numbers = {each.name: float(every[each.name]) for each in family.numbers}
    if habits.flat:
        numbers |= {each: _FLAT for each in _PLATES if each in numbers}
    solids = family.make(numbers, {each.name: str(every[each.name]) for each in family.choices})
    toward = _toward(habits.view)
    far = sorted(
        (each for each in solids if each.startswith("leg_")), key=lambda leg: (solids[leg].verts @ toward[2]).mean()
    )
    if len(far) == 4:  # the three legs of a lamp are what it is known by
        for each in far[: habits.legs_left_out]:
            del solids[each]
    solids = _with_blades(_with_engines(solids, habits.engines), habits)
    solids = {each: _slanted(solid, habits.slant) for each, solid in solids.items()}
    wires = _wires(solids, toward[:2], habits.thin)
    rest = joined({each: solid for each, solid in solids.items() if each not in wires})
    return visible_lines(rest, habits.view, list(wires.values()), contours=habits.contours)


def _toward(view: View) -> Floats:
    """Return the directions to the right, up and to the eye (3, 3)."""
    a, e = np.deg2rad([view.azimuth_deg, view.elevation_deg])
    right = np.array([np.cos(a), 0.0, -np.sin(a)])
    eye = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    return np.stack([right, np.cross(eye, right), eye])


def _with_engines(solids: dict[str, Solid], size: float) -> dict[str, Solid]:
    """Return the solids with larger engines, which stay where they are."""
    result = dict(solids)
    for name, solid in solids.items():
        if name.startswith("engine_"):
            middle = solid.verts.mean(0)
            result[name] = replace(solid, verts=middle + size * (solid.verts - middle))
    return result


def _with_blades(solids: dict[str, Solid], habits: Habits) -> dict[str, Solid]:
    """Return the solids with another propeller, which turns around the axis along Z."""
    blades = {name: solid for name, solid in solids.items() if name.startswith("blade_")}
    if not blades:
        return solids
    rest = {name: solid for name, solid in solids.items() if name not in blades}
    if not habits.blades:
        every = np.concatenate([solid.verts for solid in blades.values()])
        reach, thick = float(np.abs(every[:, 0]).max()), 0.01
        disc = lathe([(0, -thick), (reach, -thick), (reach, thick), (0, thick)])
        return rest | {"blade": Solid(disc.verts[:, [0, 2, 1]] * [1, -1, 1] + [0, 0, every[:, 2].mean()], disc.faces)}
    for turn in range(habits.blades // 2):
        a = np.deg2rad(habits.turn_deg + 90 * turn)
        matrix = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
        for name, solid in blades.items():
            spine = None if solid.spine is None else solid.spine @ matrix
            rest[f"{name}_{turn}"] = Solid(solid.verts @ matrix, solid.faces, spine)
    return rest


def _slanted(solid: Solid, slant: tuple[float, float]) -> Solid:
    """Return a solid whose depth goes to the right and up."""
    matrix = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-slant[0], -slant[1], 1.0]])
    return Solid(solid.verts @ matrix, solid.faces, None if solid.spine is None else solid.spine @ matrix)


def _wires(solids: Mapping[str, Solid], page: Floats, thin: float) -> dict[str, Floats]:
    """Return the middle lines of the solids that look narrow on the page, by name."""
    if not thin:
        return {}
    flattened = {name: solid.verts @ page.T for name, solid in solids.items()}
    most = thin * float(np.ptp(np.concatenate(list(flattened.values())), axis=0).max())
    wires: dict[str, Floats] = {}
    for name, solid in solids.items():
        if name.startswith(_NEVER_THIN):
            continue
        if solid.spine is not None:
            across = np.linalg.norm(solid.verts[:, None] - solid.spine[None], axis=2).min(1).max()
            if 2 * across < most:
                wires[name] = solid.spine
            continue
        around = flattened[name] - flattened[name].mean(0)
        along, wide = (around @ axis for axis in np.linalg.eigh(around.T @ around)[1].T[::-1])
        if np.ptp(wide) < min(most, np.ptp(along) / _LONG):
            reach = 0.05 * np.ptp(along)
            ends = [solid.verts[rows].mean(0) for rows in (along < along.min() + reach, along > along.max() - reach)]
            wires[name] = ends[0] + np.linspace(0, 1, 9)[:, None] * (ends[1] - ends[0])
    return wires
