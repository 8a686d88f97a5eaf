"""Draw what flies in the air, all facing +Z."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from meshdeform.nouns.families.chassis import Solids, bar, block, drum, share, wheel
from meshdeform.nouns.families.parts import Part, ellipsoid, lathe, limb, moved, named, pair, plate, turned
from meshdeform.nouns.families.traits import Range, Rng, Traits

__all__ = ["airship", "biplane", "drone", "fighter", "glider", "parachute"]

WINGS = ((0.3, 0.4), (0.95, 1.05), (1.6, 1.8))
"""Spans of small, plain and big wings, as shares of the usual one."""


class Plane(NamedTuple):
    """A kind of airplane: ranges of half its length, its girth, the span of a wing; the wing's shape and place.

    `sweep`: how far the tip is behind the root; `taper`: the chord at the tip as a share of that at the root.
    """

    long: Range = (0.8, 0.9)
    girth: Range = (0.13, 0.16)
    span: Range = (0.9, 1.05)
    chord: float = 0.36
    sweep: float = 0.05
    taper: float = 0.75
    height: float = 0.0  # of the wing over the middle, as a share of the girth
    place: float = 0.14  # of the wing's front edge, as a share of the length
    rise: float = 3.0  # of the wing, in degrees
    blunt: float = 0.7  # the girth at the nose
    tail: float = 0.36  # span of half the tail plane
    thick: float = 0.055


def wing_of(span: float, chord: float, sweep: float, taper: float, thick: float, rise: float = 0.0) -> list[Part]:
    """Return two wings whose roots begin at the origin."""
    end = chord * taper
    outline = [(-0.02, 0), (0.5 * span, -0.5 * sweep), (0.94 * span, -sweep), (span, -sweep - 0.3 * end),
               (span, -sweep - 0.85 * end), (0.94 * span, -sweep - end), (-0.02, -chord)]  # fmt: skip
    return pair(turned(plate(outline, thick, across="y"), rise, "z"))


def plane(rng: Rng, traits: Traits, model: Plane) -> tuple[Solids, float, float, float]:
    """Draw an airplane of a kind; also half its length, its girth, and the span of a wing."""
    long, girth = share(rng, *model.long), share(rng, *model.girth)
    span = share(rng, *model.span) * traits.draw(rng, "wings", *WINGS)
    path = [[0, -0.1 * girth, long], [0, 0, 0.6 * long], [0, 0, -0.1 * long], [0, 0.5 * girth, -0.95 * long]]
    shape = dict(taper=model.taper, thick=model.thick)
    wings = wing_of(girth + span, model.chord, model.sweep, rise=model.rise, **shape)
    tail = wing_of(share(rng, 0.9, 1.1) * model.tail, 0.5 * model.chord, 0.4 * model.sweep + 0.05, **shape)
    high = share(rng, 0.3, 0.4)
    fin = plate([(0.14, 0.0), (-0.06, high), (-0.2, high), (-0.22, 0.0)], model.thick, across="x")
    solids: Solids = {
        "body": [limb(path, [model.blunt * girth, girth, girth, 0.32 * girth], segments=16, samples=3)],
        "wing": [moved(each, [0, model.height * girth, model.place * long + 0.5 * model.chord]) for each in wings],
        "tail": [moved(each, [0, 0.5 * girth, -0.8 * long]) for each in tail],
    }
    solids["tail"].append(moved(fin, [0, 0.6 * girth, -0.84 * long]))
    return solids, long, girth, span


def _screw(radius: float, y: float, z: float, spin: float, blades: int = 2, x: float = 0.0) -> list[Part]:
    """Return a propeller about an axle along Z, with a pointed hub."""
    blade = block([0, 0.52 * radius, 0], [0.17 * radius + 0.02, radius, 0.03], 0.4)
    turns = [turned(blade, spin + 360 * k / blades, "z") for k in range(blades)]
    hub = turned(lathe([(0.07, -0.05), (0.065, 0.03), (0.03, 0.1)], segments=12), 90, "x")
    return [moved(each, [x, y, z]) for each in (hub, *turns)]


def _wheels(y: float, x: float, z: float, root: float) -> Solids:
    """Return a landing gear: two wheels on struts."""
    return {
        "wheel": pair(wheel(0.09, 0.04, [x, y, z])),
        "leg": pair(bar([0.4 * x, root, z], [x - 0.03, y, z], radius=0.03)),
    }


def biplane(rng: Rng, traits: Traits) -> Part:
    """Draw a biplane: two wings one above the other with struts, a propeller, an open cockpit, fixed wheels."""
    solids, long, girth, span = plane(rng, traits, Plane((0.7, 0.8), (0.14, 0.17), (0.75, 0.9), height=-0.7, blunt=0.95,
                                                         sweep=0.0, taper=0.9, tail=0.34))  # fmt: skip
    gap = share(rng, 0.46, 0.56)
    low = -0.7 * girth
    solids["wing"] += [moved(each, [0, gap, 0.06]) for each in solids["wing"]]
    z = 0.14 * long
    solids["mast"] = [each for x, front in ((0.3, 0.1), (0.3, -0.08), (0.75, 0.1), (0.75, -0.08))
                      for each in pair(bar([x * (girth + span), low, z + front], [x * (girth + span), low + gap + 0.03, z + front + 0.05],
                                           radius=0.022))]  # fmt: skip
    solids["rotor"] = _screw(0.32, 0, long + 0.13, share(rng, 0, 180))
    solids["head"] = [ellipsoid([0, girth + 0.06, -0.16], 0.085, rings=7)]
    return named(**solids, **_wheels(-girth - 0.2, 0.24, 0.3 * long, -0.5 * girth))


def fighter(rng: Rng, traits: Traits) -> Part:
    """Draw a fighter jet: a needle nose, a bubble canopy, swept or delta wings, intakes, one fin or two, nozzles."""
    delta, twin = rng.random() < 0.4, rng.random() < 0.5
    model = Plane((0.98, 1.1), (0.11, 0.13), (0.46, 0.58), chord=0.8 if delta else 0.52, sweep=0.62 if delta else 0.4,
                  taper=0.14 if delta else 0.34, place=-0.16, rise=0, blunt=0.22, tail=0.36, thick=0.045)  # fmt: skip
    solids, long, girth, _ = plane(rng, traits, model)
    solids["cabin"] = [ellipsoid([0, 0.8 * girth, 0.42 * long], [0.62 * girth, 0.7 * girth, 0.24 * long], rings=8)]
    solids["body"] += pair(
        block([0.95 * girth, -0.2 * girth, -0.2 * long], [1.0 * girth, 1.3 * girth, 0.9 * long], 0.3)
    )
    nozzle = moved(turned(lathe([(0.1, 0), (0.1, 0.05), (0.075, 0.2), (0.05, 0.2), (0.04, 0.08)], segments=14), -90, "x"),
                   [0.6 * girth if twin else 0, 0, -0.88 * long])  # fmt: skip
    solids["exhaust"] = pair(nozzle) if twin else [nozzle]
    if twin:
        fin = moved(turned(solids["tail"].pop(), -14, "z"), [girth, -0.2 * girth, 0])
        solids["tail"] += pair(fin)
    if rng.random() < 0.6:
        solids["gun"] = pair(bar([0.36, -0.12, -0.46], [0.36, -0.12, 0.0], radius=0.035))
        solids["gun"] += pair(block([0.36, -0.06, -0.3], [0.03, 0.1, 0.16]))
    return named(**solids)


def glider(rng: Rng, traits: Traits) -> Part:
    """Draw a glider: very long slim wings, a drop of a body that ends thin, a canopy ahead, a tail high on its fin."""
    long = share(rng, 0.6, 0.7)
    span = share(rng, 1.15, 1.35) * traits.draw(rng, "wings", *WINGS)
    girth = share(rng, 0.1, 0.125)
    path = [[0, -0.02, 0.9 * long], [0, 0, 0.4 * long], [0, 0.02, -0.1 * long], [0, 0.06, -long]]
    fin = plate([(0.12, 0.0), (-0.02, 0.3), (-0.13, 0.3), (-0.13, 0.0)], 0.05, across="x")
    return named(
        body=[limb(path, [[0.6 * girth, 0.6 * girth], [girth, girth], [0.6 * girth, 0.7 * girth], [0.035, 0.04]], samples=3)],
        cabin=[ellipsoid([0, 0.6 * girth, 0.5 * long], [0.7 * girth, 0.7 * girth, 0.22], rings=8)],
        wing=[moved(each, [0, 0.6 * girth, 0.18]) for each in wing_of(span, 0.22, 0.04, 0.45, 0.05, 4)],
        tail=[moved(fin, [0, 0.06, -0.93 * long]),
              *(moved(each, [0, 0.35, -0.93 * long]) for each in wing_of(0.3, 0.14, 0.02, 0.7, 0.04))],
    )  # fmt: skip


def hang_glider(rng: Rng, traits: Traits) -> Part:
    """Draw a hang glider: a cloth arrow on a keel, a triangle of bars and a pilot who lies under it."""
    span, sweep = share(rng, 1.0, 1.15) * traits.draw(rng, "wings", *WINGS), share(rng, 0.55, 0.7)
    low = -share(rng, 0.46, 0.54)
    tip = np.array([0, 0, 0.5])
    wing = plate(
        [(-0.02, 0.5), (span, 0.5 - sweep), (span, 0.38 - sweep), (0.45 * span, 0.02), (-0.02, -0.35)], 0.05, across="y"
    )
    body = [[0, low + 0.1, 0.3], [0, low + 0.1, 0.0], [0, low + 0.14, -0.5]]
    return named(
        body=[limb(body, [[0.12, 0.08], [0.12, 0.09], [0.06, 0.05]], segments=10)],
        wing=pair(turned(wing, -4, "z")),
        frame=[bar(tip, [0, 0.02, -0.4], radius=0.025),
               *pair(bar([0, 0, 0.05], [0.3, low, 0.2], radius=0.022)), bar([-0.3, low, 0.2], [0.3, low, 0.2], radius=0.022)],
        rope=[bar([0, 0, -0.02], [0, low + 0.14, -0.05], radius=0.02)],
        head=[ellipsoid([0, low + 0.16, 0.38], 0.09, rings=8)],
        tail=[moved(plate([(0.1, 0), (-0.08, 0.12), (-0.1, 0)], 0.04, across="x"), [0, 0, -0.34])],
    )  # fmt: skip


def airship(rng: Rng, traits: Traits) -> Part:
    """Draw an airship: a long rounded envelope with seams, four fins behind, a gondola below, engines at its sides."""
    long, girth = share(rng, 0.92, 1.05), share(rng, 0.3, 0.4)
    fins = traits.draw(rng, "fins", (0.1, 0.14), (0.26, 0.32), (0.5, 0.58))
    line = np.linspace(-1.0, 1.0, 17)
    profile = [(girth * (1 - np.abs(t) ** (2.0 if t < 0 else 2.6)) ** 0.62, long * t) for t in line[1:-1]]
    hull_ = turned(lathe([(0.0, -long), *profile, (0.0, long)], segments=24), 90, "x")
    turn = np.arctan2(hull_.verts[:, 0], hull_.verts[:, 1])
    ridge = 1 + 0.035 * np.abs(np.cos(4 * turn))
    hull_ = hull_._replace(verts=hull_.verts * np.column_stack([ridge, ridge, 0 * ridge + 1]))
    root = 0.45 * girth
    fin = plate([(0.22, 0.0), (0.0, root + fins), (-0.2, root + fins), (-0.2, 0.0)], 0.05, across="x")
    y, size = -girth - 0.08, share(rng, 0.2, 0.34)
    return named(
        body=[hull_],
        fin=[turned(moved(fin, [0, 0, -0.72 * long]), 90 * k + 45 * (long > 0.98), "z") for k in range(4)],
        cabin=[block([0, y, 0.12], [0.24, 0.2, 2 * size], 0.4)],
        window=[block([0, y + 0.02, 0.12 + z * size], [0.27, 0.08, 0.4 * size], 0.1) for z in (-0.6, 0.0, 0.6)],
        rotor=[each for x in (-1, 1) for each in [
            moved(drum(0.06, 0.1, axis="z", segments=12), [x * 0.26, y, -0.16]), bar([0, y, -0.16], [x * 0.26, y, -0.16], radius=0.03),
            *_screw(0.14, y, -0.28, 30, 2, x * 0.26)]],
    )  # fmt: skip


def drone(rng: Rng, traits: Traits) -> Part:
    """Draw a drone: a flat body with four arms that end in rotors, two skids or feet, a camera below."""
    reach = traits.draw(rng, "arms", (0.16, 0.22), (0.5, 0.6), (0.95, 1.1))
    wide, long, tall = share(rng, 0.2, 0.26), share(rng, 0.3, 0.38), share(rng, 0.14, 0.2)
    blade, guarded = share(rng, 0.26, 0.32), rng.random() < 0.35
    ring = lathe(
        [(blade + 0.02, -0.03), (blade + 0.06, -0.03), (blade + 0.06, 0.03), (blade + 0.02, 0.03), (blade + 0.02, 0.0)],
        segments=20,
    )
    solids: Solids = {"body": [block([0, 0, 0], [2 * wide, tall, 2 * long], 0.45)], "arm": [], "rotor": []}
    for x, z in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        end = np.array([x * (0.7 * wide + reach), 0.06, z * (0.5 * long + 0.75 * reach)])
        solids["arm"] += [bar([0.6 * x * wide, 0, 0.6 * z * long], end, radius=(0.06, 0.045))]
        solids["arm"] += [moved(drum(0.065, 0.09, axis="y", segments=12), end)]
        spin = share(rng, 0, 180)
        solids["rotor"] += [moved(turned(block([0, 0.11, 0], [2 * blade, 0.025, 0.08], 0.4), spin, "y"), end)]
        if guarded:
            solids["rotor"] += [moved(turned(block([0, 0.05, 0], [2 * blade + 0.1, 0.03, 0.03]), spin + 90, "y"), end),
                                moved(ring, end + [0, 0.08, 0])]  # fmt: skip
    low = -tall / 2 - share(rng, 0.16, 0.24)
    if rng.random() < 0.6:
        solids["skid"] = pair(bar([wide + 0.04, low, -0.9 * long], [wide + 0.04, low, 0.9 * long], radius=0.03))
        solids["skid"] += [
            each
            for z in (-0.4, 0.4)
            for each in pair(bar([0.7 * wide, 0, z * long], [wide + 0.04, low, z * long], radius=0.026))
        ]
    else:
        solids["skid"] = [
            each
            for z in (-0.8, 0.8)
            for each in pair(bar([0.8 * wide, 0, z * long], [wide, low, z * long], radius=0.035))
        ]
    solids["lens"] = [
        block([0, -tall / 2 - 0.05, 0.7 * long], [0.14, 0.12, 0.12]),
        drum(0.05, 0.03, [0, -tall / 2 - 0.06, 0.7 * long + 0.08], "z", 12),
    ]
    return named(**solids)


def parachute(rng: Rng, traits: Traits) -> Part:
    """Draw a parachute: a round canopy of gores, or a curved wing of cells, with lines down to a load or a harness."""
    round_, radius = rng.random() < 0.65, share(rng, 0.75, 0.9)
    drop = share(rng, 0.85, 1.1)
    load = [0, -drop, 0]
    cargo = (
        block(load, [0.26, 0.24, 0.26], 0.1)
        if rng.random() < 0.5
        else limb([[0, -drop - 0.12, 0], [0, -drop + 0.12, 0]], [0.1, 0.12])
    )
    if round_:
        tall, gores = share(rng, 0.42, 0.6) * radius, int(rng.integers(8, 13))
        arc = np.radians(np.linspace(0, 90, 8))
        outer = np.column_stack([radius * np.cos(arc), tall * np.sin(arc)])
        inner = outer[:-1][::-1] * [0.95, 0.9]
        cap = lathe(np.concatenate([[[0.0, 0.86 * tall]], inner, outer]), segments=48)
        turn = np.arctan2(cap.verts[:, 0], cap.verts[:, 2])
        lobes = np.abs(np.sin(turn * gores / 2)) ** 0.6
        swell = 0.9 + 0.1 * lobes
        cap = cap._replace(verts=cap.verts * np.column_stack([swell, swell, swell]))
        ends = [[0.88 * radius * np.sin(a), 0.03, 0.88 * radius * np.cos(a)] for a in np.arange(8) * np.pi / 4]
        canopy = [cap]
    else:
        bow, cells = share(rng, 0.3, 0.45), 9
        canopy = []
        for k in np.linspace(-1, 1, cells):
            cell = ellipsoid([0, 0, 0], [0.165 * radius, 0.09, 0.4], rings=7)
            canopy.append(moved(turned(cell, -50 * bow * 1.6 * k, "z"), [1.15 * radius * k, 0.3 - bow * k * k, 0]))
        ends = [[1.15 * radius * k, 0.28 - bow * k * k, z] for k in (-0.9, -0.4, 0.4, 0.9) for z in (-0.25, 0.25)]
    return named(
        canopy=canopy, rope=[bar(end, [0, -drop + 0.1, 0], radius=0.014, segments=5) for end in ends], body=[cargo]
    )
