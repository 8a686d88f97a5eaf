"""Build the members of the procedural families out of closed solids. Parameters stand in `families`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from meshdeform.kinds.sketch.solids import Solid, box, hexahedron, lathe, plate, tube

_Numbers = Mapping[str, float]
_Choices = Mapping[str, str]

_SEAT = 0.45
"""Height of a chair's seat."""
_WALL = 0.012
"""Thickness of what is hollow."""


def _legs(kind: str, half_width: float, half_depth: float, top: float, thickness: float) -> dict[str, Solid]:
    """Return what carries a seat or a table: four legs, a column on a cross, or two side walls."""
    r = thickness / 2
    if kind == "column":
        parts = {"column": tube([(0, r, 0), (0, top, 0)], [(thickness, thickness)] * 2, sides=16)}
        for i, (x, z) in enumerate(((1, 1), (1, -1), (-1, -1), (-1, 1))):
            end = (0.75 * half_width * x, r, 0.75 * half_depth * z)
            parts[f"foot_{i}"] = tube([(0, 2 * r, 0), end], [(r, r)] * 2)
        return parts
    if kind == "sides":
        return {
            f"side_{name}": box((x * half_width - r, 0, -half_depth), (x * half_width + r, top, half_depth))
            for x, name in ((-1, "l"), (1, "r"))
        }
    return {
        f"leg_{name}": box(
            (x * half_width - r, 0, z * half_depth - r), (x * half_width + r, top, z * half_depth + r), cuts=2
        )
        for x, z, name in ((-1, -1, "bl"), (1, -1, "br"), (-1, 1, "fl"), (1, 1, "fr"))
    }


def chair(n: _Numbers, c: _Choices) -> dict[str, Solid]:
    """Return a chair whose seat is at height 0.45."""
    w, d, leg = n["width"] / 2, n["depth"] / 2, n["leg_thickness"]
    low = _SEAT - n["seat_thickness"]
    parts = {"seat": box((-w, low, -d), (w, _SEAT, d))}
    parts |= _legs(c["legs"], w - leg / 2, d - leg / 2, low, leg)
    top, thick = _SEAT + n["back_height"], 0.03

    def slab(x0: float, x1: float, y0: float, y1: float) -> Solid:
        z0, z1 = (-d - n["lean"] * (y - _SEAT) / n["back_height"] for y in (y0, y1))
        return hexahedron(
            [
                *((x0, y0, z0 + thick), (x1, y0, z0 + thick), (x1, y0, z0), (x0, y0, z0)),
                *((x0, y1, z1 + thick), (x1, y1, z1 + thick), (x1, y1, z1), (x0, y1, z1)),
            ]
        )

    if c["back"] == "panel":
        parts["back"] = slab(-w, w, _SEAT, top)
    else:
        post = 0.035
        parts["post_l"], parts["post_r"] = slab(-w, -w + post, _SEAT, top), slab(w - post, w, _SEAT, top)
        if c["back"] == "slats":
            parts["rail"] = slab(-w + post, w - post, top - 0.06, top)
            for i, at in enumerate(np.linspace(-w + post, w - post, 5)[1:-1]):
                parts[f"slat_{i}"] = slab(at - 0.014, at + 0.014, _SEAT, top - 0.06)
        else:
            for i, at in enumerate(np.linspace(_SEAT, top, 4)[1:]):
                parts[f"rung_{i}"] = slab(-w + post, w - post, at - 0.05, at)
    if c["arms"] == "yes":
        r, high = 0.018, _SEAT + 0.2
        for x, side in ((-1, "l"), (1, "r")):
            path = [(x * (w + r), low, 0.7 * d), (x * (w + r), high, 0.7 * d), (x * (w + r), high, -d)]
            parts[f"arm_{side}"] = tube(path, [(r, r)] * 3, rows=13)
    return parts


def table(n: _Numbers, c: _Choices) -> dict[str, Solid]:
    """Return a table of width 1."""
    d, top, leg = n["depth"] / 2, n["height"], n["leg_thickness"]
    low = top - n["top_thickness"]
    if c["top"] == "oval":
        disc = lathe([(0, low), (0.5, low), (0.5, top), (0, top)])
        parts = {"top": Solid(disc.verts * [1, 1, 2 * d], disc.faces)}
        reach = 0.68  # legs stay below an oval
    else:
        parts, reach = {"top": box((-0.5, low, -d), (0.5, top, d))}, 1.0
    inset = leg / 2 + n["inset"]
    return parts | _legs(c["legs"], reach * 0.5 - inset, reach * d - inset, low, leg)


def _smooth(points: list[tuple[float, float]], count: int) -> list[tuple[float, float]]:
    """Return a monotone cubic through (height, radius), as (radius, height)."""
    y, r = np.array(points).T
    slope = np.zeros(len(y))
    steps = np.diff(r) / np.diff(y)
    for i in range(1, len(y) - 1):
        if steps[i - 1] * steps[i] > 0:
            slope[i] = 2 * steps[i - 1] * steps[i] / (steps[i - 1] + steps[i])
    at = np.linspace(y[0], y[-1], count)
    row = np.clip(np.searchsorted(y, at, side="right") - 1, 0, len(y) - 2)
    h = y[row + 1] - y[row]
    t = (at - y[row]) / h
    curve = (
        (2 * t**3 - 3 * t**2 + 1) * r[row]
        + (t**3 - 2 * t**2 + t) * h * slope[row]
        + (3 * t**2 - 2 * t**3) * r[row + 1]
        + (t**3 - t**2) * h * slope[row + 1]
    )
    return [(float(radius), float(height)) for radius, height in zip(curve, at, strict=True)]


def _hollow(outside: list[tuple[float, float]], floor: float) -> Solid:
    """Return a vessel: the outside from its foot to its lip, and a wall of even thickness down to the floor."""
    inside = [(radius - _WALL, height) for radius, height in reversed(outside) if height > floor]
    lowest = inside[-1]
    return lathe([(0, outside[0][1]), *outside, *inside, (lowest[0] * 0.6, floor), (0, floor)])


def vase(n: _Numbers, c: _Choices) -> dict[str, Solid]:
    """Return a vase of height 1."""
    neck_at = 0.84
    middle = [(n["belly_height"], n["belly"]), (neck_at, n["neck"])]
    outside = _smooth([(0.0, n["foot"]), *middle, (1.0, max(n["lip"], n["neck"] + 0.01))], 24)
    parts = {"body": _hollow(outside, 0.03)}
    # A handle leaves the neck, and comes back on the belly.
    low = 0.6 * n["belly_height"] + 0.4 * neck_at
    start = float(np.interp(low, [y for _, y in outside], [r for r, _ in outside])) - 0.01
    reach = n["belly"] + 0.08
    for x in {"none": (), "one": (1,), "two": (1, -1)}[c["handles"]]:
        path = [(n["neck"] * 0.95, neck_at, 0), (0.6 * reach + 0.1, neck_at + 0.06, 0), (reach, neck_at - 0.06, 0)]
        path += [(start, low, 0)]
        parts[f"handle_{'r' if x > 0 else 'l'}"] = tube([(x * a, b, z) for a, b, z in path], [(0.018, 0.018)] * 4)
    return parts


def goblet(n: _Numbers, c: _Choices) -> dict[str, Solid]:
    """Return a goblet of height 1: a foot, a stem and a hollow bowl."""
    foot, stem, start = n["foot"], n["stem"], 1 - n["bowl_height"]
    below = [(foot, 0.0), (foot, 0.02), (0.5 * foot + 0.5 * stem, 0.045), (stem, 0.09)]
    if c["stem_shape"] == "knob":
        middle = 0.5 * (0.09 + start)
        knob = [(stem, middle - 0.05), (stem + 0.035, middle - 0.02), (stem + 0.035, middle + 0.02)]
        below += [*knob, (stem, middle + 0.05)]
    wide = n["bowl"]
    rim = wide * n["opening"]
    bowl = _smooth([(start, stem), (start + 0.45 * n["bowl_height"], wide), (1.0, rim)], 14)
    return {"body": _hollow([*below, *bowl], start + 0.06)}


def lamp(n: _Numbers, c: _Choices) -> dict[str, Solid]:
    """Return a standing lamp of height 1."""
    low, r, wide = 1 - n["shade_height"], n["pole"], n["shade_bottom"]
    narrow = min(n["shade_top"], 0.95 * wide)
    if c["shade"] == "cone":
        outside = [(wide, low), (narrow, 1.0)]
    else:
        angle = np.linspace(0, 0.42 * np.pi, 9)
        outside = [(float(wide * np.cos(a)), float(low + (1 - low) * np.sin(a) / np.sin(angle[-1]))) for a in angle]
    inside = [(radius - _WALL, height - _WALL) for radius, height in reversed(outside)]
    parts = {"shade": lathe([(0, 1.0), *reversed(outside), *reversed(inside), (0, 1.0 - _WALL)])}
    parts["shade"] = Solid(parts["shade"].verts, parts["shade"].faces[:, ::-1])
    foot = 0.03 if c["base"] == "disc" else 0.25
    parts["pole"] = tube([(0, foot - 0.01, 0), (0, 1 - 2 * _WALL, 0)], [(r, r)] * 2, sides=12)
    base = n["base_radius"]
    if c["base"] == "disc":
        parts["base"] = lathe([(0, 0), (base, 0), (base, 0.03), (0, 0.03)])
    else:
        for i in range(3):
            x, z = float(np.sin(i * 2 * np.pi / 3)), float(np.cos(i * 2 * np.pi / 3))
            parts[f"leg_{i}"] = tube([(base * x, 0.0, base * z), (0, foot, 0)], [(0.8 * r, 0.8 * r)] * 2)
    return parts


def airplane(n: _Numbers, c: _Choices) -> dict[str, Solid]:
    """Return an airplane of length 2, with its nose towards +Z."""
    r, span, chord = n["body"], n["span"], n["chord"]
    sizes = [(s * r, s * r) for s in (0.15, 0.7, 1, 1, 0.75, 0.3)]
    body = tube([(0, 0, z) for z in (1, 0.9, 0.65, -0.2, -0.65, -1)], sizes, sides=14, rows=17)
    parts = {"body": body}
    place, low = 0.25, (0.6 if c["wings"] == "high" else -0.4) * r
    for x, side in ((-1, "l"), (1, "r")):
        tip = (x * span, low + 0.05, place - n["sweep"])
        parts[f"wing_{side}"] = plate((x * 0.6 * r, low, place), tip, chord, chord * n["taper"], 0.018)
        up = 0.75 * n["fin"] if c["tail"] == "v" else 0.0
        parts[f"tail_{side}"] = plate((x * 0.2 * r, 0, -0.7), (x * 0.38, up, -0.85), 0.25, 0.13, 0.014)
        if c["engines"] == "under_wings":
            at, e = 0.4 * span, 0.05
            z = place - 0.4 * n["sweep"]
            path = [(x * at, low - 1.4 * e, z + 0.12), (x * at, low - 1.4 * e, z - 0.16)]
            parts[f"engine_{side}"] = tube(path, [(e, e)] * 2, sides=12)
        elif c["engines"] == "propeller":
            parts[f"blade_{side}"] = tube([(x * 0.01, 0, 1.0), (x * 0.25, 0, 1.0)], [(0.012, 0.03)] * 2)
    if c["tail"] == "cross":
        parts["fin"] = plate((0, 0.2 * r, -0.65), (0, 0.2 * r + n["fin"], -0.88), 0.3, 0.14, 0.014)
    return parts
