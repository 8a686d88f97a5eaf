"""Draw what stands along streets, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.chassis import Solids, bar, block, drum, share, side
from meshdeform.nouns.families.parts import Part, box, ellipsoid, extrude, lathe, limb, moved, named, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = [
    "billboard", "fuelpump", "hydrant", "mailbox", "phonebooth", "roadblock", "signpost", "streetlight", "trafficlight",
]  # fmt: skip

STEM = ((0.3, 0.45), (1.2, 1.45), (2.2, 2.5))
"""Heights of short, plain and long posts."""


def streetlight(rng: Rng, traits: Traits) -> Part:
    """Draw a street light: a modern mast with an arm or two and flat heads, or an old post with a lantern."""
    height, radius = traits.draw(rng, "stem", *STEM), share(rng, 0.035, 0.05)
    old = rng.random() < 0.5
    solids: Solids = {
        "base": [drum(2.6 * radius, 0.05, [0, 0.05, 0], "y")],
        "stem": [
            lathe(
                [(1.7 * radius, 0.05), (1.5 * radius, 0.18), (radius, 0.24), (0.8 * radius, height + 0.02)], segments=12
            )
        ],
    }
    if not old:
        reach, lift = share(rng, 0.36, 0.52), share(rng, 0.06, 0.16)
        solids["arm"], solids["shade"], solids["lamp"] = [], [], []
        for turn in (0, 180)[: 1 + (rng.random() < 0.35)]:
            arm = bar(
                [0, height, 0], [0, height + 0.8 * lift, 0.35 * reach], [0, height + lift, reach], radius=0.7 * radius
            )
            end = np.array([0, height + lift, reach + 0.1])
            head = [
                box(end, [0.15, 0.07, 0.34], round_by=0.5, cells=4),
                box(end - [0, 0.035, 0], [0.11, 0.05, 0.26], round_by=0.4, cells=3),
            ]
            for name, each in zip(("arm", "shade", "lamp"), (arm, *head), strict=True):
                solids[name].append(turned(each, turn, "y"))
        return named(**solids)
    tall, wide = share(rng, 0.26, 0.34), share(rng, 0.1, 0.14)
    globe = rng.random() < 0.3
    lamp = [(0.6 * wide, 0.0), (wide, tall), (0.3 * wide, tall)]
    solids["lamp"] = [ellipsoid([0, height + 0.8 * wide, 0], 1.25 * wide, rings=10) if globe else
                      moved(lathe(lamp, segments=6), [0, height, 0])]  # fmt: skip
    top = height + (2 * wide if globe else tall)
    solids["shade"] = [moved(lathe([(0.9 * wide, 0), (1.35 * wide, 0.0), (0.5 * wide, 0.1), (0.2 * wide, 0.12)],
                                   segments=14 if globe else 6), [0, top - 0.01, 0])]  # fmt: skip
    solids["cap"] = [ellipsoid([0, top + 0.14, 0], 0.035, rings=6), drum(1.5 * radius, 0.03, [0, height, 0], "y", 12)]
    if rng.random() < 0.5:
        solids["arm"] = [bar([-0.2, height - 0.16, 0], [0.2, height - 0.16, 0], radius=0.022)]
    return named(**solids)


def trafficlight(rng: Rng, traits: Traits) -> Part:
    """Draw a traffic light: a box of three lamps under hoods, on a post or hung from an arm."""
    height, radius = traits.draw(rng, "stem", (0.1, 0.2), (0.8, 1.1), (1.8, 2.1)), share(rng, 0.045, 0.06)
    wide, size = share(rng, 0.17, 0.2), share(rng, 0.09, 0.105)
    tall = 6.6 * size
    low, round_by = height - 0.04, share(rng, 0.08, 0.4)
    solids: Solids = {
        "base": [drum(2.4 * radius, 0.05, [0, 0.05, 0], "y")],
        "stem": [bar([0, 0.05, 0], [0, height, 0], radius=radius)],
        "body": [box([0, low + tall / 2, 0], [2 * wide, tall, 0.22], round_by=round_by, cells=4)],
        "lamp": [], "shade": [],
    }  # fmt: skip
    if rng.random() < 0.4:
        solids["body"].append(block([0, low + tall / 2, -0.05], [2.7 * wide, tall + 0.16, 0.04]))
    for k in range(3):
        y = low + tall * (k + 0.5) / 3
        solids["lamp"].append(
            moved(turned(lathe([(size, 0), (size, 0.02), (0.5 * size, 0.045)], segments=16), 90, "x"), [0, y, 0.1])
        )
        arc = np.radians(np.linspace(0, 180, 9))
        rim = 1.2 * size * np.column_stack([np.cos(arc), np.sin(arc), 0 * arc])
        hood = [limb(rim + [0, y, 0.11 + d], np.full(9, 0.022), segments=6, samples=1) for d in (0.0, 0.05)]
        solids["shade"] += [*hood, block([0, y + 1.2 * size, 0.15], [1.5 * size, 0.03, 0.14])]
    return named(**solids)


def hydrant(rng: Rng, _: Traits) -> Part:
    """Draw a fire hydrant: a stout post with flanges and a domed cap with a nut, outlets at its sides and ahead."""
    girth, tall = share(rng, 0.24, 0.29), share(rng, 0.85, 1.05)
    body = [
        (1.5 * girth, 0.0),
        (1.5 * girth, 0.08),
        (girth, 0.1),
        (0.92 * girth, 0.76 * tall),
        (1.3 * girth, 0.78 * tall),
    ]
    body += [(1.3 * girth, 0.86 * tall), (girth, 0.87 * tall)]
    dome = [(1.06 * girth, 0.0), (1.0 * girth, 0.1), (0.7 * girth, 0.24), (0.3 * girth, 0.3)]
    y, reach = share(rng, 0.52, 0.62) * tall, share(rng, 0.08, 0.14)
    spouts = [drum(0.5 * girth, reach, [girth + 0.5 * reach, y, 0]), drum(0.64 * girth, 0.035, [girth + 1.3 * reach, y, 0]),
              drum(0.18 * girth, 0.03, [girth + 1.3 * reach + 0.06, y, 0], segments=6)]  # fmt: skip
    ahead = [
        drum(0.62 * girth, reach, [0, y - 0.04, girth + 0.4 * reach], "z"),
        drum(0.76 * girth, 0.035, [0, y - 0.04, girth + 1.2 * reach], "z"),
    ]
    return named(
        base=[drum(1.6 * girth, 0.035, [0, 0.035, 0], "y", 20)],
        body=[lathe(body, segments=20)],
        cap=[moved(lathe(dome, segments=20), [0, 0.85 * tall, 0])],
        spout=[*(each for one in spouts for each in pair(one)), *ahead],
        knob=[drum(0.24 * girth, 0.06, [0, 0.85 * tall + 0.33, 0], "y", 6),
              drum(0.18 * girth, 0.03, [0, y - 0.04, girth + 1.2 * reach + 0.06], "z", 6)],
    )  # fmt: skip


def mailbox(rng: Rng, traits: Traits) -> Part:
    """Draw a mailbox: one with a round top on a post, with a flag; or a street's box on legs; or a pillar box."""
    kind, stem = rng.random(), traits.draw(rng, "stem", (0.1, 0.2), (0.75, 0.95), (1.7, 2.0))
    if kind < 0.55:
        wide, tall, long = share(rng, 0.17, 0.21), share(rng, 0.2, 0.26), share(rng, 0.4, 0.5)
        arc = np.radians(np.linspace(0, 180, 9))
        tunnel = [(-wide, 0.0), (wide, 0.0), *zip(wide * np.cos(arc), tall + wide * np.sin(arc), strict=True)]
        shell = extrude(tunnel, 2 * long, bevel=0.02)
        flag = [
            bar([wide + 0.03, stem + 0.1, 0], [wide + 0.03, stem + 0.42, 0], radius=0.022),
            block([wide + 0.03, stem + 0.4, -0.06], [0.035, 0.1, 0.16]),
        ]
        return named(
            body=[moved(shell, [0, stem, 0])],
            stem=[block([0, stem / 2 + 0.02, 0], [0.12, stem + 0.04, 0.12]), block([0, stem - 0.02, 0], [1.4 * wide, 0.06, 1.7 * long])],
            door=[moved(extrude(np.array(tunnel) * 1.06, 0.05, bevel=0.2), [0, stem - 0.005, long])],
            panel=flag, handle=[block([0, stem + tall + 0.5 * wide, long + 0.04], [0.08, 0.05, 0.06])],
        )  # fmt: skip
    leg = 0.3 * stem
    if kind < 0.8:
        wide, deep, tall = share(rng, 0.28, 0.33), share(rng, 0.24, 0.3), share(rng, 0.62, 0.75)
        arc = np.radians(np.linspace(0, 180, 9))
        top = np.column_stack([deep * np.cos(arc), leg + tall + 0.8 * deep * np.sin(arc)])
        return named(
            body=[side(np.concatenate([[(-deep, leg), (deep, leg)], top]), 2 * wide, bevel=0.05)],
            stem=[each for z in (-0.7, 0.7) for each in pair(block([0.8 * wide, leg / 2 + 0.02, z * deep], [0.08, leg + 0.04, 0.08]))],
            door=[block([0, leg + tall + 0.1, 0.93 * deep], [1.5 * wide, 0.2, 0.12])],
            handle=[block([0, leg + tall + 0.16, deep + 0.04], [0.9 * wide, 0.045, 0.07])],
            panel=[block([0, leg + 0.45 * tall, deep], [1.1 * wide, 0.42 * tall, 0.04])],
        )  # fmt: skip
    girth, tall = share(rng, 0.26, 0.3), share(rng, 1.2, 1.4)
    pillar = [(0.95 * girth, 0.1), (0.95 * girth, tall)]
    cap = [(1.05 * girth, 0.0), (1.2 * girth, 0.04), (1.2 * girth, 0.1), (0.9 * girth, 0.18), (0.3 * girth, 0.23)]
    return named(
        base=[drum(1.12 * girth, 0.09, [0, 0.09, 0], "y", 20)], body=[lathe(pillar, segments=20)],
        cap=[moved(lathe(cap, segments=20), [0, tall - 0.02, 0])],
        stem=[drum(1.02 * girth, 0.03 + 0.02 * stem, [0, 0.2, 0], "y", 20)],
        door=[block([0, 0.52 * tall, 0.86 * girth], [0.9 * girth, 0.4 * tall, 0.14])],
        handle=[block([0, 0.84 * tall, 0.9 * girth], [1.0 * girth, 0.05, 0.12])],
    )  # fmt: skip


def phonebooth(rng: Rng, _: Traits) -> Part:
    """Draw a phone booth: an upright glazed box of bars under a domed or flat roof with a sign, a door ahead."""
    wide, tall = share(rng, 0.34, 0.38), share(rng, 1.5, 1.7)
    post, rows = 0.06, int(rng.integers(3, 7))
    floor, top = 0.1, 0.1 + tall
    panes = [block([0, floor + tall / 2, 0], [1.84 * wide, tall, 1.84 * wide])]
    bars = [
        block([x * wide, floor + tall / 2, z * wide], [2 * post, tall, 2 * post])
        for x in (-0.92, 0.92)
        for z in (-0.92, 0.92)
    ]
    bars += [block([0, y, 0], [1.9 * wide, 0.035, 1.9 * wide]) for y in np.linspace(floor + 0.34, top - 0.12, rows)]
    bars += [block([x * wide, floor + tall / 2, 0], [0.04, tall, 1.9 * wide]) for x in (-0.4, 0.4)]
    bars += [
        block([0, floor + 0.17, 0], [1.92 * wide, 0.34, 1.92 * wide]),
        block([0, top, 0], [2.06 * wide, 0.2, 2.06 * wide]),
    ]
    dome = ellipsoid([0, top + 0.06, 0], [1.04 * wide, 0.2, 1.04 * wide], rings=10)
    square = np.abs(dome.verts[:, [0, 2]]) / (1.04 * wide)
    grow = 1 / np.maximum(0.72, np.maximum(square.max(1) / np.maximum(np.hypot(*square.T), 1e-9), 0))
    dome = dome._replace(verts=dome.verts * np.column_stack([grow, 0 * grow + 1, grow]))
    flat = block([0, top + 0.12, 0], [2.16 * wide, 0.12, 2.16 * wide])
    return named(
        base=[block([0, 0.05, 0], [2.16 * wide, 0.12, 2.16 * wide])],
        window=panes, body=bars,
        roof=[dome if rng.random() < 0.6 else flat],
        panel=[block([0, top, 0], [1.5 * wide, 0.11, 2.12 * wide]), block([0, top, 0], [2.12 * wide, 0.11, 1.5 * wide])],
        door=[block([0.66 * wide, floor + 0.5 * tall, 0.98 * wide], [0.05, 0.16, 0.08]),
              *pair(block([0.72 * wide, floor + 0.5 * tall, 0.94 * wide], [0.06, 0.96 * tall, 0.09]))],
    )  # fmt: skip


def _arrow(long: float, tall: float, flip: bool) -> Part:
    """Return a board that ends in a point."""
    rim = [(-0.3 * long, -tall), (0.55 * long, -tall), (0.7 * long, 0), (0.55 * long, tall), (-0.3 * long, tall)]
    board = extrude(rim, 0.05, bevel=0.15)
    return turned(board, 180, "y") if flip else board


def signpost(rng: Rng, traits: Traits) -> Part:
    """Draw a signpost: boards that point both ways on a post, or a round, square or three-cornered road sign."""
    height, kind = traits.draw(rng, "stem", (0.3, 0.45), (0.95, 1.15), (1.9, 2.2)), rng.random()
    post = 0.045
    solids: Solids = {"base": [drum(0.12, 0.03, [0, 0.03, 0], "y", 14)], "body": []}
    if kind < 0.6:
        count, tall = int(rng.integers(1, 4)), share(rng, 0.085, 0.11)
        for k in range(count):
            board = turned(_arrow(share(rng, 0.6, 0.85), tall, k % 2 == 1), share(rng, -25, 25), "y")
            board = turned(moved(board, [0, 0, 0.05]), 0 if kind < 0.4 else share(rng, -60, 60), "y")
            solids["body"].append(moved(board, [0, height + 0.04 - 2.5 * tall * (k - count + 1), 0.0]))
        top = height + 2.5 * tall * count
        solids["stem"] = [block([0, top / 2, 0], [0.1, top, 0.1])]
        solids["cap"] = [lathe([(0.085, top - 0.02), (0.085, top + 0.02), (0.02, top + 0.09)], segments=4)]
        return named(**solids)
    size = share(rng, 0.28, 0.36)
    corners, first = ((4, 45), (4, 0), (3, 90), (3, -90), (8, 22.5), (24, 0))[int(rng.integers(6))]
    angle = np.radians(first + np.arange(corners) * 360 / corners)
    rim = size * np.column_stack([np.cos(angle), np.sin(angle)]) * (1.25 if corners < 5 else 1.0)
    y = height + 0.8 * size
    solids["body"] = [
        moved(extrude(rim, 0.06, bevel=0.2), [0, y, 0.05]),
        moved(extrude(0.82 * rim, 0.06, bevel=0.2), [0, y, 0.075]),
    ]
    solids["stem"] = [bar([0, 0, 0], [0, y + 0.5 * size, 0], radius=post)]
    return named(**solids)


def billboard(rng: Rng, traits: Traits) -> Part:
    """Draw a billboard: a broad framed board on one stout post or on two to four legs, with lamps and a walk below."""
    height = traits.draw(rng, "legs", (0.08, 0.16), (0.65, 0.85), (1.5, 1.75))
    wide, tall = share(rng, 0.85, 1.0), share(rng, 0.36, 0.46)
    count = int(rng.integers(1, 4))
    y, deep = height + tall, 0.1
    legs = [
        block([x * wide, height / 2 + 0.25 * tall, -0.06], [0.12, height + 0.5 * tall, 0.12])
        for x in np.linspace(-0.6, 0.6, count)
    ]
    if count == 1:
        legs = [lathe([(0.13, 0.0), (0.12, height + 0.1)], segments=14)]
    rails = [*pair(block([wide, y, 0], [0.08, 2 * tall + 0.08, 0.16])),
             *(block([0, y + s * tall, 0], [2 * wide + 0.08, 0.08, 0.16]) for s in (-1, 1))]  # fmt: skip
    solids: Solids = {"body": [block([0, y, 0], [2 * wide, 2 * tall, deep])], "frame": rails, "leg": legs}
    if rng.random() < 0.7:
        solids["frame"] = [*rails, block([0, height - 0.04, 0.14], [2 * wide, 0.04, 0.24])]
        solids["lamp"] = []
        for x in (-0.55, 0.0, 0.55):
            solids["lamp"] += [
                bar([x * wide, height, 0.06], [x * wide, height + 0.06, 0.34], radius=0.022),
                block([x * wide, height + 0.08, 0.35], [0.16, 0.07, 0.09], 0.3),
            ]
    return named(**solids)


def fuelpump(rng: Rng, _: Traits) -> Part:
    """Draw a fuel pump: an upright box with a screen, or a rounded old one with a globe; a hose with a nozzle."""
    wide, deep, tall = share(rng, 0.28, 0.34), share(rng, 0.2, 0.25), share(rng, 1.0, 1.2)
    old = rng.random() < 0.45
    top = 0.08 + tall
    y, x = 0.62 * tall, wide + 0.05
    hose = [
        [x, y + 0.2, 0],
        [x + 0.14, y - 0.1, 0.05],
        [x + 0.12, 0.3 * tall, 0.08],
        [x + 0.02, 0.24 * tall, 0.1],
        [x + 0.04, y - 0.12, 0.12],
    ]
    solids: Solids = {
        "base": [block([0, 0.05, 0], [2.3 * wide, 0.12, 2.5 * deep])],
        "body": [box([0, 0.08 + tall / 2, 0], [2 * wide, tall, 2 * deep], round_by=0.45 if old else 0.1, cells=6)],
        "top": [ellipsoid([0, top + 0.2, 0], [0.2, 0.2, 0.13], rings=10), drum(0.12, 0.05, [0, top + 0.02, 0], "y", 14)] if old else
               [block([0, top + 0.1, 0], [2.2 * wide, 0.22, 2.1 * deep])],
        "screen": [drum(0.72 * wide, 0.04, [0, 0.74 * tall, deep], "z", 20)] if old else
                  [block([0, 0.78 * tall, deep], [1.5 * wide, 0.26 * tall, 0.06]), block([0, 0.5 * tall, deep], [1.5 * wide, 0.1 * tall, 0.05]),
                   block([0, 0.24 * tall, deep], [1.5 * wide, 0.28 * tall, 0.04])],
        "rope": [limb(hose, [0.035] * 5, segments=8, samples=3)],
        "handle": [block([x, y, 0.1], [0.1, 0.26, 0.09], 0.3), bar([x, y + 0.04, 0.1], [x + 0.02, y + 0.2, 0.22], [x, y + 0.12, 0.34], radius=(0.05, 0.04, 0.025))],
    }  # fmt: skip
    return named(**solids)


def roadblock(rng: Rng, traits: Traits) -> Part:
    """Draw a road block: boards between two A-shaped legs, or a bar on two feet, often with lamps on top."""
    tall = traits.draw(rng, "legs", (0.2, 0.28), (0.72, 0.88), (1.4, 1.6))
    wide, boards = share(rng, 0.66, 0.82), int(rng.integers(1, 4))
    high = share(rng, 0.17, 0.21)
    solids: Solids = {"body": [], "leg": []}
    for k in range(boards):
        y = tall - 0.5 * high + 0.16 - k * 1.45 * high
        solids["body"].append(block([0, y, 0.06], [2 * wide, high, 0.06]))
        stripes = [
            moved(turned(block([0, 0, 0], [0.12, 1.1 * high, 0.03]), -24, "z"), [x * wide, y, 0.095])
            for x in (-0.66, -0.22, 0.22, 0.66)
        ]
        solids["body"] += stripes
    if rng.random() < 0.6:
        for z in (-0.28, 0.28):
            solids["leg"] += pair(bar([0.78 * wide, tall + 0.06, 0], [0.78 * wide, 0.03, z], radius=0.04))
    else:
        solids["leg"] = pair(block([0.78 * wide, tall / 2 + 0.06, 0], [0.1, tall + 0.12, 0.07]))
        solids["foot"] = pair(block([0.78 * wide, 0.05, 0], [0.14, 0.1, 0.6]))
    if rng.random() < 0.6:
        top = tall + 0.2
        solids["lamp"] = pair(drum(0.085, 0.04, [0.6 * wide, top + 0.06, 0.06], "z")) + pair(
            block([0.6 * wide, top - 0.03, 0.06], [0.1, 0.08, 0.08])
        )
    return named(**solids)
