"""Draw tools, weapons and containers."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, box, disc, ellipsoid, extrude, join, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits


def anvil(rng: Rng, _: Traits) -> Part:
    """Draw an anvil: a spread foot, a waist, a long block on top whose horn tapers toward +Z."""
    width, length, high = rng.uniform(0.42, 0.5), rng.uniform(0.95, 1.1), rng.uniform(0.78, 0.9)
    foot = box([0, 0.1, 0], [width * 1.5, 0.24, length * 0.95], round_by=0.25)
    waist = box([0, 0, 0], [width * 0.8, high * 0.9, length * 0.45], round_by=0.1, cells=10)
    spread = 1 + 2.4 * (waist.verts[:, 1:2] / high) ** 2
    waist = Part(waist.verts * np.concatenate([0.8 * spread, np.ones_like(spread), spread], 1), waist.faces)
    block = box([0, high, -0.08], [width, 0.36, length], round_by=0.12)
    root, reach = length / 2 - 0.2, rng.uniform(0.6, 0.75)
    horn = limb(
        [[0, high - 0.02, root], [0, high + 0.02, root + 0.5 * reach], [0, high + 0.1, root + reach]],
        [[width * 0.46, 0.18], [width * 0.36, 0.15], [0.05, 0.05]],
    )
    heel = box([0, high + 0.08, -length / 2 - 0.12], [width * 0.8, 0.2, 0.4], round_by=0.2)
    return join([foot, moved(waist, [0, high / 2 + 0.05, 0]), block, horn, heel])


def axe(rng: Rng, traits: Traits) -> Part:
    """Draw an axe standing on its handle: a flared blade with a round edge toward +X, a blunt poll."""
    handle = traits.draw(rng, "handle", (0.3, 0.4), (0.9, 1.1), (1.9, 2.2))
    blade = traits.draw(rng, "blade", (0.22, 0.28), (0.5, 0.6), (1.0, 1.2))
    thick, neck, flare = rng.uniform(0.13, 0.155), rng.uniform(0.2, 0.24), rng.uniform(0.46, 0.56)
    turn = np.linspace(-1.0, 1.0, 11)
    edge = [(blade + 0.16 * (1 - t**2), flare * t) for t in turn]
    upper = [(0.5 * blade, 0.5 * (neck + 0.12)), (0.0, neck), (-0.12, neck), (-0.26, neck)]
    outline = [(-0.26, -neck), (-0.12, -neck), (0.0, -neck), (0.5 * blade, -0.6 * (neck + 0.12)), *edge, *upper]
    head = extrude(outline, 0.38, bevel=0.2)
    # The blade grows thin toward its edge.
    wedge = 1 - 0.6 * np.clip(head.verts[:, 0] / (blade + 0.16), 0, 1)
    head = Part(head.verts * np.stack([np.ones_like(wedge), np.ones_like(wedge), wedge], 1), head.faces)
    shaft = limb(
        [[0.06, -0.34 - handle, 0], [0, -0.3 - 0.7 * handle, 0], [0, 0.4, 0]],
        [[thick * 1.35, thick * 1.2], [thick, thick], [thick, thick]],
    )
    return join([head, shaft])


def barrel(rng: Rng, _: Traits) -> Part:
    """Draw an upright barrel: staves that bulge, four hoops that stand out, sunken ends."""
    end, belly, height = rng.uniform(0.42, 0.52), rng.uniform(0.6, 0.7), rng.uniform(1.2, 1.65)

    def wall(share: float) -> float:
        return end + (belly - end) * float(np.sin(np.pi * share))

    sides = [(wall(t), height * t) for t in np.linspace(0.0, 1.0, 13)]
    inner = 0.84 * end
    body = lathe([(inner, 0.09), (inner, 0.0), *sides, (inner, height), (inner, height - 0.09)], segments=64)
    x, y, z = body.verts.T
    stave = 1 - 0.05 * np.abs(np.sin(8 * np.arctan2(x, z))) ** 0.5
    parts = [Part(np.stack([x * stave, y, z * stave], 1), body.faces)]
    for share in (0.07, 0.3, 0.7, 0.93):
        half, level = 0.055 * height, share * height
        rim = wall(share) + 0.05
        parts.append(
            lathe([(rim * 0.85, level - half), (rim, level - half), (rim, level + half), (rim * 0.85, level + half)])
        )
    return join(parts)


def bucket(rng: Rng, _: Traits) -> Part:
    """Draw a bucket: a deep open cone with a thick rim, its bail folded down in front."""
    foot, rim, height = rng.uniform(0.38, 0.52), rng.uniform(0.64, 0.76), rng.uniform(0.98, 1.35)
    wall = [(foot + (rim - foot) * t, height * t) for t in np.linspace(0.06, 0.9, 7)]
    brim = [(rim + 0.08, height * 0.92), (rim + 0.08, height), (rim - 0.07, height), (rim - 0.08, height * 0.9)]
    parts = [lathe([(foot + 0.05, 0.0), (foot + 0.05, 0.08), (foot, 0.1), *wall, *brim, (foot - 0.06, 0.14)])]
    turn, sag = np.linspace(-np.pi / 2, np.pi / 2, 11), rng.uniform(0.42, 0.58) * height
    path = []
    for t in turn:
        level = 0.86 * height - sag * np.cos(t)
        away = foot + (rim - foot) * level / height + 0.05
        path.append([away * np.sin(t), level, away * np.cos(t)])
    parts += [limb(path, np.full(11, 0.075), segments=10, samples=3)]
    return join([*parts, *pair(ellipsoid([rim + 0.04, 0.86 * height, 0], [0.11, 0.14, 0.14], rings=8))])


def camera(rng: Rng, traits: Traits) -> Part:
    """Draw a camera: a wide body with a grip, a hump for the finder, a round lens toward +Z, a button on top."""
    width, height, deep = rng.uniform(1.25, 1.6), rng.uniform(0.78, 0.95), rng.uniform(0.38, 0.52)
    lens = traits.draw(rng, "lens", (0.04, 0.09), (0.36, 0.46), (1.05, 1.3))
    girth = rng.uniform(0.34, 0.4)
    parts = [box([0, height / 2, 0], [width, height, deep], round_by=0.2)]
    hump = box([0, 0, 0], [0.54, 0.44, deep * 0.9], round_by=0.2)
    slope = 1 - 0.45 * np.clip(hump.verts[:, 1:2] / 0.22, 0, 1)
    parts.append(
        moved(Part(hump.verts * np.concatenate([slope, 1 + 0 * slope, 1 + 0 * slope], 1), hump.faces), [0, height, 0])
    )
    front = deep / 2
    tube = [(girth, -0.1), (girth, 0.55 * lens), (girth * 0.88, 0.55 * lens + 0.02), (girth * 0.88, 0.8 * lens + 0.04)]
    ring = [(girth * 1.02, 0.8 * lens + 0.05), (girth * 1.02, lens + 0.1), (girth * 0.74, lens + 0.1)]
    barrel_ = lathe([*tube, *ring, (girth * 0.68, lens * 0.8 + 0.01), (0.0, lens * 0.8 + 0.07)])
    parts += [moved(turned(barrel_, 90, "x"), [0, height * 0.46, front])]
    parts += [limb([[-width * 0.4, 0.2, front], [-width * 0.4, height - 0.2, front]], [0.13, 0.13], segments=12)]
    parts += [moved(disc(0.11, 0.0, 0.16), [-width * 0.36, height - 0.04, 0])]
    return join([*parts, moved(disc(0.15, 0.0, 0.13), [width * 0.34, height - 0.04, 0])])


def candle(rng: Rng, _: Traits) -> Part:
    """Draw a burning candle: a saucer with a finger hold behind, a thick candle with runs of wax, a flame."""
    girth, tall, dish = rng.uniform(0.32, 0.38), rng.uniform(0.75, 1.3), rng.uniform(0.6, 0.76)
    saucer = lathe([(dish * 0.6, 0.0), (dish, 0.16), (dish + 0.03, 0.22), (dish - 0.06, 0.22), (girth, 0.1)])
    stick = lathe([(girth, 0.05), (girth, tall - 0.04), (girth - 0.05, tall), (0.1, tall - 0.08)])
    parts = [saucer, stick, ellipsoid([0, 0.16, -dish - 0.04], [0.08, 0.13, 0.17], rings=8)]
    start = rng.uniform(0, 72)
    for number in range(5):
        run = tall * rng.uniform(0.2, 0.5)
        wax = limb([[0, tall - 0.05, girth - 0.02], [0, tall - run, girth + 0.01]], [0.08, 0.1], segments=8, samples=3)
        parts.append(turned(wax, start + 72 * number, "y"))
    flame, blaze = rng.uniform(0.2, 0.25), rng.uniform(0.56, 0.68)
    turn = np.linspace(0.0, 1.0, 13)
    fire = lathe([(flame * 1.5 * np.sqrt(t) * (1 - t) ** 0.9 * 1.35, tall + blaze * t) for t in turn])
    return join([*parts, disc(0.07, tall - 0.15, tall + 0.12, edge=0.02), moved(fire, [0, 0.02, 0])])


def chest(rng: Rng, _: Traits) -> Part:
    """Draw a treasure chest: a long box, a lid curved from front to back, iron bands, a lock in front."""
    width, deep, body = rng.uniform(1.2, 1.65), rng.uniform(0.74, 0.94), rng.uniform(0.44, 0.64)
    bow = rng.uniform(0.75, 1.1)

    def lid(length: float, over: float) -> Part:
        half = deep / 2 + over
        arch = [(half * np.cos(t), body + bow * half * np.sin(t)) for t in np.linspace(0.0, np.pi, 15)]
        return turned(
            extrude([*arch, (-half, body - 0.06), (0.0, body - 0.06), (half, body - 0.06)], length, bevel=0.02), 90, "y"
        )

    parts = [box([0, body / 2, 0], [width, body - 0.02, deep], round_by=0.06), lid(width + 0.08, 0.04)]
    for x in (-0.4, 0.4):
        parts.append(moved(lid(0.2, 0.12), [x * width, 0, 0]))
        parts.append(box([x * width, body / 2, 0], [0.2, body, deep + 0.2], round_by=0.1))
    return join([*parts, box([0, body, deep / 2 + 0.04], [0.3, 0.4, 0.26], round_by=0.25)])


def shield(rng: Rng, _: Traits) -> Part:
    """Draw a knight's shield facing +Z: straight top, pointed foot, bent back at the sides, with a rim and a cross."""
    width, height, straight = rng.uniform(0.62, 0.8), rng.uniform(1.5, 1.95), rng.uniform(0.25, 0.45)
    share = np.linspace(0.98, 0.0, 22)
    swell = width * np.sqrt(1 - np.clip((share - straight) / (1 - straight), 0, 1) ** 1.9)
    right = np.stack([swell, -height * share], 1)
    top = [(width * t, 0.07 * abs(t) - 0.07) for t in np.linspace(0.9, -0.9, 13)]
    outline = np.concatenate([[[0.0, -height]], right, top, right[::-1] * [-1, 1]])
    bar = height * rng.uniform(0.34, 0.4)
    loop = np.column_stack([np.concatenate([outline, outline[:1]]) * 0.97, np.full(len(outline) + 1, 0.1)])
    parts = [extrude(outline, 0.22, bevel=0.2), limb(loop, np.full(len(loop), 0.12), segments=10, samples=1)]
    parts += [box([0, -bar, 0.1], [width * 1.8, 0.22, 0.36], round_by=0.2, cells=12)]
    parts += [box([0, -height * 0.48, 0.1], [0.22, height * 0.88, 0.36], round_by=0.2, cells=12)]
    parts += [ellipsoid([0, -bar, 0.26], [0.26, 0.26, 0.17], rings=10)]
    whole, bow = join(parts), rng.uniform(0.3, 0.45) / width**2
    whole.verts[:, 2] -= bow * whole.verts[:, 0] ** 2
    return whole


def sword(rng: Rng, traits: Traits) -> Part:
    """Draw a sword standing on its pommel: a broad two-edged blade with a ridge, a cross guard, a grip."""
    blade = traits.draw(rng, "blade", (0.4, 0.52), (1.1, 1.3), (2.3, 2.7))
    grip = traits.draw(rng, "handle", (0.06, 0.12), (0.36, 0.46), (1.1, 1.3))
    broad, guard = rng.uniform(0.22, 0.28), rng.uniform(0.46, 0.56)
    edge = [[broad, 0.15], [broad * 0.95, 0.145], [broad * 0.85, 0.13], [0.04, 0.04]]
    heights = (0.0, 0.4 * blade, blade - 0.05, blade + 0.28)
    parts = [limb([[0, y, 0] for y in heights], edge, segments=4)]
    curve = rng.uniform(-0.02, 0.14)
    share = np.linspace(-1.0, 1.0, 7)
    arms = np.stack([share * guard, curve * share**2, np.zeros(7)], 1)
    parts.append(limb(arms, [0.16, 0.12, 0.13, 0.17, 0.13, 0.12, 0.16], segments=10, samples=3))
    parts.append(limb([[0.0, -0.05 - grip, 0.0], [0.0, -0.05 - grip / 2, 0.0], [0.0, 0.0, 0.0]], [0.115, 0.14, 0.115]))
    return join([*parts, ellipsoid([0, -0.16 - grip, 0], [0.21, 0.2, 0.19], rings=10)])


def teapot(rng: Rng, traits: Traits) -> Part:
    """Draw a teapot: a round body, a lid with a knob, a spout toward +X, a handle toward -X as a solid ear."""
    girth, height = rng.uniform(0.58, 0.72), rng.uniform(0.78, 1.08)
    spout = traits.draw(rng, "spout", (0.0, 0.06), (0.38, 0.48), (1.15, 1.4))
    turn = np.linspace(0.0, np.pi, 17)
    wall = [(max(girth * np.sin(t) ** 0.65, 0.38), height * (1 - np.cos(t)) / 2) for t in turn[1:-1]]
    parts = [lathe([(0.4, -0.06), *wall, (0.3, height * 0.98)])]
    dome = [(0.4, height - 0.07), (0.42, height), *[(0.38 * np.cos(t), height + 0.17 * np.sin(t)) for t in turn[:8]]]
    parts += [lathe([*dome, (0.0, height + 0.17)]), ellipsoid([0, height + 0.25, 0], [0.12, 0.12, 0.12], rings=10)]
    root, tip = girth * 0.8, girth + 0.16 + 0.75 * spout
    path = [[root, height * 0.3, 0], [girth + 0.1 + 0.35 * spout, height * 0.45, 0]]
    path += [[tip, height * 0.82 + 0.3 * spout, 0]]
    parts.append(limb([*path, [tip + 0.14, height * 0.88 + 0.3 * spout, 0]], [0.21, 0.17, 0.1, 0.12], segments=14))
    ear, reach = rng.uniform(0.3, 0.36), rng.uniform(0.44, 0.54)
    arc = np.linspace(np.pi / 2, 1.5 * np.pi, 11)
    bow = np.array([[reach * np.cos(t) - girth * 0.82, height * 0.52 + ear * np.sin(t), 0] for t in arc])
    parts.append(limb(bow, np.full(11, 0.095), segments=10, samples=3))
    return join([*parts, extrude([*bow[:, :2], (-girth * 0.6, bow[-1, 1]), (-girth * 0.6, bow[0, 1])], 0.1)])
