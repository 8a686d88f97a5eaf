"""Draw seats and beds, and other kinds of chairs, sofas, stools, benches and beds; all face +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.boards import bar, block, chair_of, posts, roundel, slats, spread
from meshdeform.nouns.families.dungeon import around
from meshdeform.nouns.families.parts import (
    Part,
    box,
    curved,
    disc,
    divided,
    ellipsoid,
    lathe,
    limb,
    moved,
    named,
    pair,
    turned,
)
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["crib", "hammock", "ottoman", "throne"]

_CHAIR_LEGS, _CHAIR_BACK = ((0.2, 0.28), (0.5, 0.65), (1.1, 1.35)), ((0.2, 0.28), (0.7, 0.9), (1.45, 1.75))


def _chair_sizes(rng: Rng, traits: Traits) -> tuple[float, float, float, float]:
    """Draw the width and the depth of a chair's seat, its level, and the rise of its back."""
    width, depth = rng.uniform(0.72, 0.88), rng.uniform(0.7, 0.82)
    return width, depth, traits.draw(rng, "legs", *_CHAIR_LEGS), traits.draw(rng, "back", *_CHAIR_BACK)


def throne(rng: Rng, traits: Traits) -> Part:
    """Draw a throne: a heavy chair with solid arms that end in balls, a very high pointed back, on a step."""
    width, depth = rng.uniform(0.85, 1.0), rng.uniform(0.75, 0.9)
    leg = traits.draw(rng, "legs", (0.08, 0.14), (0.4, 0.5), (1.0, 1.2))
    rise = traits.draw(rng, "back", (0.3, 0.4), (1.2, 1.5), (2.3, 2.7))
    rear, arm, level = -depth / 2 + 0.08, 0.3, leg + 0.1
    seat = [
        block([0, level, 0], [width, 0.16, depth], 0.15, 3),
        block([0, level + 0.14, 0.05], [width - 0.3, 0.12, depth - 0.22], 0.4, 4),
    ]
    back = [
        block([0, level, rear], [width, rise, 0.16], 0.06, 3),
        block([0, level + 0.2, rear + 0.07], [width - 0.26, 0.7 * rise, 0.1], 0.3, 3),
    ]
    peak = str(rng.choice(["point", "round", "spikes"]))
    top = level + rise
    if peak == "point":
        back.append(
            moved(turned(lathe([(0.5 * width, 0), (0.02, 0.4 * width)], segments=4), 45, "y"), [0, top - 0.01, rear])
        )
        back[-1] = Part((back[-1].verts - [0, 0, rear]) * [1.41, 1, 0.2] + [0, 0, rear], back[-1].faces)
    elif peak == "round":
        back.append(roundel([0, top - 0.02, rear], 0.5 * width, 0.15, segments=28))
    else:
        back += [
            block([x, top - 0.02, rear], [0.13, 0.22 + 0.2 * (1 - abs(x) / width * 2), 0.12], 0.1)
            for x in spread(width / 2 - 0.08, 5)
        ]
    side = width / 2 - 0.05
    arms = [
        *pair(block([side, level + 0.1, 0.04], [0.12, arm, depth - 0.1], 0.1)),
        *pair(block([side, level + 0.08 + arm, 0.06], [0.18, 0.09, depth], 0.3, 3)),
    ]
    knobs = pair(ellipsoid([side, level + arm + 0.2, depth / 2], 0.09, rings=8)) + pair(
        ellipsoid([side, top + 0.08, rear], 0.09, rings=8)
    )
    base = block([0, 0, 0.08], [width + 0.36, 0.1, depth + 0.4], 0.15)
    return named(
        seat=seat,
        back=back,
        arm=arms,
        leg=[*posts(side, depth / 2 - 0.08, 0.09, level + 0.02, 0.075, square=True)],
        knob=knobs,
        base=base,
    )


def ottoman(rng: Rng, traits: Traits) -> Part:
    """Draw an ottoman: a square, oblong or round padded block with a cushioned top, a button or a seam, on short feet."""
    width, depth, tall, round_ = (
        rng.uniform(0.8, 1.3),
        rng.uniform(0.75, 0.9),
        rng.uniform(0.36, 0.5),
        rng.random() < 0.4,
    )
    leg = traits.draw(rng, "legs", (0.02, 0.04), (0.12, 0.2), (0.6, 0.75))
    top = leg + tall
    if round_:
        width = depth
        seat = [
            disc(depth / 2, leg, top, edge=0.1),
            disc(depth / 2 + 0.015, leg + 0.4 * tall, leg + 0.46 * tall, edge=0.02),
        ]
        legs = posts(0.32 * depth, 0.32 * depth, 0, leg + 0.03, 0.05)
    else:
        seat = [
            block([0, leg, 0], [width, tall - 0.1, depth], 0.12, 4),
            block([0, top - 0.17, 0], [width + 0.06, 0.19, depth + 0.06], 0.5, 6),
        ]
        legs = posts(width / 2 - 0.1, depth / 2 - 0.1, 0, leg + 0.03, 0.05)
    count = int(rng.integers(1, 4))
    buttons = [
        moved(disc(0.04, 0, 0.03, edge=0.01), [x, top + 0.01, z])
        for x in spread(0.28 * width, count)
        for z in spread(0.28 * depth, min(count, 2))
    ]
    return named(seat=seat, leg=legs, button=buttons)


def crib(rng: Rng, traits: Traits) -> Part:
    """Draw a crib: a mattress between four railed sides of upright bars, the head end higher, on legs or on rockers."""
    width, length, high = rng.uniform(0.62, 0.75), rng.uniform(1.1, 1.3), rng.uniform(0.5, 0.62)
    leg = traits.draw(rng, "legs", (0.06, 0.1), (0.28, 0.38), (0.9, 1.1))
    x, z, top = width / 2, length / 2, leg + high
    frame = [block([0, leg, 0], [width, 0.08, length], 0.1), *posts(x, z, 0.0, top + 0.08, 0.045)]
    upright = bar([x, leg + 0.1, 0], [x, top, 0], 0.02, 4)
    rails = [rail for y in (leg + 0.1, top) for rail in pair(block([x, y, 0], [0.06, 0.05, length], 0.2))]
    rails += [side for place in spread(z - 0.1, 9) for side in pair(moved(upright, [0, 0, place]))]
    ends = [(-z, 0.14), (z, 0.02)]
    solid = rng.random() < 0.5
    for place, more in ends:
        frame.append(block([0, top + more - 0.04, place], [width, 0.08, 0.07], 0.3))
        if solid:
            frame.append(block([0, leg + 0.04, place], [width - 0.06, high + more - 0.08, 0.05], 0.2))
        else:
            rails += slats(x - 0.1, leg + 0.1, top + more, place, 5, 0.018)
    legs = posts(x, z, 0, leg, 0.05)
    if rng.random() < 0.35:
        bow = np.linspace(-1, 1, 7)
        legs += [
            limb(np.c_[1.2 * x * bow, 0.03 + 0.14 * bow**2, 0 * bow + place], [[0.03, 0.04]] * 7, segments=6, samples=1)
            for place in (z, -z)
        ]
    mattress = block([0, leg + 0.07, 0], [width - 0.06, 0.14, length - 0.06], 0.4, 4)
    pillow = ellipsoid([0, leg + 0.23, -0.36 * length], [0.3 * width, 0.06, 0.12], rings=6)
    return named(frame=frame, mattress=mattress, rail=rails, leg=legs, pillow=pillow)


def hammock(rng: Rng, _: Traits) -> Part:
    """Draw a hammock along X: a sagging cloth, drawn together at its ends or spread by bars, between posts or on a stand."""
    half, wide, sag, spread_ = (
        rng.uniform(0.75, 0.95),
        rng.uniform(0.28, 0.38),
        rng.uniform(0.28, 0.42),
        rng.random() < 0.5,
    )
    across, level, out = np.linspace(-1, 1, 13), rng.uniform(0.75, 0.95), rng.uniform(0.4, 0.55)
    girth = wide * (np.ones(13) if spread_ else 0.15 + 0.85 * np.sqrt(np.clip(1 - across**2, 0, 1)))
    path = np.stack([half * across, level - sag * (1 - across**2), 0 * across], 1)
    lap = limb(path, np.stack([np.full(13, 0.035), girth], 1), segments=12, samples=1)
    cloth = Part(lap.verts + np.array([0, 1, 0]) * (0.5 * lap.verts[:, 2:] ** 2 / wide), lap.faces)
    end, rise = half + out, level + 0.16
    ropes = []
    for x, tip in ((half, end), (-half, -end)):
        places = spread(wide - 0.04, 4) if spread_ else [0.02]
        ropes += [bar([x, level + (0.5 * z**2 / wide), z], [tip, rise, 0], 0.018, 6) for z in places]
    bars = pair(bar([half, level, wide], [half, level, -wide], 0.03)) if spread_ else []
    if rng.random() < 0.5:
        poles = pair(bar([end, 0.07, 0], [end, rise + 0.15, 0], 0.07))
        legs = pair(disc(0.2, 0, 0.08))
        legs = [moved(part, [s * end, 0, 0]) for part, s in zip(legs, (1, -1), strict=True)]
    else:
        beam = [[end, rise + 0.04, 0], [0.72 * end, 0.16, 0], [-0.72 * end, 0.16, 0], [-end, rise + 0.04, 0]]
        poles = [limb(beam, [0.05] * 4, segments=8, samples=3)]
        legs = pair(bar([0.55 * end, 0.05, 0.4], [0.55 * end, 0.05, -0.4], 0.05))
    return named(body=cloth, rope=[*ropes, *bars], pole=poles, leg=legs)


def dining_chair(rng: Rng, traits: Traits) -> Part:
    """Draw a wooden chair with upright or level slats in its back, with arms or without."""
    width, depth, level, rise = _chair_sizes(rng, traits)
    kind = str(rng.choice(["slats", "rungs", "round"]))
    return named(
        **chair_of(
            width,
            depth,
            level,
            rise,
            back=kind,
            arms=rng.random() < 0.3,
            legs=str(rng.choice(["square", "round"])),
            thick=0.05,
            slab=0.09,
        )
    )


def armed_chair(rng: Rng, traits: Traits) -> Part:
    """Draw a chair with arms, a padded seat and a padded back."""
    width, depth, level, rise = _chair_sizes(rng, traits)
    solids = chair_of(
        width,
        depth,
        0.85 * level,
        0.9 * rise,
        arms=True,
        legs=str(rng.choice(["square", "splayed"])),
        thick=0.06,
        slab=0.14,
    )
    return named(**solids)


def shell_chair(rng: Rng, traits: Traits) -> Part:
    """Draw a chair with a moulded shell for seat and back on four thin spread legs."""
    width, depth, level, rise = _chair_sizes(rng, traits)
    path = curved(
        [
            [0, level + 0.02, depth / 2],
            [0, level, 0.1 * depth],
            [0, level + 0.02, -0.32 * depth],
            [0, level + 0.16, -0.47 * depth],
            [0, level + rise, -0.62 * depth],
        ],
        samples=3,
    )
    half = width / 2 * np.interp(np.arange(len(path)), [0, 3, 8, 12], [0.9, 1, 1, 0.8])
    shell = limb(path, np.stack([np.full(len(path), 0.045), half], 1), segments=14, samples=1)
    dish = Part(shell.verts + np.array([0, 0.35, 0.12]) * shell.verts[:, :1] ** 2 / width, shell.faces)
    return named(seat=divided(dish, "seat/12/back"), leg=posts(0.26 * width, 0.24 * depth, 0, level, 0.03, splay=0.14))


def rocking_chair(rng: Rng, traits: Traits) -> Part:
    """Draw a rocking chair: a high slatted back, arms, legs on two curved runners."""
    width, depth, level, rise = _chair_sizes(rng, traits)
    solids = chair_of(
        width,
        depth,
        0.75 * level + 0.1,
        rise + 0.15,
        back=str(rng.choice(["slats", "rungs"])),
        arms=True,
        legs="round",
        thick=0.045,
        slab=0.08,
        lean=0.2,
    )
    bow = np.linspace(-1, 1, 9)
    runner = np.stack([0 * bow + width / 2 - 0.05, 0.02 + 0.17 * bow**2, 0.78 * bow - 0.06], 1)
    runners = pair(limb(runner, [0.04] * 9, segments=8, samples=1))
    solids["leg"] = [moved(part, [0, 0.06, 0]) for part in solids["leg"]] + runners
    return named(**solids)


def folding_chair(rng: Rng, traits: Traits) -> Part:
    """Draw a folding chair: two crossed pairs of bars, a thin seat, a board or cloth between the tops of the longer."""
    width, depth, level, rise = _chair_sizes(rng, traits)
    x, thick = width / 2 - 0.04, 0.035
    legs = pair(bar([x, thick, -depth / 2 - 0.05], [x, level, depth / 2 - 0.1], thick))
    legs += pair(bar([x - 0.07, thick, depth / 2], [x - 0.07, level + 0.02, -0.36 * depth], thick))
    legs += [bar([-x, 0.12, z], [x, 0.12, z], 0.025, 6) for z in (0.34 * depth, -0.4 * depth)]
    top = level + rise
    back = pair(bar([x - 0.07, level, -0.34 * depth], [x - 0.07, top, -0.5 * depth], thick))
    back += [
        box(
            [0, top - 0.15 * s * rise, (-0.5 + 0.024 * s) * depth],
            [2 * x - 0.1, 0.2 * rise, 0.05],
            round_by=0.3,
            cells=3,
        )
        for s in ((0.7, 2.4) if rng.random() < 0.5 else (0.9,))
    ]
    seats = [block([0, level, z * depth], [width - 0.06, 0.05, 0.15 * depth], 0.3) for z in np.linspace(-0.36, 0.4, 5)]
    return named(seat=seats, back=back, leg=legs)


_SOFA_BACK = ((0.02, 0.08), (0.4, 0.52), (1.0, 1.2))


def cushioned_sofa(rng: Rng, traits: Traits) -> Part:
    """Draw a sofa with two or three cushions on its seat and against its back, thin or thick arms, on feet."""
    count, depth, thick = int(rng.integers(2, 4)), rng.uniform(0.8, 0.9), rng.uniform(0.1, 0.24)
    rise = traits.draw(rng, "back", *_SOFA_BACK)
    wide = rng.uniform(0.56, 0.66)
    half, leg, level = count * wide / 2, rng.uniform(0.06, 0.2), 0.34
    places = spread(half - wide / 2, count)
    seat = [
        block([0, leg, 0], [2 * half, level - leg, depth], 0.1, 3),
        *(block([x, level - 0.02, 0.06], [wide - 0.02, 0.18, depth - 0.2], 0.4, 5) for x in places),
    ]
    back = [block([0, leg + 0.02, -depth / 2 + 0.08], [2 * half, level + rise - leg, 0.18], 0.25, 3)]
    back += [
        box([x, level + 0.14 + rise / 2, -depth / 2 + 0.24], [wide - 0.03, rise + 0.06, 0.18], round_by=0.45, cells=5)
        for x in places
    ]
    arm = block([half + thick / 2, leg, 0.02], [thick, 0.5, depth + 0.02], 0.3, 4)
    return named(seat=seat, back=back, arm=pair(arm), leg=posts(half, depth / 2 - 0.1, 0, leg + 0.02, 0.04))


def corner_sofa(rng: Rng, traits: Traits) -> Part:
    """Draw a sofa around a corner: a long seat and a shorter one toward +Z, with backs behind both."""
    long, short, depth, side = (
        rng.uniform(1.7, 2.0),
        rng.uniform(1.3, 1.6),
        rng.uniform(0.66, 0.76),
        int(rng.choice([-1, 1])),
    )
    rise, seat = traits.draw(rng, "back", *_SOFA_BACK), rng.uniform(0.3, 0.38)
    x, z = side * (long - depth) / 2, (short - depth) / 2
    seats = [
        block([0, 0.05, 0], [long, seat - 0.04, depth], 0.1, 4),
        block([x, 0.055, z + 0.01], [depth, seat - 0.05, short], 0.1, 4),
    ]
    count = int(rng.integers(2, 4))
    wide = (long - depth) / count
    seats += [
        block([-side * (depth / 2) + p, seat, 0.04], [wide - 0.02, 0.15, depth - 0.16], 0.4, 5)
        for p in spread((long - depth - wide) / 2, count)
    ]
    seats.append(block([x - side * 0.04, seat, z + 0.04], [depth - 0.16, 0.15, short - 0.16], 0.4, 5))
    backs = [block([0, 0.06, -depth / 2 + 0.09], [long, seat + rise, 0.2], 0.35, 4)]
    if rng.random() < 0.6:
        backs.append(block([side * (long / 2 - 0.09), 0.065, z], [0.2, seat + rise, short - 0.02], 0.35, 4))
    arm = block([-side * (long / 2 - 0.08), 0.06, 0.02], [0.2, seat + 0.22, depth], 0.35, 4)
    return named(seat=seats, back=backs, arm=[arm])


def chaise(rng: Rng, traits: Traits) -> Part:
    """Draw a sofa with one rolled arm and a back that falls toward its open end, on turned feet."""
    half, depth, side = rng.uniform(0.85, 1.0), rng.uniform(0.66, 0.78), int(rng.choice([-1, 1]))
    rise = traits.draw(rng, "back", *_SOFA_BACK)
    seat = [
        block([0, 0.16, 0], [2 * half, 0.2, depth], 0.3, 4),
        block([0, 0.33, 0.04], [2 * half - 0.1, 0.13, depth - 0.08], 0.45, 5),
    ]
    slab = box([0, 0, 0], [2 * half, 1, 0.17], round_by=0.1, cells=6)
    x, y, z = slab.verts.T
    share = (side * x / half + 1) / 2
    tall = 0.14 + rise * (0.15 + 0.85 * share**1.5)
    back = Part(np.stack([x, 0.3 + (y + 0.5) * tall, z - depth / 2 + 0.08], 1), slab.faces)
    roll = limb([[side * half, 0.62, -depth / 2 + 0.04], [side * half, 0.62, depth / 2]], [0.13, 0.13], segments=14)
    arm = [block([side * half, 0.2, 0], [0.16, 0.42, depth - 0.04], 0.2, 3), roll]
    return named(seat=seat, back=back, arm=arm, leg=posts(half - 0.1, depth / 2 - 0.08, 0, 0.18, 0.05))


_BED_BACK = ((0.02, 0.08), (0.42, 0.56), (1.15, 1.4))


def plain_bed(rng: Rng, traits: Traits) -> Part:
    """Draw a bed without a footboard: a thick mattress on a box, a folded blanket, one or two pillows, a headboard."""
    sleepers = int(rng.integers(1, 3))
    width, length, leg = 0.7 + 0.42 * (sleepers - 1), rng.uniform(1.6, 1.85), rng.uniform(0.08, 0.2)
    rise = traits.draw(rng, "back", *_BED_BACK)
    frame = block([0, leg, 0], [width, 0.18, length], 0.1, 3)
    mattress = block([0, leg + 0.16, 0.02], [width - 0.03, 0.2, length - 0.06], 0.35, 5)
    share = rng.uniform(0.45, 0.65)
    blanket = block([0, leg + 0.12, (0.5 - share / 2) * length + 0.01], [width + 0.05, 0.29, share * length], 0.3, 4)
    fold = block([0, leg + 0.36, (0.5 - share) * length + 0.06], [width + 0.03, 0.07, 0.2], 0.4)
    head = block([0, 0.02, -length / 2], [width + 0.08, leg + 0.36 + rise, 0.09], 0.2, 4)
    pillows = [
        box([x, leg + 0.42, -0.38 * length], [0.46, 0.14, 0.28], round_by=0.5, cells=5)
        for x in spread(0.24 * (sleepers - 1), sleepers)
    ]
    return named(
        frame=frame,
        mattress=mattress,
        blanket=[blanket, fold],
        back=head,
        pillow=pillows,
        leg=posts(width / 2 - 0.06, length / 2 - 0.06, 0, leg + 0.02, 0.045, square=True),
    )


def bunk_bed(rng: Rng, _: Traits) -> Part:
    """Draw a bunk bed: two beds one above the other between four posts, a ladder at one side, rails above."""
    width, length, low, gap = (
        rng.uniform(0.72, 0.85),
        rng.uniform(1.6, 1.8),
        rng.uniform(0.2, 0.3),
        rng.uniform(0.7, 0.85),
    )
    x, z = width / 2, length / 2
    solids: dict[str, list[Part]] = {
        "leg": posts(x, z, 0, low + gap + 0.5, 0.05, square=True),
        "frame": [],
        "mattress": [],
        "pillow": [],
        "blanket": [],
    }
    for level in (low, low + gap):
        solids["frame"].append(block([0, level, 0], [width + 0.04, 0.12, length], 0.15))
        solids["mattress"].append(block([0, level + 0.1, 0], [width - 0.05, 0.14, length - 0.06], 0.35, 4))
        solids["pillow"].append(box([0, level + 0.27, -0.38 * length], [0.6 * width, 0.1, 0.26], round_by=0.5, cells=4))
        solids["blanket"].append(block([0, level + 0.09, 0.16 * length], [width, 0.18, 0.58 * length], 0.3, 3))
    solids["back"] = [
        block([0, level + y, end], [width, 0.09, 0.05], 0.2)
        for level in (low, low + gap)
        for y in (0.24, 0.4)
        for end in (z, -z)
    ]
    solids["frame"] += [
        block([side * x, low + gap + y, 0.05 * length], [0.05, 0.07, 0.8 * length], 0.2)
        for side in (1, -1)
        for y in (0.26, 0.38)
    ]
    out, place = x + 0.09, 0.36 * length
    ladder = [bar([out, y, place - 0.14], [out, y, place + 0.14], 0.025, 6) for y in np.linspace(0.15, low + gap, 5)]
    solids["frame"] += [
        *ladder,
        *(bar([out, 0.03, place + s], [out, low + gap + 0.25, place + s], 0.03, 6) for s in (-0.14, 0.14)),
    ]
    return named(**solids)


def canopy_bed(rng: Rng, traits: Traits) -> Part:
    """Draw a four-poster: a wide bed with tall posts that carry a canopy, some with curtains at its corners."""
    width, length, level = rng.uniform(1.1, 1.3), rng.uniform(1.5, 1.7), rng.uniform(0.26, 0.34)
    rise = traits.draw(rng, "back", *_BED_BACK)
    x, z, top = width / 2, length / 2, level + rng.uniform(1.1, 1.35)
    legs = posts(x, z, 0, top, 0.05, square=rng.random() < 0.5)
    frame = [block([0, level - 0.08, 0], [width, 0.16, length], 0.1), block([0, 0.1, z], [width, 0.42, 0.07], 0.2)]
    if rng.random() < 0.6:
        frame.append(block([0, top - 0.06, 0], [width + 0.12, 0.12, length + 0.12], 0.15, 3))
    else:
        frame += [
            *pair(block([x, top - 0.05, 0], [0.07, 0.07, length], 0.1)),
            *(block([0, top - 0.05, s * z], [width, 0.07, 0.07], 0.1) for s in (1, -1)),
        ]
    curtain = [block([s * x, 0.12, e * (z - 0.08)], [0.07, top - 0.16, 0.18], 0.4, 3) for s in (1, -1) for e in (1, -1)]
    blankets = [
        block([0, level + 0.05, 0.18 * length], [width - 0.02, 0.23, 0.56 * length], 0.3, 3),
        *(curtain if rng.random() < 0.5 else []),
    ]
    pillows = pair(box([0.24 * width, level + 0.3, -0.36 * length], [0.42 * width, 0.13, 0.3], round_by=0.5, cells=4))
    return named(
        frame=frame,
        mattress=block([0, level + 0.06, 0], [width - 0.07, 0.2, length - 0.07], 0.35, 4),
        blanket=blankets,
        back=block([0, 0.06, -z], [width, level + 0.22 + rise, 0.08], 0.2, 3),
        pillow=pillows,
        leg=legs,
    )


_STOOL_LEGS = ((0.18, 0.26), (0.55, 0.75), (1.4, 1.7))


def plain_stool(rng: Rng, traits: Traits) -> Part:
    """Draw a wooden stool: a round or a square board on three or four legs, with rungs between them or without."""
    half, level, square = rng.uniform(0.3, 0.4), traits.draw(rng, "legs", *_STOOL_LEGS), rng.random() < 0.4
    slab, splay = rng.uniform(0.07, 0.12), rng.uniform(0.0, 0.14)
    seat = (
        block([0, level, 0], [2 * half, slab, 2 * half], 0.2, 5)
        if square
        else disc(half * 1.1, level, level + slab, edge=0.03)
    )
    count = 4 if square else int(rng.integers(3, 5))
    foot, top = np.array([0, 0.045, 0.9 * half + splay]), np.array([0, level + 0.03, 0.78 * half])
    scale = np.array([1, 1, 1.3 if square else 1])
    legs = around(bar(foot * scale, top * scale, 0.045, 12), count, 180 / count)
    if rng.random() < 0.6:
        y, z = ((0.6 * foot + 0.4 * top) * scale)[1:]
        rung = z * np.array([np.sin(np.pi / count), 0, np.cos(np.pi / count)])
        legs += around(bar(rung + [0, y, 0], rung * [-1, 1, 1] + [0, y, 0], 0.028, 6), count)
    return named(seat=seat, leg=legs)


def bar_stool(rng: Rng, traits: Traits) -> Part:
    """Draw a bar stool: a round padded seat on one post with a round foot and a ring for the feet, with or without a back."""
    radius, level = rng.uniform(0.3, 0.38), traits.draw(rng, "legs", *_STOOL_LEGS) + 0.35
    seat = [disc(radius, level, level + 0.14, edge=0.05)]
    post = lathe(
        [
            (0.34, 0.0),
            (0.34, 0.03),
            (0.1, 0.08),
            (0.05, 0.12),
            (0.05, 0.5 * level),
            (0.035, 0.5 * level + 0.02),
            (0.035, level + 0.02),
        ],
        segments=20,
    )
    turn = np.linspace(0, 2 * np.pi, 17)
    ring = [
        limb(
            np.stack([0.22 * np.sin(turn), 0 * turn + 0.36 * level, 0.22 * np.cos(turn)], 1),
            [0.022] * 17,
            segments=6,
            samples=1,
        )
    ]
    ring += [bar([-0.2, 0.36 * level, 0], [0.2, 0.36 * level, 0], 0.02, 6)]
    if rng.random() < 0.4:
        bow = np.linspace(-1.2, 1.2, 7)
        seat.append(
            limb(
                np.stack([radius * np.sin(bow), 0 * bow + level + 0.3, -radius * np.cos(bow)], 1),
                [[0.1, 0.04]] * 7,
                segments=8,
                samples=1,
            )
        )
        seat += pair(bar([0.16, level + 0.08, -0.8 * radius], [0.18, level + 0.26, -0.92 * radius], 0.025, 6))
    return named(seat=seat, leg=[post, *ring])


_BENCH_LEGS = ((0.08, 0.14), (0.38, 0.48), (1.0, 1.2))


def plain_bench(rng: Rng, traits: Traits) -> Part:
    """Draw a bench without a back: a thick board, or planks, on two slabs, crossed bars or four legs."""
    half, depth, level, kind = (
        rng.uniform(0.8, 1.1),
        rng.uniform(0.36, 0.48),
        traits.draw(rng, "legs", *_BENCH_LEGS),
        int(rng.integers(3)),
    )
    count = int(rng.choice([1, 3, 4]))
    wide = depth / count
    seat = [
        block([0, level, z], [2 * half, 0.1, wide - 0.03 * (count > 1)], 0.2, 5)
        for z in spread((depth - wide) / 2, count)
    ]
    x = half - rng.uniform(0.14, 0.3)
    if kind == 0:
        legs = pair(block([x, 0, 0], [0.16, level + 0.02, 0.85 * depth], 0.06, 3))
    elif kind == 1:
        legs = [
            side for s in (1, -1) for side in pair(bar([x, 0.04, s * depth / 2], [x, level, -s * depth / 2], 0.045))
        ]
        legs.append(bar([-x, level / 2, 0], [x, level / 2, 0], 0.035))
    else:
        legs = [
            *posts(x, 0.36 * depth, 0, level + 0.02, 0.05, square=True),
            *pair(block([x, 0.3 * level, 0], [0.06, 0.07, 0.7 * depth], 0.1)),
        ]
    return named(seat=seat, leg=legs)


def garden_bench(rng: Rng, traits: Traits) -> Part:
    """Draw a garden bench: planks for a seat, a straight slatted back, arms at both ends, four legs."""
    solids = chair_of(
        rng.uniform(1.5, 2.0),
        0.62,
        traits.draw(rng, "legs", *_BENCH_LEGS),
        rng.uniform(0.5, 0.65),
        back=str(rng.choice(["rungs", "solid"])),
        arms=True,
        thick=0.05,
        slab=0.08,
        lean=0.14,
    )
    if rng.random() < 0.5:
        low, rear = solids["seat"][0].verts[:, 1].max(), -0.62 / 2 + 0.05
        half = float(solids["seat"][0].verts[:, 0].max()) - 0.05
        rails = [
            bar([-half, y, rear - 0.14 * s], [half, y, rear - 0.14 * s], 0.045)
            for y, s in ((low + 0.1, 0.1), (low + 0.56, 1.0))
        ]
        solids["back"] = [*rails, *slats(half, low, low + 0.56, rear, 12, 0.025, 0.14)]
    return named(**solids)


KINDS = {
    "bed": (plain_bed, bunk_bed, canopy_bed),
    "bench": (plain_bench, garden_bench),
    "chair": (dining_chair, armed_chair, shell_chair, rocking_chair, folding_chair),
    "sofa": (cushioned_sofa, corner_sofa, chaise),
    "stool": (plain_stool, bar_stool),
}
