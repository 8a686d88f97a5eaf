"""Draw other kinds of houses, churches, castles, tall buildings, tents, columns and gravestones; their doors face +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block, roundel, spread
from meshdeform.nouns.families.buildings import arch, pyramid
from meshdeform.nouns.families.dungeon import arched, around
from meshdeform.nouns.families.parts import (
    Part,
    box,
    ellipsoid,
    extrude,
    lathe,
    limb,
    moved,
    named,
    pair,
    stretched,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits
from meshdeform.nouns.families.walls import column_of, hat, house_of, merlons, onion, panes, roof_of, shaft

__all__: list[str] = []

_ROOF, _TOWER = ((0.12, 0.18), (0.42, 0.6), (1.05, 1.3)), ((0.05, 0.12), (0.5, 0.7), (1.4, 1.65))


def cottage(rng: Rng, traits: Traits) -> Part:
    """Draw a cottage: low walls, a steep roof along its front, a door between windows, a chimney on its gable."""
    width, wall, depth, rise = *rng.uniform([1.2, 0.5, 0.8], [1.6, 0.62, 1.0]), traits.draw(rng, "roof", *_ROOF)
    solids = house_of(
        (width, wall, depth),
        "side",
        rise,
        door=(0.24, 0.8 * wall),
        columns=int(rng.integers(2, 4)) * 2 - 1,
        arched=rng.random() < 0.4,
    )
    return named(**solids, chimney=block([0.44 * width, 0, -0.1], [0.24, wall + 1.1 * rise + 0.12, 0.26], 0.08))


def two_storey_house(rng: Rng, traits: Traits) -> Part:
    """Draw a house of two floors with rows of windows, a hipped or gabled roof, a porch over its door."""
    width, wall, depth, rise = *rng.uniform([1.0, 0.95, 0.8], [1.4, 1.15, 1.05]), 0.8 * traits.draw(rng, "roof", *_ROOF)
    solids = house_of(
        (width, wall, depth), str(rng.choice(["hip", "front", "side"])), rise, door=(0.24, 0.42), columns=3, rows=2
    )
    front = depth / 2 + 0.22
    porch = [
        block([0, 0.48, depth / 2 + 0.13], [0.56, 0.06, 0.34], 0.1),
        *pair(bar([0.22, 0.04, front], [0.22, 0.5, front], 0.03)),
    ]
    return named(
        **solids | {"body": [*solids["body"], *porch]},
        chimney=block([0.3 * width, wall - 0.1, -0.2 * depth], [0.18, 0.75 * rise + 0.4, 0.18], 0.08),
    )


def l_shaped_house(rng: Rng, traits: Traits) -> Part:
    """Draw a house with a wing toward +Z: two gabled roofs that meet, a door in the corner between them."""
    width, wall, depth, rise = *rng.uniform([1.4, 0.55, 0.7], [1.7, 0.8, 0.85]), 0.85 * traits.draw(rng, "roof", *_ROOF)
    side, wing, reach = int(rng.choice([-1, 1])), rng.uniform(0.6, 0.7), rng.uniform(0.45, 0.65)
    rows = 1 if wall < 0.68 else 2
    solids = house_of((width, wall, depth), "side", rise, door=(0.22, 0.42), columns=4, rows=rows)
    shift = np.array([side * (width - wing) / 2, 0, (depth + reach) / 2 - 0.02])
    more = house_of((wing, wall - 0.005, reach), "front", rise * 0.94, door=(0.0, 0.1), columns=1, rows=rows)
    ridge = roof_of("front", wing, reach + depth, 0.94 * rise, wall)
    solids["body"] += [moved(part, shift) for part in more["body"]]
    solids["roof"] += [moved(part, shift - [0, 0, depth / 2]) for part in ridge]
    solids["window"] += [moved(part, shift) for part in more["window"]]
    solids["door"] = [moved(part, [-side * 0.12 * width, 0, 0]) for part in solids["door"]]
    return named(**solids, chimney=block([-side * 0.36 * width, wall, 0], [0.18, rise + 0.16, 0.2], 0.08))


def modern_house(rng: Rng, traits: Traits) -> Part:
    """Draw a modern house: two shifted flat-roofed blocks, wide windows, a slab on posts before the door."""
    width, wall, depth, thick = (
        *rng.uniform([1.3, 0.5, 0.8], [1.6, 0.6, 1.0]),
        traits.draw(rng, "roof", (0.02, 0.03), (0.06, 0.1), (0.3, 0.4)),
    )
    side, share = int(rng.choice([-1, 1])), rng.uniform(0.55, 0.75)
    upper, x = share * width, side * (1 - share) * width / 2
    body = [
        block([0, 0, 0], [width, wall, depth], 0.03, 3),
        block([x + 0.1 * side, wall, 0.08], [upper, wall, 0.85 * depth], 0.03, 3),
    ]
    roof = [
        block([0, wall - 0.01, 0], [width + 0.1, 0.06 + 0.3 * thick, depth + 0.12], 0.1),
        block([x + 0.1 * side, 2 * wall - 0.01, 0.08], [upper + 0.14, thick, 0.85 * depth + 0.16], 0.1),
    ]
    front, top = depth / 2, 0.08 + 0.425 * depth
    windows = [
        block([x + 0.1 * side, wall + 0.12, top], [0.75 * upper, 0.3, 0.08], 0.1),
        block([side * 0.2 * width, 0.1, front], [0.5 * width, 0.32, 0.08], 0.1),
    ]
    windows += [block([s * width / 2, 0.16, 0], [0.08, 0.26, 0.5 * depth], 0.1) for s in (1, -1)]
    windows += [
        block([x + 0.1 * side + s * upper / 2, wall + 0.14, 0.08], [0.08, 0.26, 0.4 * depth], 0.1) for s in (1, -1)
    ]
    return named(
        body=body, roof=roof, window=windows, door=block([-side * 0.3 * width, 0, front], [0.24, 0.42, 0.1], 0.1)
    )


def town_house(rng: Rng, traits: Traits) -> Part:
    """Draw a town house: narrow, three or four floors of windows, a steep gable toward the street with a dormer."""
    width, depth, floors, rise = (
        *rng.uniform([0.7, 0.8], [0.9, 1.0]),
        int(rng.integers(3, 5)),
        traits.draw(rng, "roof", *_ROOF),
    )
    wall = 0.4 * floors
    kind = str(rng.choice(["front", "side", "flat"]))
    solids = house_of((width, wall, depth), kind, rise, door=(0.22, 0.34), columns=3, rows=floors, eaves=0.05)
    bands = [block([0, 0.4 * k + 0.39, 0], [width + 0.05, 0.04, depth + 0.05], 0.1) for k in range(floors - 1)]
    return named(
        **solids | {"body": [*solids["body"], *bands]},
        chimney=block([-0.3 * width, wall - 0.05, -0.2 * depth], [0.18, 0.8 * rise + 0.3, 0.16], 0.08),
    )


def cathedral(rng: Rng, traits: Traits) -> Part:
    """Draw a cathedral: a high nave with low aisles, two towers in front with spires, a round window over the door."""
    width, length, wall = rng.uniform([0.5, 1.5, 0.7], [0.6, 1.9, 0.85])
    roof, rise = traits.draw(rng, "roof", (0.08, 0.12), (0.34, 0.44), (0.8, 0.95)), traits.draw(rng, "tower", *_TOWER)
    half, top, front = 0.2, wall + 0.2 + rise, length / 2
    body = [
        block([0, 0, 0], [width, wall, length], 0.03, 3),
        block([0, 0, -0.05], [2.1 * width, 0.5 * wall, 0.92 * length], 0.03, 3),
    ]
    spire = [
        shaft(half, top, 0, 4, foot=1.06),
        pyramid(half + 0.03, rng.uniform(0.4, 0.7), [0, top - 0.01, 0]),
        block([0, top - 0.05, 0], [2 * half + 0.08, 0.07, 2 * half + 0.08], 0.1),
    ]
    towers = [side for part in spire for side in pair(moved(part, [0.5 * width + half - 0.06, 0, front - 0.05]))]
    pane = turned(arch(0.14, 0.24, 0.1, [0, 0, 0]), 90, "y")
    windows = [side for z in spread(0.36 * length, 4) for side in pair(moved(pane, [width / 2, 0.6 * wall, z]))]
    windows += [side for z in spread(0.36 * length, 4) for side in pair(moved(pane, [1.05 * width, 0.12 * wall, z]))]
    return named(
        body=body,
        roof=roof_of("front", width, length - 0.1, roof, wall, 0.05),
        tower=towers,
        window=[*windows, roundel([0, 0.78 * wall, front], 0.16, 0.1)],
        door=arch(0.26, 0.42, 0.14, [0, 0, front]),
    )


def chapel(rng: Rng, traits: Traits) -> Part:
    """Draw a chapel: a small gabled hall, a little open tower with a bell on its ridge, a cross, arched windows."""
    width, length, wall = rng.uniform([0.7, 0.95, 0.5], [0.85, 1.25, 0.65])
    roof, rise = traits.draw(rng, "roof", *_ROOF), 0.5 * traits.draw(rng, "tower", *_TOWER)
    front, level = length / 2 - 0.14, wall + 0.8 * roof
    tower = [
        block([0, wall, front], [0.26, 0.8 * roof + rise, 0.26], 0.05, 3),
        pyramid(0.18, 0.24, [0, level + rise - 0.01, front]),
    ]
    peak = level + rise + 0.22
    cross = [
        block([0, peak - 0.06, front], [0.04, 0.3, 0.04], 0.1),
        block([0, peak + 0.1, front], [0.18, 0.04, 0.04], 0.1),
    ]
    solids = house_of((width, wall, length), "front", roof, door=(0.26, 0.75 * wall), columns=2, arched=True)
    pane = turned(arch(0.16, 0.6 * wall, 0.1, [0, 0, 0]), 90, "y")
    solids["window"] = [side for z in spread(0.3 * length, 3) for side in pair(moved(pane, [width / 2, 0.2 * wall, z]))]
    return named(**solids, tower=tower, cross=cross)


def onion_church(rng: Rng, traits: Traits) -> Part:
    """Draw a church with onion domes on round drums over a square hall, one large or with four small around it."""
    half, wall, roof = *rng.uniform([0.42, 0.55], [0.52, 0.75]), 0.4 * traits.draw(rng, "roof", *_ROOF)
    rise, many = 0.7 * traits.draw(rng, "tower", *_TOWER), rng.random() < 0.6
    drums = [
        (0.0, 0.0, 0.2, rise),
        *((x, z, 0.11, 0.6 * rise) for x in (-0.6 * half, 0.6 * half) for z in (-0.6 * half, 0.6 * half)),
    ][: 5 if many else 1]
    towers, cross = [], []
    for x, z, radius, tall in drums:
        top = wall + 0.8 * roof + tall
        towers += [
            moved(part, [x, 0, z])
            for part in (shaft(radius, top, wall - 0.1, 14, foot=1.03), onion(1.3 * radius, top - 0.01))
        ]
        peak = top + 2.0 * radius
        cross += [
            block([x, peak - 0.05, z], [0.035, 0.26, 0.035], 0.1),
            block([x, peak + 0.1, z], [0.15, 0.035, 0.035], 0.1),
        ]
    solids = house_of(
        (2 * half, wall, 2 * half), "hip", roof, door=(0.26, 0.6 * wall), columns=3, eaves=0.06, arched=True
    )
    return named(**solids, tower=towers, cross=cross)


def fairy_tale_castle(rng: Rng, traits: Traits) -> Part:
    """Draw a fairy-tale castle: slim round towers of all heights with pointed roofs around a tall keep, a gate."""
    half, wall, rise = *rng.uniform([0.55, 0.4], [0.68, 0.55]), traits.draw(rng, "tower", *_TOWER)
    spots = [
        (x, z, r, wall + rise * s)
        for (x, z), r, s in zip(
            [(-1, 1), (1, 1), (-1, -1), (1, -1)], rng.uniform(0.15, 0.2, 4), rng.uniform(0.6, 1.0, 4), strict=True
        )
    ]
    spots += [(0.35, -0.2, 0.17, wall + 1.6 * rise + 0.2), (-0.4, -0.3, 0.13, wall + 1.25 * rise + 0.15)]
    towers = [
        moved(part, [x * half, 0, z * half])
        for x, z, r, top in spots
        for part in (
            shaft(r, top, 0, 14),
            shaft(1.2 * r, top + 0.12, top - 0.04, 14, foot=0.9),
            hat(1.35 * r, rng.uniform(0.4, 0.55), top + 0.12, 14),
        )
    ]
    keep = [
        block([0, 0, -0.1 * half], [half, wall + 0.5 * rise + 0.2, half], 0.04, 3),
        pyramid(0.5 * half + 0.04, 0.35, [0, wall + 0.5 * rise + 0.19, -0.1 * half]),
    ]
    teeth = [
        turned(block([x, wall - 0.01, half], [0.13, 0.12, 0.09], 0.1), 90 * k, "y")
        for k in range(4)
        for x in spread(0.6 * half, 4)
    ]
    return named(
        tower=towers,
        body=[block([0, 0, 0], [2 * half, wall, 2 * half], 0.03, 3), *teeth],
        keep=keep,
        door=[
            arch(0.3, 0.34, 0.14, [0, 0, half]),
            *pair(block([0.22, 0, half + 0.02], [0.12, wall + 0.1, 0.16], 0.06)),
        ],
    )


def square_castle(rng: Rng, traits: Traits) -> Part:
    """Draw a fort: square towers with battlements at the corners of a wall, a gatehouse, a keep inside."""
    half, wall, rise = *rng.uniform([0.6, 0.4], [0.75, 0.52]), 0.5 * traits.draw(rng, "tower", *_TOWER)
    top, thick = wall + rise, rng.uniform(0.18, 0.22)
    one = [
        shaft(thick, top, 0, 4, foot=1.05),
        block([0, top - 0.02, 0], [2.3 * thick, 0.09, 2.3 * thick], 0.05),
        *merlons(thick, top + 0.05, 8, 4, 0.1),
    ]
    towers = [moved(part, [x, 0, z]) for x in (-half, half) for z in (-half, half) for part in one]
    walls = [turned(block([0, 0, half], [2 * half, wall, 0.16], 0.04), 90 * k, "y") for k in range(4)]
    teeth = [
        turned(block([x, wall - 0.01, half + 0.03], [0.12, 0.12, 0.08], 0.1), 90 * k, "y")
        for k in range(4)
        for x in spread(0.5 * half, 3)
    ]
    keep = [shaft(0.26, top + 0.1, 0, 4), *merlons(0.24, top + 0.09, 8, 4, 0.1)]
    return named(
        tower=towers,
        body=[*walls, *teeth, block([0, 0.01, 0], [2 * half, 0.08, 2 * half], 0.05)],
        keep=[moved(part, [0, 0, -0.2 * half]) for part in keep],
        door=[
            arch(0.26, 0.32, 0.14, [0, 0, half + 0.08]),
            *pair(block([0.2, 0, half + 0.06], [0.13, wall + 0.12, 0.2], 0.06)),
        ],
    )


def tower_block(rng: Rng, _: Traits) -> Part:
    """Draw a tower block: a plain high slab with rows of windows on all sides, a flat roof with a hut, an entrance."""
    width, depth, floors, columns = (
        *rng.uniform([0.6, 0.5], [1.0, 0.65]),
        int(rng.integers(6, 9)),
        int(rng.integers(2, 4)),
    )
    tall = 0.26 * floors
    windows = panes(width, depth, 0.2, tall - 0.03, columns, floors - 1, share=(0.66, 0.5))
    top = [
        block([0, tall - 0.01, 0], [width + 0.05, 0.07, depth + 0.05], 0.1),
        block([0.1 * width, tall, 0], [0.4 * width, 0.2, 0.5 * depth], 0.05),
    ]
    return named(
        body=block([0, 0, 0], [width, tall, depth], 0.02, 3),
        window=windows,
        top=[*top, *([bar([0.2 * width, tall, 0], [0.2 * width, tall + 0.6, 0], 0.02)] if rng.random() < 0.5 else [])],
        door=block([0, 0, depth / 2], [0.4 * width, 0.17, 0.16], 0.1),
    )


def glass_tower(rng: Rng, _: Traits) -> Part:
    """Draw a glass tower: smooth, round, square or twisted, slimmer toward its top, with a line for each few floors."""
    sides, half, tall, twist = (
        int(rng.choice([4, 4, 24, 6])),
        rng.uniform(0.34, 0.44),
        rng.uniform(1.9, 2.5),
        rng.choice([0, 0, rng.uniform(30, 80)]),
    )
    waist, bands = rng.uniform(0.55, 0.95), int(rng.integers(8, 13))
    share = ((np.arange(bands)[:, None] + [0.0, 0.45, 0.86, 0.9, 0.97]) / (bands - 0.14)).ravel()[:-2]
    radius = half * (1 - (1 - waist) * share**1.5) * (1 - 0.05 * (np.arange(len(share)) % 5 > 2))
    body = lathe(np.stack([radius * (1.4 if sides == 4 else 1), 0.08 + tall * share], 1), segments=sides)
    turn = np.radians(twist) * np.clip((body.verts[:, 1] - 0.08) / tall, 0, 1) + np.pi / 4
    x, y, z = body.verts.T
    body = Part(np.stack([x * np.cos(turn) + z * np.sin(turn), y, z * np.cos(turn) - x * np.sin(turn)], 1), body.faces)
    tip = [
        block([0, tall + 0.06, 0], [half * waist, 0.14, half * waist], 0.1),
        bar([0, tall, 0], [0, tall + rng.uniform(0.25, 0.6), 0], 0.03),
    ]
    return named(body=[body, block([0, 0, 0], [2.5 * half, 0.1, 2.5 * half], 0.08, 4)], top=tip)


def round_lighthouse(rng: Rng, _: Traits) -> Part:
    """Draw a lighthouse on a rock: a plain tapering tower, a railed gallery, a glazed lantern under a dome."""
    foot, waist, tall = rng.uniform([0.34, 0.2, 1.2], [0.42, 0.26, 1.7])
    sides, top = int(rng.choice([24, 8])), tall + 0.2
    rock = [
        stretched(ellipsoid([0, 0, 0], 0.62, rings=6), 1, 0.42, 0.9),
        *(ellipsoid([x, -0.04, z], rng.uniform(0.16, 0.28), rings=4) for x, z in rng.uniform(-0.5, 0.5, (3, 2))),
    ]
    tower = lathe([(foot + (waist - foot) * t**0.8, 0.1 + tall * t) for t in np.linspace(0, 1, 7)], segments=sides)
    deck = [
        lathe([(waist, top - 0.16), (waist + 0.12, top - 0.08), (waist + 0.12, top)], segments=sides),
        *around(bar([0, top, waist + 0.09], [0, top + 0.16, waist + 0.09], 0.014, 4), 10),
    ]
    turn = np.linspace(0, 2 * np.pi, 17)
    deck.append(
        limb(
            np.stack([(waist + 0.09) * np.sin(turn), 0 * turn + top + 0.16, (waist + 0.09) * np.cos(turn)], 1),
            [0.018] * 17,
            segments=4,
            samples=1,
        )
    )
    lantern = [
        shaft(0.66 * waist, top + 0.3, top - 0.02, 10, foot=1),
        hat(0.85 * waist, 0.2, top + 0.3, 20, bow=-0.5),
        ellipsoid([0, top + 0.52, 0], 0.05, rings=6),
    ]
    windows = [
        turned(block([0, 0.1 + t * tall, foot + (waist - foot) * t**0.8 - 0.02], [0.1, 0.15, 0.08], 0.2), a, "y")
        for t, a in ((0.35, 0), (0.6, 150), (0.75, 0), (0.5, 250))
    ]
    return named(
        base=rock,
        tower=[tower, *deck],
        lantern=lantern,
        window=windows,
        door=arch(0.2, 0.32, 0.14, [0, 0.14, foot - 0.02]),
    )


def _sails(reach: float, wide: float, count: int, hub: float, front: float, spin: float, lattice: bool) -> list[Part]:
    """Return the sails of a mill about a hub."""
    blade = [
        block([0.06 + wide / 2, 0.2, 0], [wide, reach - 0.2, 0.04], 0.1),
        bar([0, 0, 0.01], [0, reach, 0.01], 0.028, 6),
    ]
    if lattice:
        blade += [
            block([0.06 + wide / 2, y, 0.02], [wide + 0.02, 0.025, 0.05], 0.1)
            for y in np.linspace(0.2, reach - 0.03, 6)
        ]
    return [moved(turned(part, spin + 360 * k / count, "z"), [0, hub, front]) for k in range(count) for part in blade]


def tower_mill(rng: Rng, traits: Traits) -> Part:
    """Draw a mill: a round stone tower with windows, a pointed cap, four latticed sails at its top."""
    foot, waist, tall = rng.uniform([0.36, 0.26, 0.95], [0.46, 0.32, 1.3])
    sail = traits.draw(rng, "sail", (0.3, 0.4), (0.8, 0.95), (1.4, 1.6))
    hub, front = tall + 0.06, waist + 0.2
    body = lathe([(foot, 0), (foot + (waist - foot) * 0.5, 0.5 * tall), (waist, tall)], segments=20)
    windows = [
        turned(block([0, t * tall, foot + (waist - foot) * t - 0.02], [0.13, 0.17, 0.08], 0.2), a, "y")
        for t, a in ((0.5, 40), (0.5, -40), (0.62, 180))
    ]
    return named(
        body=body,
        roof=hat(waist + 0.07, rng.uniform(0.3, 0.45), tall - 0.01, 20, bow=float(rng.choice([0, -0.4]))),
        axle=bar([0, hub, 0], [0, hub, front + 0.05], 0.06),
        sail=_sails(sail, 0.2, 4, hub, front, rng.uniform(30, 60), lattice=True),
        door=arch(0.22, 0.34, 0.14, [0, 0, foot - 0.03]),
        window=windows,
    )


def wind_turbine(rng: Rng, traits: Traits) -> Part:
    """Draw a wind turbine: three long slim blades about the nose of a long box on a tall slender mast."""
    tall, sail = rng.uniform(1.7, 2.2), traits.draw(rng, "sail", (0.3, 0.4), (0.85, 1.05), (1.5, 1.75))
    mast = lathe([(0.2, 0), (0.2, 0.05), (0.1, 0.07), (0.055, tall)], segments=16)
    blade = extrude(
        [(-0.035, 0.02), (0.04, 0.02), (0.1, 0.18 * sail), (0.03, sail), (0.0, sail), (-0.045, 0.2 * sail)], 0.05
    )
    spin = rng.uniform(0, 120)
    sails = [moved(turned(turned(blade, 15, "y"), spin + 120 * k, "z"), [0, tall + 0.04, 0.28]) for k in range(3)]
    nose = turned(lathe([(0.09, 0), (0.085, 0.08), (0.05, 0.16), (0.01, 0.19)], segments=14), 90, "x")
    return named(
        body=mast,
        roof=box([0, tall + 0.04, 0], [0.17, 0.17, 0.46], round_by=0.35, cells=4),
        axle=moved(nose, [0, tall + 0.04, 0.2]),
        sail=sails,
    )


def wind_pump(rng: Rng, traits: Traits) -> Part:
    """Draw a wind pump: a wheel of many short blades and a vane on a tower of four braced bars."""
    tall, sail, count = (
        rng.uniform(1.4, 1.8),
        0.5 * traits.draw(rng, "sail", (0.25, 0.35), (0.85, 1.0), (1.6, 1.9)),
        int(rng.integers(10, 15)),
    )
    legs = around(bar([0.36, 0.04, 0.36], [0.06, tall, 0.06], 0.028, 6), 4)
    for low, high in ((0.05, 0.4), (0.4, 0.72)):
        a, b = (0.36 - 0.3 * low, low * tall), (0.36 - 0.3 * high, high * tall)
        legs += around(bar([-a[0], a[1], a[0]], [b[0], b[1], b[0]], 0.018, 4), 4) + around(
            bar([-b[0], b[1], b[0]], [b[0], b[1], b[0]], 0.018, 4), 4
        )
    blade = turned(
        extrude([(-0.03, 0.08), (0.03, 0.08), (0.16 * sail + 0.03, sail), (-0.16 * sail - 0.03, sail)], 0.03), 20, "y"
    )
    sails = [moved(turned(blade, 360 * k / count, "z"), [0, tall + 0.05, 0.2]) for k in range(count)]
    vane = [
        bar([0, tall + 0.05, 0.2], [0, tall + 0.05, -0.5], 0.03, 6),
        moved(
            turned(extrude([(-0.2, -0.12), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.12)], 0.03), 90, "y"),
            [0, tall + 0.05, -0.6],
        ),
    ]
    return named(body=legs, roof=vane, axle=roundel([0, tall + 0.05, 0.18], 0.09, 0.12), sail=sails)


def dome_tent(rng: Rng, _: Traits) -> Part:
    """Draw a dome tent: a low dome of cloth over crossed poles, an opening with flaps, pegs and ropes."""
    half, tall, long = rng.uniform([0.65, 0.55, 0.75], [0.85, 0.7, 1.0])
    bow = np.linspace(0, np.pi, 15)
    rim = np.stack([np.cos(bow), np.sin(bow) ** 0.9], 1)
    cloth = stretched(turned(lathe(rim[:7], segments=4), 45, "y"), 1.41 * half, tall, 1.41 * long)
    poles = [
        limb(
            np.stack([s * 1.02 * half * rim[:, 0], 1.03 * tall * rim[:, 1], 1.02 * long * rim[:, 0]], 1),
            [0.03] * 15,
            segments=6,
            samples=1,
        )
        for s in (1, -1)
    ]
    door = turned(arch(0.8 * half, 0.75 * tall, 0.1, [0, 0, 0]), -24, "x")
    ropes = [
        bar([s * 0.8 * half, 0.55 * tall, z * 0.8 * long], [s * 1.3 * half, 0.02, z * 1.2 * long], 0.015, 4)
        for s in (1, -1)
        for z in (1, -1)
    ]
    return named(body=cloth, door=moved(door, [0, 0, 0.98 * long]), pole=[*poles, *ropes])


def circus_tent(rng: Rng, _: Traits) -> Part:
    """Draw a circus tent: a round wall of striped cloth under a roof that swings up to one or two masts with flags."""
    radius, wall, rise = rng.uniform([0.75, 0.35, 0.5], [0.9, 0.5, 0.75])
    count = int(rng.integers(10, 15))
    body = lathe([(radius, 0), (radius, 0.5 * wall), (radius, wall)], segments=4 * count)
    x, y, z = body.verts.T
    fold = 1 + 0.03 * np.cos(count * np.arctan2(x, z))
    roof = hat(1.1 * radius, rise, wall, 2 * count, bow=0.6)
    hem = [
        lathe(
            [
                (1.1 * radius, wall - 0.08),
                (1.12 * radius, wall - 0.07),
                (1.12 * radius, wall + 0.03),
                (1.06 * radius, wall + 0.06),
            ],
            segments=2 * count,
        )
    ]
    top = wall + rise
    poles = [
        bar([0, top - 0.1, 0], [0, top + 0.34, 0], 0.025, 6),
        moved(extrude([(0, 0), (0.26, 0.08), (0, 0.16)], 0.03), [0.01, top + 0.16, 0]),
    ]
    flaps = pair(turned(block([0.16, 0, radius + 0.02], [0.18, 0.9 * wall, 0.05], 0.2), 4, "y"))
    return named(body=[Part(np.stack([x * fold, y, z * fold], 1), body.faces), roof, *hem], pole=poles, door=flaps)


def pavilion_tent(rng: Rng, _: Traits) -> Part:
    """Draw a canopy on four posts, as over a stall or for a feast, or a knight's tent: square walls under a peak."""
    half, tall, rise, walls = *rng.uniform([0.6, 0.8, 0.35], [0.75, 1.0, 0.6]), rng.random() < 0.5
    roof = [hat(half + 0.1, rise, tall, 4, bow=0.35)]
    hem = [
        turned(
            moved(
                extrude([(-0.11, 0.12), (-0.11, 0.03), (0, -0.04), (0.11, 0.03), (0.11, 0.12)], 0.03),
                [x, tall - 0.1, half + 0.08],
            ),
            90 * k,
            "y",
        )
        for k in range(4)
        for x in spread(half - 0.08, 5)
    ]
    posts = [bar([s * half, 0.03, z * half], [s * half, tall, z * half], 0.035, 6) for s in (1, -1) for z in (1, -1)]
    tip = [
        bar([0, tall + rise - 0.05, 0], [0, tall + rise + 0.2, 0], 0.025, 6),
        ellipsoid([0, tall + rise + 0.2, 0], 0.05, rings=6),
    ]
    cloth = [block([0, 0, 0], [1.96 * half, tall + 0.02, 1.96 * half], 0.03, 3)] if walls else []
    door = {"door": [*pair(turned(block([0.14, 0, half], [0.2, 0.85 * tall, 0.06], 0.2), 5, "y"))]} if walls else {}
    return named(body=[*cloth, *roof, *hem], pole=[*posts, *tip], **door)


def square_pillar(rng: Rng, _: Traits) -> Part:
    """Draw a square pillar: a plain or panelled shaft on a plinth under a capital, some topped by a ball."""
    half, tall, foot = rng.uniform([0.15, 1.2, 0.14], [0.24, 1.8, 0.2])
    body = [
        block([0, 0.1, 0], [2 * half, tall, 2 * half], 0.06, 4),
        *around(block([0, 0.3, half], [1.2 * half, tall - 0.42, 0.07], 0.3, 3), 4),
    ]
    base = [
        block([0, 0, 0], [2 * half + foot, 0.16, 2 * half + foot], 0.1, 3),
        block([0, 0.14, 0], [2 * half + 0.07, 0.08, 2 * half + 0.07], 0.2),
    ]
    top = [
        block([0, tall, 0], [2 * half + 0.07, 0.09, 2 * half + 0.07], 0.2),
        block([0, tall + 0.08, 0], [2 * half + foot, 0.12, 2 * half + foot], 0.1, 3),
    ]
    return named(
        body=body, base=base, top=[*top, *([ellipsoid([0, tall + 0.36, 0], 0.18)] if rng.random() < 0.3 else [])]
    )


def plain_column(rng: Rng, _: Traits) -> Part:
    """Draw a smooth round column: swollen a little, of one piece or of drums, on a round or square foot."""
    wide, tall, drums = *rng.uniform([0.16, 1.3], [0.26, 1.9]), int(rng.choice([0, 0, 4, 5]))
    pieces = max(drums, 3)
    share = ((np.arange(pieces)[:, None] + [0.0, 0.45, 0.93, 0.95, 0.98]) / (pieces - 0.07)).ravel()[:-2]
    radius = wide * (1.02 - 0.16 * share**2) * (1 - 0.07 * ((np.arange(len(share)) % 5 > 2) & (drums > 0)))
    body = lathe(np.stack([radius, 0.2 + tall * share], 1), segments=24)
    feet = [
        block([0, 0, 0], [3.1 * wide, 0.14, 3.1 * wide], 0.1),
        lathe([(1.4 * wide, 0.12), (1.45 * wide, 0.17), (1.25 * wide, 0.22)], segments=24),
    ]
    top = tall + 0.2
    tops = [
        lathe(
            [(0.95 * wide, top - 0.06), (1.05 * wide, top - 0.04), (1.05 * wide, top), (1.45 * wide, top + 0.09)],
            segments=24,
        ),
        block([0, top + 0.08, 0], [3.1 * wide, 0.12, 3.1 * wide], 0.1, 3),
    ]
    return named(body=body, base=feet[rng.choice([0, 1]) :], top=tops)


def plain_gravestone(rng: Rng, _: Traits) -> Part:
    """Draw a plain gravestone: a slab with a round, shouldered or level top, leaning or not, with a mound before it."""
    wide, tall, deep = rng.uniform([0.55, 0.75, 0.14], [0.8, 1.1, 0.24])
    rise = float(rng.choice([0.06, 0.18, wide / 2]))
    slab = [arched(wide, tall, rise, deep)]
    if rng.random() < 0.4:
        slab.append(moved(arched(0.6 * wide, 0.34, 0.28 * wide, 0.96 * deep), [0, tall - 0.2, 0]))
    lines = [
        block([0, y * tall, deep / 2], [w * wide, 0.05, 0.05], 0.2)
        for y, w in ((0.66, 0.5), (0.54, 0.66), (0.42, 0.58))
    ]
    tilt = rng.choice([0.0, rng.uniform(-9, 9)])
    mound = (
        moved(stretched(ellipsoid([0, 0, 0], 1, rings=10), 0.55 * wide + 0.1, 0.14, 0.6), [0, 0, 0.5])
        if rng.random() < 0.5
        else block([0, 0, 0], [wide + 0.2, 0.12, deep + 0.24], 0.15, 4)
    )
    return named(
        base=[mound, *(turned(part, tilt, "z") for part in slab)], line=[turned(part, tilt, "z") for part in lines]
    )


def pillar_gravestone(rng: Rng, _: Traits) -> Part:
    """Draw a tall gravestone: a small obelisk, a broken column or an urn on a stepped block with a plate."""
    half, tall, kind = *rng.uniform([0.2, 0.7], [0.26, 1.0]), int(rng.integers(3))
    steps = [
        block([0, 0.12 * k, 0], [2 * half + 0.34 - 0.14 * k, 0.13, 2 * half + 0.34 - 0.14 * k], 0.08, 3)
        for k in range(2)
    ]
    body = [
        *steps,
        block([0, 0.22, 0], [2 * half, 0.42, 2 * half], 0.05, 3),
        block([0, 0.62, 0], [2 * half + 0.1, 0.08, 2 * half + 0.1], 0.15),
    ]
    if kind == 0:
        body += [
            turned(
                lathe([(1.2 * half, 0.69), (0.75 * half, 0.69 + tall), (0.03, 0.69 + tall + 0.6 * half)], segments=4),
                45,
                "y",
            )
        ]
    elif kind == 1:
        post = column_of([0, 0.68, 0], 0.8 * tall, 0.6 * half)
        crack = 0.3 * post.verts[:, 0] * (post.verts[:, 1] > 0.66 + 0.7 * tall)
        body.append(Part(post.verts + np.array([0, 1, 0]) * crack[:, None], post.faces))
    else:
        body.append(
            moved(
                lathe(
                    [
                        (0.5 * half, 0),
                        (0.25 * half, 0.08),
                        (0.8 * half, 0.3),
                        (0.9 * half, 0.42),
                        (0.5 * half, 0.52),
                        (0.6 * half, 0.56),
                        (0.15 * half, 0.66),
                    ],
                    segments=20,
                ),
                [0, 0.69, 0],
            )
        )
    return named(
        base=body,
        line=[
            block([0, 0.28, half], [1.3 * half, 0.28, 0.06], 0.2),
            *(block([0, y, half + 0.02], [0.9 * half, 0.04, 0.05], 0.2) for y in (0.36, 0.46)),
        ],
    )


KINDS = {
    "castle": (fairy_tale_castle, square_castle),
    "church": (cathedral, chapel, onion_church),
    "column": (square_pillar, plain_column),
    "gravestone": (plain_gravestone, pillar_gravestone),
    "house": (cottage, two_storey_house, l_shaped_house, modern_house, town_house),
    "lighthouse": (round_lighthouse,),
    "skyscraper": (tower_block, glass_tower),
    "tent": (dome_tent, circus_tent, pavilion_tent),
    "windmill": (tower_mill, wind_turbine, wind_pump),
}
