"""Draw clothes, standing as if worn but empty, a backpack and a helmet, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.parts import Part, box, disc, ellipsoid, join, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits


def _stretched(part: Part, x: float, y: float, z: float) -> Part:
    return Part(part.verts * np.array([x, y, z]), part.faces)


def _sleeve(length: float, shoulder: float, cuff: float, degrees: float) -> Part:
    """Return a cloth tube from the origin downward, swung out toward +X, with a hem and a hollow at its end."""
    hollow = [(cuff * 0.72, 0.1), (cuff * 0.76, 0.0)]
    wall = [(cuff + 0.02, 0.0), (cuff + 0.02, 0.08), (cuff, 0.1), (shoulder, 0.1 + length)]
    wall += [(0.5 * shoulder, 0.2 + length)]
    return turned(moved(lathe([*hollow, *wall]), [0, -0.1 - length, 0]), degrees, "z")


def boot(rng: Rng, traits: Traits) -> Part:
    """Draw a boot, its toe toward +Z: an open shaft with a cuff, a round toe, a sole, a heel."""
    heel = traits.draw(rng, "heel", (0.0, 0.03), (0.16, 0.22), (0.48, 0.6))
    shaft, girth, reach = rng.uniform(0.65, 1.25), rng.uniform(0.25, 0.31), rng.uniform(0.64, 0.82)
    top, cuff = 0.2 + shaft, girth * rng.uniform(1.08, 1.2)
    wall = [(girth * 0.9, 0.2), (girth * 0.95, 0.3), (girth * 0.92, 0.5), (cuff * 0.95, top - 0.24)]
    rim = [(cuff + 0.07, top - 0.22), (cuff + 0.07, top), (cuff - 0.06, top), (cuff - 0.08, top - 0.25)]
    upper = _stretched(moved(lathe([*wall, *rim]), [0, heel, 0]), 0.95, 1.0, 1.08)
    foot = limb([[0, 0.25, -0.04], [0, 0.29, 0.3], [0, 0.25, reach - 0.22]], [girth * 0.9, girth * 0.98, girth * 0.96])
    sole = box([0, 0.07, reach / 2 - 0.15], [2.1 * girth, 0.15, reach + 0.36], round_by=0.3, cells=12)
    lower = join([foot, sole])
    # The heel lifts everything behind the ball of the foot.
    share = np.clip((0.8 * reach - lower.verts[:, 2]) / (0.8 * reach - 0.15), 0, 1)
    lower.verts[:, 1] += heel * share * share * (3 - 2 * share)
    block = box([0, 0, 0], [1.7 * girth, heel + 0.12, 0.36], round_by=0.15)
    return join([upper, lower, moved(block, [0, (heel + 0.12) / 2, -girth * 0.55])])


def dress(rng: Rng, traits: Traits) -> Part:
    """Draw a dress: a wide pleated skirt, a narrow waist with a sash and a bow behind, a bodice, two sleeves."""
    hem, waist, skirt = rng.uniform(0.6, 0.92), rng.uniform(0.22, 0.27), rng.uniform(0.9, 1.25)
    bust, bodice = rng.uniform(0.33, 0.37), rng.uniform(0.56, 0.66)
    sleeve = traits.draw(rng, "sleeves", (0.0, 0.04), (0.3, 0.38), (0.85, 1.05))
    flare = [(waist + (hem - waist) * (1 - t) ** 1.25, skirt * t) for t in np.linspace(0.0, 1.0, 10)]
    top = skirt + bodice
    chest = [(bust, skirt + 0.55 * bodice), (bust * 0.98, top - 0.12), (bust * 0.8, top), (bust * 0.6, top - 0.02)]
    hollow = [(hem * 0.4, 0.16), (hem * 0.9, 0.02)]
    cloth = lathe([*hollow, *flare, *chest, (bust * 0.5, top - 0.18)], segments=72)
    x, y, z = cloth.verts.T
    fold = 1 + 0.1 * np.clip(1 - y / skirt, 0, 1) * np.cos(12 * np.arctan2(x, z))
    # A scooped neck in front.
    scoop = 0.16 * np.clip((y - top + 0.1) / 0.1, 0, 1) * np.clip(z / bust, 0, 1)
    parts = [_stretched(Part(np.stack([x * fold, y - scoop, z * fold], 1), cloth.faces), 1.0, 1.0, 0.7)]
    parts.append(_stretched(moved(disc(waist + 0.05, -0.07, 0.07), [0, skirt, 0]), 1.0, 1.0, 0.8))
    parts += pair(turned(moved(_sleeve(sleeve, 0.18, 0.15, 50), [bust * 0.74, top - 0.17, 0]), 0, "y"))
    bow = turned(ellipsoid([0.15, 0, 0], [0.17, 0.1, 0.09], rings=8), 20, "z")
    return join([*parts, *pair(moved(bow, [0, skirt, -0.8 * waist - 0.04]))])


def glove(rng: Rng, _: Traits) -> Part:
    """Draw a glove, its back toward +Z: four spread fingers up, a thumb toward +X, an open flared cuff below."""
    width, palm, finger = rng.uniform(0.7, 0.8), rng.uniform(0.58, 0.72), rng.uniform(0.44, 0.7)
    thick, spread = width / 7.6, rng.uniform(5, 9)
    parts = [box([0, palm / 2, 0], [width, palm + 0.1, 0.34], round_by=0.45, cells=8)]
    for number, share in enumerate((0.82, 1.0, 0.94, 0.7)):
        across = (number - 1.5) * width / 4.1
        tip = across + finger * share * np.sin(np.radians(spread * (1.5 - (3 - number)) * 1.4))
        path = [[across, palm - 0.15, 0], [tip, palm + finger * share, -0.06]]
        parts.append(limb(path, [thick * 1.05, thick * 0.98]))
    thumb, bend = [width / 2 - 0.12, palm * 0.28, 0], rng.uniform(0.2, 0.3)
    parts.append(
        limb(
            [thumb, [width / 2 + bend, palm * 0.62, 0], [width / 2 + bend + 0.06, palm * 0.9, -0.02]],
            [0.16, 0.14, 0.12],
        )
    )
    cuff, long = width * rng.uniform(0.54, 0.64), rng.uniform(0.3, 0.42)
    band = [(cuff * 0.76, 0.12 - long), (cuff * 0.8, -long), (cuff, -long), (cuff * 0.98, 0.1 - long)]
    band += [(width * 0.4, 0.02)]
    return join([*parts, _stretched(lathe([*band, (width * 0.36, 0.14)]), 1.0, 1.0, 0.62)])


def helmet(rng: Rng, _: Traits) -> Part:
    """Draw a knight's helmet: a dome, a pointed visor below a slit for the eyes, a collar, a plume toward -Z."""
    girth, face = rng.uniform(0.5, 0.56), rng.uniform(0.56, 0.64)
    snout, plume = rng.uniform(0.75, 1.0), rng.uniform(0.45, 0.65)
    levels = np.concatenate(
        [np.linspace(0.1, face - 0.05, 9), face + np.array([-0.03, 0.11]), [face + 0.13, face + 0.26]]
    )
    turn = np.linspace(0.0, np.pi / 2, 9)[1:]
    dome = [(girth * np.cos(t) ** 0.8, face + 0.28 + girth * 0.8 * np.sin(t)) for t in turn]
    shell = lathe([(girth * 0.8, 0.0), *[(girth, y) for y in levels], *dome], segments=72)
    x, y, z = shell.verts.T
    # The visor is pushed out to a keel, the slit in, the brow out again.
    swell = np.interp(
        y,
        [0.1, 0.4 * face, face - 0.05, face - 0.03, face + 0.11, face + 0.13, face + 0.3],
        [0.1, snout, 0.55 * snout, -0.25, -0.25, 0.3, 0.0],
    )
    front = np.clip(1 - np.abs(np.arctan2(x, z)) / 1.75, 0, 1)
    girths = 1 + swell * np.where(swell > 0, front, np.clip(5 * front, 0, 1))
    parts = [Part(np.stack([x * girths, y, z * girths], 1), shell.faces)]
    parts.append(lathe([(girth * 0.9, -0.14), (girth * 1.3, -0.14), (girth * 1.26, -0.02), (girth * 0.94, 0.16)]))
    parts.append(limb([[0, face - 0.12, girth * 1.25], [0, face + 0.2, girth * 1.14]], [0.08, 0.08], segments=8))
    parts += pair(moved(turned(disc(0.16, 0.0, 0.14), -90, "z"), [girth * 0.9, face + 0.04, -0.08]))
    crown, arc = face + 0.26 + 0.8 * girth, np.linspace(0.0, 1.0, 9)
    crest = [[0, crown + 0.26 * np.sin(2.2 * t) - plume * t**2.5, 0.22 - 0.85 * t] for t in arc]
    return join([*parts, limb(crest, np.interp(arc, [0, 0.3, 0.8, 1], [0.1, 0.17, 0.2, 0.08]))])


def shirt(rng: Rng, traits: Traits) -> Part:
    """Draw a shirt with arms held out: a flat trunk, two sleeves, a folded collar, buttons in front."""
    width, height, deep = rng.uniform(0.82, 1.02), rng.uniform(1.0, 1.35), rng.uniform(0.38, 0.46)
    sleeve = traits.draw(rng, "sleeves", (0.08, 0.14), (0.36, 0.44), (1.1, 1.3))
    trunk = box([0, height / 2, 0], [width, height, deep], round_by=0.42, cells=8)
    slope = 1 - 0.2 * np.clip(trunk.verts[:, 1:2] / height - 0.86, 0, 1) * 5 * np.abs(trunk.verts[:, :1]) / width
    parts = [Part(trunk.verts * np.concatenate([np.ones_like(slope), slope, np.ones_like(slope)], 1), trunk.faces)]
    parts.append(box([0, 0.07, 0], [width + 0.06, 0.14, deep + 0.06], round_by=0.3))
    arm = _stretched(_sleeve(sleeve, 0.25, 0.21, rng.uniform(50, 60)), 1.0, 1.0, 0.78)
    parts += pair(moved(arm, [width / 2 - 0.16, height - 0.3, 0]))
    neck, front = rng.uniform(0.2, 0.24), deep / 2
    ring = [(neck + 0.05, -0.14), (neck, 0.08), (neck - 0.07, 0.08), (neck - 0.09, -0.06)]
    parts.append(_stretched(moved(lathe(ring), [0, height, 0]), 1.0, 1.0, 0.8))
    flap = limb(
        [[neck, height + 0.02, 0.02], [0.17, height - 0.14, front], [0.09, height - 0.26, front]], [0.08, 0.09, 0.05]
    )
    parts += [*pair(flap), box([0, height * 0.42, front], [0.16, height * 0.8, 0.1], round_by=0.2)]
    parts += [ellipsoid([0, height * share, front + 0.05], [0.06, 0.06, 0.05], rings=6) for share in (0.2, 0.4, 0.6)]
    return join(parts)


def trousers(rng: Rng, traits: Traits) -> Part:
    """Draw trousers: an open waist with a belt and a buckle, hips, two separate legs, pockets behind."""
    width, hip = rng.uniform(0.42, 0.48), rng.uniform(0.42, 0.5)
    leg = traits.draw(rng, "legs", (0.28, 0.38), (0.95, 1.15), (2.1, 2.4))
    cuff, swing = rng.uniform(0.17, 0.27), rng.uniform(2, 7)
    wall = [(width * 0.3, -0.12), (width * 0.8, -0.04), (width * 0.98, 0.2), (width * 0.86, hip)]
    seat = lathe([*wall, (width * 0.7, hip), (width * 0.66, hip - 0.14)])
    belt = lathe(
        [(width * 0.8, hip - 0.16), (width * 0.95, hip - 0.14), (width * 0.95, hip - 0.02), (width * 0.7, hip - 0.02)]
    )
    parts = [_stretched(part, 1.0, 1.0, 0.68) for part in (seat, belt)]
    parts += pair(moved(_stretched(_sleeve(leg, 0.5 * width, cuff, swing), 1.0, 1.0, 1.1), [width * 0.45, 0.14, 0]))
    parts += [box([0, hip - 0.09, 0.64 * width], [0.2, 0.18, 0.16], round_by=0.25)]
    parts += [box([0, 0.12, 0.64 * width], [0.1, 0.36, 0.1], round_by=0.25)]
    return join([*parts, *pair(box([width * 0.38, 0.06, -0.56 * width], [0.24, 0.26, 0.18], round_by=0.25))])
