"""Draw fruit, vegetables, things from a kitchen, and plants."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, box, disc, ellipsoid, join, lathe, limb, moved, turned
from meshdeform.nouns.families.traits import Rng, Traits


def _fluted(part: Part, count: int, depth: float) -> Part:
    """Press `count` furrows, `depth` times the radius, into the sides of a solid of revolution."""
    x, y, z = part.verts.T
    girth = 1 - depth * (0.5 - 0.5 * np.cos(count * np.arctan2(x, z)))
    return Part(np.stack([x * girth, y, z * girth], 1), part.faces)


def apple(rng: Rng, traits: Traits) -> Part:
    """Draw an apple: a round fruit, widest above the middle, with dimples at both ends, a stalk and a leaf."""
    girth, height = rng.uniform(0.6, 0.74), rng.uniform(0.5, 0.64)
    stem = traits.draw(rng, "stem", (0.0, 0.04), (0.3, 0.4), (0.85, 1.05))
    turn = np.linspace(0.0, np.pi, 25)
    radius = girth * np.sin(turn) ** 0.8 * (1 - 0.16 * np.cos(turn / 2) ** 4)
    dimple = np.where(turn > np.pi / 2, 0.34, 0.14) * np.exp(-((radius / (0.36 * girth)) ** 2))
    flesh = lathe(np.stack([radius, height * (1 - np.cos(turn)) - np.sign(turn - np.pi / 2) * dimple], 1))
    low, lean = 2 * height - 0.36, rng.uniform(0.04, 0.1)
    top = [lean, 2 * height - 0.02 + stem, 0]
    stalk = limb([[0, low, 0], [0, 2 * height - 0.1, 0], top], [0.07, 0.065, 0.085], segments=8)
    leaf = turned(ellipsoid([0.28, 0, 0], [0.29, 0.06, 0.15], rings=10), rng.uniform(20, 32), "z")
    return join([flesh, stalk, moved(turned(leaf, rng.uniform(-25, 25), "y"), [0.02, 2 * height - 0.06, 0])])


def banana(rng: Rng, _: Traits) -> Part:
    """Draw a banana: a thick crescent with five edges, both ends up, the stalk at its right."""
    bow, girth, sweep = rng.uniform(0.78, 0.95), rng.uniform(0.25, 0.31), rng.uniform(60, 74)
    turn = np.radians(np.linspace(-sweep, sweep, 9))
    path = [[bow * np.sin(t), -bow * np.cos(t), 0] for t in turn]
    share = np.linspace(-1, 1, 9)
    flesh = limb(path, girth * (1 - 0.62 * np.abs(share) ** 2.6), segments=5, samples=3)
    end = np.array(path[-1])
    stalk = limb(np.stack([np.array(path[-2]), end, end + [0.06, 0.22, 0]]), [girth * 0.45, 0.08, 0.095], segments=6)
    return join([flesh, stalk])


def burger(rng: Rng, _: Traits) -> Part:
    """Draw a burger: two halves of a bun, between them a wavy leaf, a square of cheese and a patty that stand out."""
    girth, dome, patty = rng.uniform(0.7, 0.84), rng.uniform(0.38, 0.6), rng.uniform(0.14, 0.26)
    parts = [disc(girth * 0.94, 0.0, 0.24, edge=0.09), disc(girth * 1.06, 0.2, 0.24 + patty, edge=0.07)]
    level = 0.24 + patty
    cheese = turned(box([0, 0, 0], [girth * 1.66, 0.09, girth * 1.66]), 45 + rng.uniform(-12, 12), "y")
    reach = np.hypot(cheese.verts[:, 0], cheese.verts[:, 2])
    sag = np.stack([0 * reach, -0.3 * np.clip(reach - girth, 0, None), 0 * reach], 1)
    parts.append(moved(Part(cheese.verts + sag, cheese.faces), [0, level + 0.03, 0]))
    leaf = lathe(
        [(0.3, 0.05), (girth * 1.14, 0.05), (girth * 1.18, 0.1), (girth * 1.14, 0.16), (0.3, 0.16)], segments=48
    )
    x, y, z = leaf.verts.T
    wave = 0.055 * np.sin(8 * np.arctan2(x, z)) * np.clip(np.hypot(x, z) / girth, 0, 1)
    parts.append(Part(np.stack([x, y + wave + level, z], 1), leaf.faces))
    turn = np.linspace(0.0, np.pi / 2, 9)
    top = level + 0.2
    bun = [(girth * np.cos(t) ** 0.8, top + dome * np.sin(t)) for t in turn]
    parts.append(lathe([(girth * 0.9, top - 0.07), *bun]))
    start = rng.uniform(0, 60)
    for number in range(9):
        away, around = (0.34, 120 * number) if number < 3 else (0.62, 60 * number + 30)
        seed = ellipsoid([girth * away, top + dome * np.sqrt(1 - away**2), 0], [0.09, 0.06, 0.06], rings=6)
        parts.append(turned(seed, start + around, "y"))
    return join(parts)


def cake(rng: Rng, _: Traits) -> Part:
    """Draw a birthday cake: two round tiers on a plate, icing that drips from their edges, candles on top."""
    girth, low, high = rng.uniform(0.7, 0.92), rng.uniform(0.36, 0.56), rng.uniform(0.22, 0.44)
    upper = girth * rng.uniform(0.54, 0.76)
    top = 0.08 + low + high
    parts = [disc(girth * 1.2, 0.0, 0.12), disc(girth, 0.08, 0.06 + low), disc(upper, 0.0, top - 0.02)]
    for radius, level in ((girth, 0.08 + low), (upper, top)):
        icing = lathe(
            [(radius * 0.6, -0.16), (radius + 0.05, -0.16), (radius + 0.07, -0.04), (radius, 0.05)], segments=56
        )
        x, y, z = icing.verts.T
        drip = np.where(y < -0.1, 0.09 * np.cos(round(12 * radius) * np.arctan2(x, z)), 0.0)
        parts.append(Part(np.stack([x, y + drip + level, z], 1), icing.faces))
    start, tall = rng.uniform(0, 72), rng.uniform(0.3, 0.4)
    for number in range(5):
        candle = limb([[upper * 0.66, top - 0.1, 0], [upper * 0.66, top + tall, 0]], [0.085, 0.075], segments=10)
        parts.append(turned(candle, start + 72 * number, "y"))
    return join(parts)


def corn(rng: Rng, traits: Traits) -> Part:
    """Draw an ear of corn: an upright cob with rows of kernels in husk leaves that open outward."""
    girth, height = rng.uniform(0.26, 0.36), rng.uniform(1.4, 1.8)
    leaf = traits.draw(rng, "leaves", (0.2, 0.3), (0.8, 0.95), (1.5, 1.75))
    turn = np.linspace(0.0, 1.0, 56)
    cob = lathe(np.stack([girth * (1 - turn**3.2) ** 0.75 * (0.9 + 0.1 * turn), height * turn], 1), segments=48)
    x, y, z = cob.verts.T
    bump = 1 + 0.1 * np.sqrt(np.abs(np.cos(5 * np.arctan2(x, z)) * np.sin(12 * np.pi * y / height)))
    parts = [Part(np.stack([x * bump, y, z * bump], 1), cob.faces)]
    parts.append(lathe([(0.1, -0.32), (0.12, -0.1), (girth * 1.12, 0.1), (girth * 1.1, 0.24)]))
    start, spread = rng.uniform(0, 90), rng.uniform(0.5, 0.7)
    for quarter in range(4):
        reach = leaf * (1.0 if quarter % 2 else 0.75)
        path = [[0, 0.0, girth * 0.7], [0, 0.1 + 0.4 * reach, girth + 0.1 * spread + 0.1 * reach]]
        path.append([0, 0.1 + 0.8 * reach, girth + 0.05 + spread * reach])
        parts += [turned(limb(path, [[0.2, 0.07], [0.2, 0.07], [0.05, 0.05]], segments=10), start + 90 * quarter, "y")]
    return join(parts)


def cupcake(rng: Rng, _: Traits) -> Part:
    """Draw a cupcake: a pleated paper cup, a swirl of cream in three steps, a cherry."""
    foot, rim, cup = rng.uniform(0.36, 0.42), rng.uniform(0.52, 0.66), rng.uniform(0.44, 0.66)
    paper = lathe([(foot, 0.0), (foot + 0.3 * (rim - foot), 0.3 * cup), (rim, cup), (rim * 0.9, cup)], segments=96)
    parts = [_fluted(paper, 16, 0.16)]
    swell, level, radius = [], cup - 0.05, rim * 1.14
    for step in (0.3, 0.27, 0.25):
        turn = np.linspace(-np.pi / 2, np.pi / 2, 9)
        swell += [(radius - 0.14 + 0.14 * np.cos(t), level + step / 2 * (1 + np.sin(t))) for t in turn]
        level, radius = level + step, radius * rng.uniform(0.64, 0.7)
    cream = lathe(swell, segments=48)
    # The steps climb once per turn, as cream from a nozzle does.
    x, y, z = cream.verts.T
    climb = 0.07 * np.sin(np.arctan2(x, z)) * np.clip((y - cup) / 0.3, 0, 1)
    parts.append(Part(np.stack([x, y + climb, z], 1), cream.faces))
    return join([*parts, ellipsoid([0, level + 0.08, 0], rng.uniform(0.14, 0.18), rings=10)])


def pumpkin(rng: Rng, traits: Traits) -> Part:
    """Draw a pumpkin: a wide round fruit with deep ribs and a thick stalk that leans."""
    girth, height, ribs = rng.uniform(0.74, 0.94), rng.uniform(0.88, 1.3), int(rng.integers(8, 11))
    stem = traits.draw(rng, "stem", (-0.08, -0.02), (0.26, 0.34), (0.85, 1.05))
    turn = np.linspace(0.0, np.pi, 21)
    radius = girth * np.sin(turn) ** 0.75
    dimple = 0.2 * np.sign(turn - np.pi / 2) * np.exp(-((radius / (0.4 * girth)) ** 2))
    flesh = lathe(np.stack([radius, height * (1 - np.cos(turn)) / 2 - dimple], 1), segments=12 * ribs)
    x, y, z = flesh.verts.T
    lobe = 0.76 + 0.24 * np.sqrt(np.abs(np.cos(ribs / 2 * np.arctan2(x, z))))
    lean = rng.uniform(0.1, 0.2)
    foot, middle = [0, height - 0.3, 0], [0, height + 0.4 * stem, 0]
    stalk = limb([foot, middle, [lean, height + 0.05 + stem, 0]], [0.19, 0.12, 0.13], segments=10)
    return join([Part(np.stack([x * lobe, y, z * lobe], 1), flesh.faces), stalk])


def strawberry(rng: Rng, traits: Traits) -> Part:
    """Draw a strawberry, its point down: a cone with round shoulders, pitted by seeds, under a star of leaves."""
    girth, height = rng.uniform(0.52, 0.66), rng.uniform(1.1, 1.45)
    leaf = traits.draw(rng, "leaves", (0.1, 0.17), (0.42, 0.52), (0.95, 1.15))
    turn = np.linspace(0.0, 1.0, 49)
    flesh = lathe(np.stack([girth * 1.5 * turn**0.62 * (1 - turn**3) ** 0.6 * 0.86, height * turn], 1), segments=60)
    x, y, z = flesh.verts.T
    around, row = np.arctan2(x, z), np.sin(6 * np.pi * y / height)
    pit = 1 - 0.1 * np.clip(np.abs(row) * np.cos(6 * around + np.where(row > 0, 0, np.pi)), 0, 1) ** 3
    parts = [Part(np.stack([x * pit, y, z * pit], 1), flesh.faces)]
    parts.append(limb([[0, height - 0.1, 0], [0.03, height + 0.26, 0]], [0.08, 0.09], segments=8))
    start, droop = rng.uniform(0, 60), rng.uniform(0.1, 0.25)
    for number in range(6):
        path = [[0, height - 0.02, 0.04], [0, height + 0.08, 0.5 * leaf], [0, height - droop * leaf, leaf + 0.05]]
        blade = limb(path, [[0.1, 0.07], [0.16, 0.07], [0.05, 0.05]], segments=10)
        parts.append(turned(blade, start + 60 * number, "y"))
    return join(parts)


def mushroom(rng: Rng, traits: Traits) -> Part:
    """Draw a mushroom: a thick stem under a domed cap with a curled rim."""
    cap = traits.draw(rng, "cap", (0.38, 0.44), (0.66, 0.78), (1.1, 1.3))
    stem = traits.draw(rng, "stem", (0.2, 0.28), (0.65, 0.85), (1.3, 1.6))
    radius, dome = rng.uniform(0.18, 0.23), rng.uniform(0.68, 0.85) * min(cap, 0.85)
    turn = np.linspace(0.0, np.pi / 2, 9)
    hood = [(cap * np.cos(t), stem + dome * np.sin(t)) for t in turn]
    under = [(radius * 1.05, stem + 0.04), (cap * 0.7, stem - 0.03), (cap * 0.96, stem - 0.06)]
    foot = [(radius * 1.25, 0.0), (radius * 1.3, 0.08), (radius, 0.3 * stem + 0.05)]
    return lathe([*foot, *under, *hood], segments=28)


def pear(rng: Rng, _: Traits) -> Part:
    """Draw a pear: a heavy belly, a slim shoulder and a stalk."""
    belly, shoulder = rng.uniform(0.56, 0.66), rng.uniform(0.26, 0.32)
    height = rng.uniform(1.25, 1.45)
    turn = np.linspace(0.0, np.pi, 17)
    share = (1 - np.cos(turn)) / 2
    width = shoulder + (belly - shoulder) / (1 + np.exp((share - 0.52) * 11))
    flesh = lathe(np.stack([width * np.sin(turn) ** 0.75, height * share], 1))
    lean = rng.uniform(0.05, 0.12)
    stalk = limb([[0, height - 0.06, 0], [lean, height + 0.26, 0]], [0.06, 0.075], segments=8)
    return join([flesh, stalk])


def carrot(rng: Rng, traits: Traits) -> Part:
    """Draw a carrot: a root that tapers to a point below a tuft of thick leaves."""
    radius, root = rng.uniform(0.32, 0.38), rng.uniform(1.35, 1.6)
    leaf = traits.draw(rng, "leaves", (0.14, 0.2), (0.45, 0.6), (0.95, 1.2))
    turn = np.linspace(0.0, 1.0, 9)
    wall = [(radius * (0.1 + 0.9 * t**0.75), root * t) for t in turn]
    body = lathe([(0.02, -0.05), *wall, (radius * 0.85, root + 0.09), (radius * 0.45, root + 0.13)])
    parts = [body]
    start = rng.uniform(0, 90)
    for quarter in range(4):
        blade = limb(
            [[0.08, root + 0.05, 0], [0.2, root + 0.1 + leaf * 0.6, 0], [0.36, root + 0.1 + leaf, 0]],
            [0.075, 0.11, 0.07],
            segments=8,
        )
        parts.append(turned(blade, start + 90 * quarter, "y"))
    return join(parts)


def pineapple(rng: Rng, traits: Traits) -> Part:
    """Draw a pineapple: a knobby barrel under a tuft of leaves that bend outward."""
    girth, height = rng.uniform(0.42, 0.48), rng.uniform(1.1, 1.25)
    leaf = traits.draw(rng, "leaves", (0.1, 0.16), (0.5, 0.64), (1.15, 1.4))
    turn = np.linspace(0.0, np.pi, 33)
    flesh = lathe(np.stack([girth * np.sin(turn) ** 0.7, height * (1 - np.cos(turn)) / 2], 1), segments=48)
    x, y, z = flesh.verts.T
    around = np.arctan2(x, z)
    # Two crossing families of spirals.
    knobs = 1 + 0.06 * np.cos(5 * around + 13 * y / height) * np.cos(5 * around - 13 * y / height)
    parts = [Part(np.stack([x * knobs, y, z * knobs], 1), flesh.faces)]
    start = rng.uniform(0, 72)
    for ring, (count, spread, length) in enumerate(((6, 0.62, 0.75), (5, 0.28, 1.0))):
        for number in range(count):
            reach = length * leaf
            path = [[0, height - 0.06, 0.1], [0, height + 0.6 * reach, 0.12 + 0.35 * spread * reach]]
            path.append([0, height + reach, 0.14 + spread * reach])
            blade = limb(path, [[0.1, 0.06], [0.1, 0.05], [0.04, 0.035]], segments=8)
            parts.append(turned(blade, start + 30 * ring + 360 * number / count, "y"))
    return join(parts)


def flower(rng: Rng, traits: Traits) -> Part:
    """Draw a flower that looks toward +Z and a little up: round petals about a button, a stem, two leaves."""
    head = traits.draw(rng, "head", (0.2, 0.25), (0.52, 0.6), (1.0, 1.15))
    stem = traits.draw(rng, "stem", (0.44, 0.54), (0.95, 1.15), (2.1, 2.4))
    leaf = traits.draw(rng, "leaves", (0.1, 0.16), (0.42, 0.52), (1.0, 1.2))
    petals, tilt, bow = int(rng.integers(5, 8)), rng.uniform(15, 35), rng.uniform(-0.08, 0.08)
    parts = [
        limb(
            [[0.0, 0.0, 0.0], [bow, stem / 2, 0], [0, stem, 0], [0, stem + 0.1, 0]],
            [0.13, 0.12, 0.12, 0.12],
            segments=10,
        )
    ]
    bloom = [ellipsoid([0, 0, 0.1 * head], [0.34 * head, 0.34 * head, 0.26 * head], rings=10)]
    petal = ellipsoid([0, 0.62 * head, 0], [2.1 * head / petals, 0.44 * head, 0.2 * head], rings=10)
    bloom += [turned(turned(petal, -12, "x"), 360 * number / petals, "z") for number in range(petals)]
    parts.append(moved(turned(join(bloom), -tilt, "x"), [0, stem + 0.1, 0.06]))
    for side, level in ((0.0, 0.25), (180.0, 0.4)):
        path = [[0.0, 0.0, 0.0], [0.5 * leaf, 0.34 * leaf, 0], [leaf, 0.5 * leaf, 0]]
        blade = limb(path, [[0.1, 0.1], [0.2, 0.1], [0.06, 0.07]], segments=10)
        parts.append(moved(turned(blade, side + rng.uniform(-20, 20), "y"), [0, level * stem, 0]))
    return join(parts)


def palm(rng: Rng, traits: Traits) -> Part:
    """Draw a palm: a ringed trunk that sways to one side, a crown of broad fronds that hang over, coconuts."""
    trunk = traits.draw(rng, "trunk", (0.5, 0.62), (1.25, 1.45), (2.6, 3.0))
    leaf = traits.draw(rng, "leaves", (0.36, 0.46), (0.85, 1.0), (1.6, 1.85))
    thick, sway, count = rng.uniform(0.14, 0.17), rng.uniform(0.15, 0.35), int(rng.integers(6, 9))
    share = np.linspace(0.0, 1.0, 15)
    ring = thick * (1.25 - 0.35 * share + 0.14 * (-1.0) ** np.arange(15))
    parts = [limb(np.stack([sway * share**1.6, trunk * share, 0 * share], 1), ring, segments=12, samples=2)]
    top, start, broad = [sway, trunk, 0], rng.uniform(0, 60), 0.6 + 0.45 * leaf
    for number in range(count):
        droop = rng.uniform(0.14, 0.34) * leaf
        path = [[0.0, 0.0, 0.0], [0, 0.3 * leaf, 0.4 * leaf], [0, 0.16 * leaf, 0.82 * leaf], [0, -droop, 1.05 * leaf]]
        frond = limb(path, np.array([[0.1, 0.08], [0.2, 0.08], [0.18, 0.08], [0.05, 0.05]]) * broad, segments=10)
        parts.append(moved(turned(frond, start + 360 * number / count, "y"), top))
    nuts = [turned(ellipsoid([0.17, -0.12, 0], 0.14, rings=8), start + 120 * third, "y") for third in range(3)]
    return join([*parts, *(moved(nut, top) for nut in nuts)])


def pine(rng: Rng, traits: Traits) -> Part:
    """Draw a fir: a pointed stack of cones with jagged rims, each smaller than the one below, on a trunk."""
    trunk = traits.draw(rng, "trunk", (0.04, 0.1), (0.36, 0.46), (1.2, 1.45))
    girth, height, tiers = rng.uniform(0.54, 0.8), rng.uniform(1.35, 1.75), int(rng.integers(3, 5))
    thick, parts = rng.uniform(0.13, 0.17), []
    parts.append(lathe([(thick * 1.3, 0.0), (thick, 0.1), (thick, trunk + 0.3)]))
    for tier in range(tiers):
        wide, low = girth * (1 - 0.62 * tier / (tiers - 1)), trunk + 0.72 * height * tier / tiers
        tip = low + height * (0.36 + 0.74 / tiers)
        cone = lathe(
            [
                (0.1, low + 0.1),
                (wide * 0.9, low),
                (wide, low + 0.04),
                (0.5 * wide, low + 0.4 * (tip - low)),
                (0.0, tip),
            ],
            segments=56,
        )
        x, y, z = cone.verts.T
        jag = 1 - 0.24 * np.abs(np.sin(4 * np.arctan2(x, z) + tier)) * np.clip(np.hypot(x, z) / wide, 0, 1) ** 2
        parts.append(Part(np.stack([x * jag, y, z * jag], 1), cone.faces))
    return join(parts)
