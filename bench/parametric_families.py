"""Families whose truth is known: chairs, airplanes and bicycles with labels, correspondences and sub-classes.

Every number of a member is drawn from its seed. Nothing is shared with the builtin prior's shapes.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.solids import Floats, Solid, box, hexahedron, plate, ring, tube
from meshdeform.assets import Primitive, build_glb

__all__ = ["CLASSES", "PARTS", "Member", "family", "labels_document", "packed"]

Draw = Callable[[float, float], float]

PARTS = {
    "chairs": ("seat", "back", "leg", "arm"),
    "airplanes": ("fuselage", "wing", "tail", "engine"),
    "bicycles": ("wheel", "frame", "saddle", "handlebar"),
}
CLASSES = {
    "chairs": ("side", "armchair", "bench", "swivel"),
    "airplanes": ("jet", "fighter", "propeller", "uav"),
    "bicycles": ("bicycle", "tricycle", "motorbike"),
}


@dataclass
class Member:
    """One shape of a family.

    Attributes
    ----------
    name : str
        File name.
    kind : str
        Its sub-class.
    solids : dict of name to (part, Solid)
        Solids of the same name correspond.
    """

    name: str
    kind: str
    solids: dict[str, tuple[str, Solid]] = field(default_factory=dict)

    def add(self, name: str, part: str, solid: Solid) -> None:
        self.solids[name] = (part, solid)

    def glb(self) -> bytes:
        """Return the GLB, with one node for each solid, named after it."""
        made = [Primitive(s.verts, s.faces, name=name, material=part) for name, (part, s) in self.solids.items()]
        return build_glb(made)

    def parts(self) -> list[str]:
        """Return the part of each triangle, in the order of the file."""
        return [part for part, solid in self.solids.values() for _ in range(len(solid.faces))]

    def counterparts(self, other: Member, triangles: NDArray[np.int64], weights: Floats) -> Floats:
        """Return where places on this member lie on another one (P, 3); NaN where it has no such solid."""
        names = [name for name, (_, solid) in self.solids.items() for _ in range(len(solid.faces))]
        first = {}
        count = 0
        for name, (_, solid) in self.solids.items():
            first[name] = count
            count += len(solid.faces)
        found = np.full((len(triangles), 3), np.nan)
        for row, (triangle, weight) in enumerate(zip(triangles, weights, strict=True)):
            name = names[triangle]
            if name in other.solids:
                solid = other.solids[name][1]
                found[row] = weight @ solid.verts[solid.faces[triangle - first[name]]]
        return found


def _chair(member: Member, draw: Draw) -> None:
    bench, swivel = member.kind == "bench", member.kind == "swivel"
    w = draw(0.75, 1.0) if bench else draw(0.22, 0.29)
    d, h, t = draw(0.21, 0.28), draw(0.4, 0.5), draw(0.02, 0.05)
    top, lean = h + draw(0.35, 0.6), draw(0.0, 0.12)
    member.add("seat", "seat", box((-w, h - t, -d), (w, h, d)))
    b, bw = draw(0.02, 0.04), w * draw(0.85, 1.0)
    low = h + draw(0.0, 0.08)
    back = [(-bw, low, -d + b), (bw, low, -d + b), (bw, low, -d - b), (-bw, low, -d - b)]
    high = [(x, top, z - lean) for x, _, z in back]
    member.add("back", "back", hexahedron([*back, *high]))
    if swivel:
        r = draw(0.025, 0.045)
        member.add("column", "leg", tube([(0, 0.08, 0), (0, h - t, 0)], [(r, r)] * 2))
        reach, foot = draw(0.22, 0.3), draw(0.018, 0.028)
        for i in range(5):
            x, z = np.sin(i * 2 * np.pi / 5), np.cos(i * 2 * np.pi / 5)
            spoke = tube([(0, 0.09, 0), (reach * x, foot, reach * z)], [(foot, foot)] * 2)
            member.add(f"spoke_{i}", "leg", spoke)
    else:
        r, out = draw(0.02, 0.035), draw(0.0, 0.05)
        for x, side in ((-1, "l"), (1, "r")):
            for z, end in ((-1, "b"), (1, "f")):
                top_ = (x * (w - r), h - t, z * (d - r))
                foot_ = (x * (w - r + out), 0.0, z * (d - r + out))
                member.add(f"leg_{side}{end}", "leg", tube([foot_, top_], [(r, r)] * 2))
    if member.kind == "armchair" or (swivel and draw(0, 1) < 0.4) or (bench and draw(0, 1) < 0.3):
        a, r, front = h + draw(0.17, 0.24), draw(0.018, 0.03), d * draw(0.6, 0.9)
        for x, side in ((-1, "l"), (1, "r")):
            path = [(x * (w + r), h - t / 2, front), (x * (w + r), a, front), (x * (w + r), a, -d)]
            member.add(f"arm_{side}", "arm", tube(path, [(r, r)] * 3, rows=13))


def _airplane(member: Member, draw: Draw) -> None:
    kind = member.kind
    length = draw(0.85, 1.0) * {"jet": 1.0, "fighter": 0.85, "propeller": 0.7, "uav": 0.55}[kind]
    r = length * {"jet": draw(0.1, 0.13), "fighter": draw(0.08, 0.1), "propeller": draw(0.1, 0.14)}.get(
        kind, draw(0.07, 0.1)
    )
    sizes = [(0.25 * r, 0.25 * r), (0.8 * r, 0.8 * r), (r, r), (r, r), (0.7 * r, 0.7 * r), (0.25 * r, 0.3 * r)]
    nose = [length, 0.9 * length, 0.65 * length, -0.2 * length, -0.7 * length, -length]
    member.add("fuselage", "fuselage", tube([(0, 0, z) for z in nose], sizes, sides=10, rows=15))
    span = {"jet": draw(0.85, 1.05), "fighter": draw(0.5, 0.65), "propeller": draw(0.8, 0.95), "uav": draw(1.1, 1.4)}
    sweep = {"jet": draw(0.35, 0.5), "fighter": draw(0.6, 0.75), "propeller": draw(-0.02, 0.05), "uav": draw(0, 0.1)}
    root = length * {"jet": 0.3, "fighter": draw(0.75, 0.95), "propeller": 0.25, "uav": 0.18}[kind] * draw(0.9, 1.1)
    tip, rise = root * (0.15 if kind == "fighter" else draw(0.4, 0.7)), draw(-0.02, 0.1)
    place = length * draw(0.1, 0.25)
    low = 0.5 * r if kind == "propeller" and draw(0, 1) < 0.5 else -0.3 * r
    for x, side in ((-1, "l"), (1, "r")):
        wing = plate((x * 0.7 * r, low, place), (x * span[kind], low + rise, place - sweep[kind]), root, tip, 0.02)
        member.add(f"wing_{side}", "wing", wing)
    v_tail, tail = kind == "uav", -length + 0.1 * length
    reach, chord = length * draw(0.3, 0.4), length * draw(0.18, 0.25)
    for x, side in ((-1, "l"), (1, "r")):
        up = reach * 0.8 if v_tail else 0.0
        fin = plate((x * 0.2 * r, 0.1 * r, tail + chord), (x * reach, up + 0.1 * r, tail + 0.3 * chord), chord,
                   0.5 * chord, 0.015)  # fmt: skip
        member.add(f"tail_{side}", "tail", fin)
    if not v_tail:
        top = length * draw(0.3, 0.42)
        fin = plate((0, 0.3 * r, tail + chord), (0, 0.3 * r + top, tail + 0.2 * chord), chord, 0.5 * chord, 0.015)
        member.add("fin", "tail", fin)
    if kind == "jet":
        e, at = draw(0.045, 0.06), draw(0.3, 0.45)
        for x, side in ((-1, "l"), (1, "r")):
            px, pz = x * at * span[kind], place - at * sweep[kind] - root * 0.2
            path = [(px, low - 1.6 * e, pz + 0.16), (px, low - 1.6 * e, pz - 0.14)]
            member.add(f"engine_{side}", "engine", tube(path, [(e, e), (e, e)], sides=10))
    elif kind in {"propeller", "uav"}:
        at, blade = (length + 0.02 if kind == "propeller" else -length - 0.02), draw(0.2, 0.28)
        for x, side in ((-1, "l"), (1, "r")):
            path = [(x * 0.02, 0, at), (x * blade, 0, at)]
            member.add(f"blade_{side}_{kind}", "engine", tube(path, [(0.012, 0.03)] * 2))


def _bicycle(member: Member, draw: Draw) -> None:
    motor, three = member.kind == "motorbike", member.kind == "tricycle"
    r = draw(0.27, 0.33) if motor else draw(0.3, 0.36) if not three else draw(0.2, 0.26)
    thick, wide = (draw(0.06, 0.08), draw(0.06, 0.09)) if motor else (draw(0.02, 0.03), draw(0.02, 0.03))
    base = draw(0.52, 0.6) if not three else draw(0.45, 0.55)
    member.add("wheel_f", "wheel", ring((base, r + thick, 0), r, thick, wide))
    if three:
        gap = draw(0.22, 0.3)
        for z, side in ((-1, "l"), (1, "r")):
            member.add(f"wheel_{side}", "wheel", ring((-base, r + thick, z * gap), r, thick, wide))
        axle = [(-base, r + thick, -gap), (-base, r + thick, gap)]
        member.add("axle", "frame", tube(axle, [(0.02, 0.02)] * 2))
    else:
        member.add("wheel_b", "wheel", ring((-base, r + thick, 0), r, thick, wide))
    hub, f = r + thick, draw(0.05, 0.07) if motor else draw(0.018, 0.028)
    seat_h = draw(0.75, 0.85) if not motor else draw(0.68, 0.74)
    head = (base * draw(0.6, 0.7), draw(0.78, 0.88), 0.0)
    saddle, crank = (-0.25 * base - (0.1 if motor else 0), seat_h, 0.0), (-0.05, hub * 0.9, 0.0)
    member.add("fork", "frame", tube([(base, hub, 0), head], [(f, f)] * 2))
    bars = {"down": (head, crank), "seat_tube": (crank, saddle), "stay": ((-base, hub, 0), crank),
            "top": ((head[0], head[1] - 0.08, 0), (saddle[0], saddle[1] - 0.1, 0))}  # fmt: skip
    for name, ends in bars.items():
        member.add(name, "frame", tube(ends, [(f, f)] * 2))
    if motor:
        tank = [(0.32, 0.62, 0), (0.1, 0.66, 0), (-0.15, 0.6, 0)]
        member.add("tank", "frame", tube(tank, [(0.08, 0.09), (0.13, 0.14), (0.08, 0.09)]))
        member.add("motor", "frame", box((-0.2, 0.2, -0.12), (0.2, 0.5, 0.12)))
    long, half = (draw(0.28, 0.36), 0.12) if motor else (draw(0.12, 0.16), draw(0.06, 0.09))
    sx, sy = saddle[0], saddle[1]
    member.add("saddle", "saddle", box((sx - long, sy, -half), (sx + long * 0.8, sy + draw(0.04, 0.07), half)))
    reach, up = draw(0.25, 0.34), head[1] + draw(0.06, 0.14)
    bar = [(head[0] - 0.08, up, -reach), (head[0], up, -0.1), (head[0], up, 0.1), (head[0] - 0.08, up, reach)]
    member.add("handlebar", "handlebar", tube(bar, [(0.02, 0.02)] * 4, rows=13))
    member.add("stem", "handlebar", tube([head, (head[0], up, 0)], [(0.02, 0.02)] * 2, rows=4))


_MAKERS = {"chairs": _chair, "airplanes": _airplane, "bicycles": _bicycle}


def family(name: str, count: int, seed: int = 0, *, kinds: Sequence[str] | None = None) -> list[Member]:
    """Return `count` members of a family, its sub-classes in turn."""
    made = []
    kinds = CLASSES[name] if kinds is None else kinds
    for number in range(count):
        random = np.random.default_rng([seed, number])
        kind = kinds[number % len(kinds)]
        member = Member(f"{name[:-1]}_{number:04d}.glb", kind)
        _MAKERS[name](member, _uniform(random))
        made.append(member)
    return made


def _uniform(random: np.random.Generator) -> Draw:
    return lambda low, high: float(random.uniform(low, high))


def packed(members: Sequence[Member]) -> bytes:
    """Return a ZIP of the members."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for member in members:
            archive.writestr(zipfile.ZipInfo(member.name), member.glb())
    return buffer.getvalue()


def labels_document(name: str, members: Sequence[Member], labelled: int, *, classes: bool = True) -> dict[str, Any]:
    """Return the labels of all members, by node; those after the first `labelled` are held out."""
    assets: dict[str, Any] = {}
    for number, member in enumerate(members):
        assets[member.name] = {"nodes": {solid: part for solid, (part, _) in member.solids.items()}}
        if number >= labelled:
            assets[member.name]["held_out"] = True
        if classes:
            assets[member.name]["class"] = member.kind
    return {"parts": list(PARTS[name]), "assets": assets}
