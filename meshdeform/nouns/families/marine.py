"""Draw what lives in the sea: fish from one archetype, arms and shells of what has no bones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshdeform.nouns.families.drawing import Family, bead, bent_limb, blade, circle, kind, near, on, sized, varied
from meshdeform.nouns.families.insects import claw_of, feelers_of, legs_of
from meshdeform.nouns.families.parts import Array, Part, ellipsoid, join, lathe, limb, moved, pair, plate, turned
from meshdeform.nouns.families.traits import Rng, Traits


@dataclass(frozen=True)
class FishBuild:
    """Ranges of a fish, half its length being about one; lengths along it run from 1, its nose, to -1, its tail's root.

    `girths`: shares of the greatest height and width at equal steps from nose to tail; `fork`: how far the tail is cut
    in, as a share of its length; `back` and `belly`: where these fins begin and end; `fin_tall`: their height.
    """

    tall: float = 0.41
    wide: float = 0.24
    girths: Sequence[float] = (0.25, 0.8, 1.0, 0.85, 0.5, 0.22)
    fins: float = 0.34
    tail: float = 0.47
    tail_tall: float = 0.75
    fork: float = 0.35
    back: tuple[float, float] = (0.3, -0.45)
    belly: tuple[float, float] = (-0.05, -0.5)
    fin_lean: float = 0.35


def fish_of(rng: Rng, traits: Traits, build: FishBuild) -> dict[str, list[Part]]:
    """Return the solids of a fish: body, tail, fins above, below and at the sides, eyes; its nose at z = 1."""
    tall, wide = near(rng, build.tall), near(rng, build.wide)
    along, girths = np.linspace(1, -1, len(build.girths)), np.array(build.girths)
    path = np.stack([0 * along, 0 * along, along], 1)
    body = bent_limb(path, girths[:, None] * [tall, wide], segments=16, samples=4)
    tail, fins = sized(rng, traits, "tail", build.tail, by=2.0), sized(rng, traits, "fins", build.fins, by=2.0)
    upper = [(0.14, 0.1), (-0.6, 0.85 * build.tail_tall), (-1, build.tail_tall), (-1 + build.fork, 0.0)]
    rear = moved(blade([*upper, *((z, -y) for z, y in upper[2::-1])], tail), [0, 0, -1])

    def upright(ends: tuple[float, float], sign: float) -> Part:
        z = np.linspace(*ends, 5)
        root = sign * 0.8 * tall * np.interp(z, along[::-1], girths[::-1])
        top = root + sign * fins * np.array([0.35, 1.0, 0.85, 0.6, 0.3])
        lean = build.fin_lean * fins
        return plate([*zip(z, root, strict=True), *zip(z[::-1] - lean, top[::-1], strict=True)], 0.07, across="x")

    side = turned(blade([(0.1, 0.12), (-0.6, 0.42), (-1, 0.1), (-0.6, -0.35), (0.1, -0.12)], fins), -40, "y")
    at_head = wide * float(np.interp(0.4, along[::-1], girths[::-1]))
    eye = [0.82 * wide * float(np.interp(0.66, along[::-1], girths[::-1])), 0.25 * tall, 0.66]
    return {"body": [body], "tail": [rear], "fin": [upright(build.back, 1.0), upright(build.belly, -1.0),
        *pair(moved(side, [0.8 * at_head, -0.1, 0.35]))], "eye": pair(bead(eye, 0.09))}  # fmt: skip


def fish_kind(name: str, build: FishBuild) -> Family:
    """Return the family of fish that are known by their build alone."""
    return kind(name, lambda rng, traits: varied(rng, **fish_of(rng, traits, build)))


def pufferfish(rng: Rng, traits: Traits) -> Part:
    """Draw a pufferfish: a ball with spikes all over, small fins and a small tail, a pout of a mouth."""
    spikes, fins = sized(rng, traits, "spikes", 0.24, by=2.8), sized(rng, traits, "fins", 0.29, by=2.0)
    tall, golden = rng.uniform(0.8, 1.0), np.pi * (3 - np.sqrt(5))
    count = 34
    height, spin = 1 - 2 * (np.arange(count) + 0.5) / count, golden * np.arange(count)
    out = np.stack([np.sqrt(1 - height**2) * np.cos(spin), height * tall, np.sqrt(1 - height**2) * np.sin(spin)], 1)
    out = out[(np.abs(out[:, 2]) < 0.86)]
    tail = moved(blade([(0.2, 0.12), (-0.5, 0.4), (-0.9, 0.3), (-0.9, -0.3), (-0.5, -0.4), (0.2, -0.12)], 0.5),
        [0, 0, -0.95])  # fmt: skip
    side = turned(blade([(0.1, 0.3), (-0.6, 0.9), (-1, 0.3), (-0.9, -0.5), (0.1, -0.3)], fins), -55, "y")
    upper = blade([(0.4, 0), (0, 1), (-0.7, 1.1), (-0.5, 0)], 0.8 * fins)
    return varied(rng, body=ellipsoid([0, 0, 0], [0.96, tall, 1.0], rings=12), tail=tail,
        spike=[limb([0.93 * way, (1 + spikes) * way], [0.07, 0.012], segments=5, samples=1) for way in out],
        fin=[*pair(moved(side, [0.9, -0.05, 0.2])), moved(upper, [0, 0.95 * tall, -0.35])],
        mouth=bead([0, -0.08, 0.98], [0.2, 0.13, 0.14]), eye=pair(bead([0.5, 0.3 * tall, 0.72], 0.22)))  # fmt: skip


def seahorse(rng: Rng, traits: Traits) -> Part:
    """Draw a seahorse: a bent head with a tube of a snout, an upright body, a tail that curls in, a back fin."""
    nose, tail = sized(rng, traits, "nose", 0.27), sized(rng, traits, "tail", 0.85, by=1.9)
    girth, head = rng.uniform(0.19, 0.25), rng.uniform(0.17, 0.2)
    turn = np.linspace(0, rng.uniform(1.3, 1.7) * np.pi, 10)
    curl = 0.27 * tail * np.exp(-0.16 * turn)
    hips = np.array([0, -0.1, -0.06])
    spiral = hips + np.stack([0 * turn, -0.5 * tail - curl * np.sin(turn), 0.27 * tail - curl * np.cos(turn)], 1)
    skull = np.array([0, 0.86, 0.05])
    body = bent_limb([hips, [0, 0.2, 0.06], [0, 0.55, -0.06], [0, 0.8, -0.02]], [0.13, girth, 0.14, 0.11], segments=12)
    tip = on(skull, head, 0, -0.3, 0.7) + nose * np.array([0, -0.45, 0.9])
    fan = moved(blade([(0.1, 0.15), (-0.2, 0.24), (-0.3, 0), (-0.2, -0.24), (0.1, -0.15)], 0.9), [0, 0.25, -0.1])
    crest = [limb([skull + [0, 0.1, z], skull + [0, 0.3 + 0.2 * z, 1.6 * z - 0.08]], [0.05, 0.015], segments=6,
        samples=1) for z in (-0.1, 0, 0.09)]  # fmt: skip
    return varied(rng, body=body, tail=bent_limb([hips + [0, 0.1, 0], *spiral], [0.13, *np.linspace(0.12, 0.03, 10)],
        samples=2), head=bead(skull, head * np.array([0.8, 0.85, 1.1]), segments=16, rings=8), fin=fan, crest=crest,
        nose=[limb([on(skull, head, 0, -0.2, 0.5), tip], [0.07, 0.05], segments=10), bead(tip, 0.07, segments=8)],
        eye=pair(bead(on(skull, head, 0.66, 0.15, 0.35), 0.26 * head)))  # fmt: skip


def ray(rng: Rng, traits: Traits) -> Part:
    """Draw a manta ray: wide pointed wings level with a flat body, two horns ahead, a whip of a tail."""
    fins, tail = sized(rng, traits, "fins", 0.85, by=1.8), sized(rng, traits, "tail", 0.93)
    lift, length = rng.uniform(-12, 18), rng.uniform(0.5, 0.62)
    rim = [(0, 0.85), (0.35, 0.6), (0.75, 0.1), (1, -0.35), (0.7, -0.4), (0.35, -0.6), (0, -0.8)]
    wing = turned(plate(np.array(rim) * [fins, length], 0.07, across="y", puff=0.6), lift, "z")
    horn = np.array([0.16, 0, 0.8 * length])
    path = [[0, 0.02, -0.6 * length], [0, 0.04, -0.6 * length - 0.5 * tail], [0, 0.1, -0.6 * length - tail]]
    return varied(rng, body=ellipsoid([0, 0, 0], [0.26, 0.14, 0.95 * length], rings=10),
        fin=pair(moved(wing, [0.06, 0, 0])), tail=bent_limb(path, [0.06, 0.035, 0.02]),
        eye=pair(bead([0.2, 0.08, 0.6 * length], 0.05)),
        horn=pair(bent_limb([horn, horn + [0.06, 0, 0.16], horn + [0.02, -0.03, 0.28]], [0.06, 0.05, 0.025],
        segments=8)))  # fmt: skip


def jellyfish(rng: Rng, traits: Traits) -> Part:
    """Draw a jellyfish: a bell with a hollow underside, frilled arms in its middle, thin arms from its rim."""
    arms, wide, tall = sized(rng, traits, "arms", 0.98), rng.uniform(0.48, 0.62), rng.uniform(0.42, 0.62)
    angle = np.linspace(0, np.pi / 2, 9)
    outer = np.stack([wide * np.sin(angle), tall * np.cos(angle)], 1)
    inner = outer * [0.8, 0.7] + [0, 0.02]
    bell = lathe([*inner, (1.02 * wide, -0.05), *outer[::-1]], segments=24)
    solids, sway = [], rng.uniform(0.04, 0.1)
    for place in circle(0.86 * wide, 8):
        t = np.linspace(0, 1, 6)
        wave = sway * np.sin(5 * t + rng.uniform(0, 6))
        path = place * (1 - 0.25 * t[:, None]) + np.stack([wave, 0.05 - arms * rng.uniform(0.8, 1.0) * t, wave[::-1]],
            1)  # fmt: skip
        solids.append(limb(path, np.linspace(0.035, 0.015, 6), segments=6, samples=1))
    for place in circle(0.14, 3):
        t = np.linspace(0, 1, 9)
        path = place * (1 + 0.5 * t[:, None]) + np.stack([0 * t, 0.25 * tall - 0.8 * arms * t, 0.06 * np.sin(11 * t)],
            1)  # fmt: skip
        solids.append(limb(path, np.linspace(0.1, 0.03, 9) * (1 + 0.3 * np.sin(14 * t)), segments=8, samples=1))
    return varied(rng, body=bell, arm=solids)


def squid(rng: Rng, traits: Traits) -> Part:
    """Draw a squid upright: a pointed mantle with two fins, large eyes, eight arms and two long ones below."""
    arms, fins = sized(rng, traits, "arms", 0.69), sized(rng, traits, "fins", 0.38, by=1.9)
    girth, tall = rng.uniform(0.22, 0.29), rng.uniform(0.8, 1.0)
    mantle = bent_limb([[0, 0.1, 0], [0, 0.35, 0], [0, 0.7 * tall, 0], [0, tall, 0]],
        [0.8 * girth, girth, 0.75 * girth, 0.06], segments=16)  # fmt: skip
    fin = plate([(-0.05, 0.35), (0.75, -0.15), (1, -0.5), (0.5, -0.75), (-0.05, -0.9)], 0.1, across="z")
    fin = fin._replace(verts=fin.verts * [fins, fins, 0.7])
    solids = []
    for number, place in enumerate(circle(0.5 * girth, 10)):
        long = number in (3, 7)
        reach, t = arms * (1.5 if long else rng.uniform(0.85, 1.05)), np.linspace(0, 1, 5)[:, None]
        out = place / (0.5 * girth)
        path = place + out * 0.55 * arms * t**1.5 + [0, 1, 0] * (-reach * (t - 0.35 * t**4) + 0.02)
        width = np.array([0.07, 0.055, 0.045, 0.035, 0.07 if long else 0.018])
        solids.append(limb(path, width, segments=7, samples=1))
    return varied(rng, body=mantle, head=bead([0, 0.02, 0], [0.85 * girth, 0.16, 0.85 * girth], segments=18, rings=8),
        arm=solids, fin=pair(moved(fin, [0.2 * girth, 0.95 * tall, 0])),
        eye=pair(bead([0.72 * girth, 0.03, 0.45 * girth], 0.09)))  # fmt: skip


def _tail_fan(root: Array, size: float, lean_deg: float) -> list[Part]:
    """Return five lobes that spread backward from the end of a tail."""
    lobe = plate(size * np.array([(0.08, 0), (0.22, -0.5), (0.14, -0.95), (-0.14, -0.95), (-0.22, -0.5), (-0.08, 0)]),
        0.05, across="y")  # fmt: skip
    return [moved(turned(turned(lobe, deg, "y"), lean_deg, "x"), root) for deg in (-58, -29, 0, 29, 58)]


def lobster(rng: Rng, traits: Traits) -> Part:
    """Draw a lobster: two great claws ahead, a jointed tail with a fan, long feelers, four pairs of legs."""
    claws, feelers = sized(rng, traits, "claws", 0.23, by=1.9), sized(rng, traits, "feelers", 0.8)
    tail, girth, y = sized(rng, traits, "tail", 0.69, by=1.9), rng.uniform(0.19, 0.24), 0.3
    t = np.linspace(0, 1, 6)
    row = np.stack([0 * t, y + 0.06 * np.sin(2.4 * t) * tail - 0.1 * t, -0.32 - tail * t], 1)
    body = limb([[0, y, 0.5], [0, y + 0.03, 0.1], [0, y, -0.3]],
        girth * np.array([[0.5, 0.4], [1.0, 0.95], [0.9, 0.9]]), samples=3)  # fmt: skip
    shoulder, wrist = np.array([0.5 * girth, y, 0.42]), np.array([0.46, y + 0.02, 0.85])
    palm = wrist + [0.0, 0, claws]
    return varied(rng, body=body,
        tail=[*(bead(place, [girth * (0.95 - 0.35 * k), 0.8 * girth * (1 - 0.35 * k), 0.14 * max(tail, 0.7)],
        segments=8) for place, k in zip(row, t, strict=True)), *_tail_fan(row[-1], 0.42, -8)],
        arm=pair(limb([shoulder, [0.5, y + 0.02, 0.52], wrist], [0.07, 0.07, 0.06], segments=7, samples=1)),
        claw=claw_of(palm, claws, 0.36), feeler=feelers_of(np.array([0.08, y + 0.05, 0.55]),
        feelers * np.array([0.5, 0.55, 0.5])),
        leg=legs_of(0.38, y - 0.05, ((0.3, 30), (0.14, 10), (-0.02, -10), (-0.18, -30)), lift=0.3, inner=0.12),
        eye=pair(bead([0.09, y + 0.14, 0.5], 0.05)))  # fmt: skip


def shrimp(rng: Rng, traits: Traits) -> Part:
    """Draw a shrimp: a jointed body bent into a hook, a fan at its end, long feelers, thin legs beneath."""
    tail, feelers = sized(rng, traits, "tail", 0.45), sized(rng, traits, "feelers", 0.8)
    bend, girth = rng.uniform(2.5, 3.4), rng.uniform(0.15, 0.19)
    turn = np.linspace(-0.35, bend, 9)
    path = np.stack([0 * turn, 0.5 * np.cos(turn), -0.5 * np.sin(turn)], 1)
    width = girth * np.array([0.95, 1.1, 1.15, 1.1, 1.0, 0.9, 0.75, 0.6, 0.45])
    rings = [bead(place, [0.9 * wide, wide, 1.05 * wide], segments=12) for place, wide in zip(path, width, strict=True)]
    skull = path[0] + [0, -0.04, 0.14]
    spear = limb([skull, skull + [0, 0.06, 0.36]], [[0.08, 0.05], [0.012, 0.012]], segments=8, samples=2)
    legs = [leg for k in range(1, 5)
        for leg in pair(bent_limb([path[k] - [-0.05, 0.05, 0], path[k] * [0, 0.72, 0.6] + [0.08, -0.12, 0.04],
        path[k] * [0, 0.4, 0.5] + [0.07, -0.14, 0.12]], [0.03, 0.025, 0.012], segments=6, samples=1))]  # fmt: skip
    end = np.degrees(bend)
    return varied(rng, body=rings, head=limb([path[0], skull + [0, -0.03, 0.12]], [girth, 0.5 * girth], segments=12),
        nose=spear, tail=_tail_fan(path[-1], tail, end), eye=pair(bead(skull + [0.11, 0.06, 0.08], 0.05)), leg=legs,
        feeler=feelers_of(skull + [0.04, 0, 0.16], feelers * np.array([0.3, 0.25, 0.85]), bow=0.3,
        thick=0.02))  # fmt: skip


def starfish(rng: Rng, traits: Traits) -> Part:
    """Draw a starfish that lies on the ground: five blunt arms about a low middle, knobs along them."""
    arms, wide = sized(rng, traits, "arms", 0.74, by=2.0), rng.uniform(0.2, 0.28)
    bend, droop = rng.uniform(-0.12, 0.12), rng.uniform(0.0, 0.1)
    path = np.array([[0, 0.12, 0.05], [bend, 0.12, 0.5 * arms], [0.2 * bend, 0.12 - droop, 0.12 + arms]])
    arm = bent_limb(path, [[0.12, wide], [0.1, 0.75 * wide], [0.05, 0.3 * wide]], segments=12, samples=4)
    knobs = [bead(path[0] + (path[1] - path[0]) * t + [0, 0.09, 0], 0.045, segments=7, rings=4) for t in (0.5, 1.0)]
    return varied(rng, body=bead([0, 0.13, 0], [1.15 * wide, 0.15, 1.15 * wide], segments=20, rings=8),
        arm=[turned(arm, 72 * k, "y") for k in range(5)],
        boss=[turned(knob, 72 * k, "y") for k in range(5) for knob in knobs])  # fmt: skip


def dolphin(rng: Rng, traits: Traits) -> Part:
    """Draw a leaping dolphin: an arched smooth body, a round brow over a beak, a curved back fin, level flukes."""
    fins = traits.draw(rng, "fins", (0.1, 0.14), (0.34, 0.42), (0.72, 0.85))
    nose = traits.draw(rng, "nose", (0.0, 0.03), (0.15, 0.2), (0.55, 0.68))
    girth, arch = rng.uniform(0.26, 0.34), rng.uniform(0.3, 0.45)
    along = np.array([0.62, 0.35, 0.0, -0.4, -0.75, -1.1])
    spine = np.stack([np.zeros(6), -arch * along**2, along], 1)
    parts = [limb(spine, girth * np.array([0.8, 0.97, 1.0, 0.76, 0.42, 0.2]), segments=20, samples=3)]
    down = np.array([0.0, -1.1 * arch, 1.0]) / np.hypot(1.1 * arch, 1.0)
    brow = spine[0] + 0.6 * girth * down - [0, 0.3 * girth, 0]
    for side in (0.04, -0.07):
        lip = brow + [0, side, 0]
        parts.append(limb([lip, lip + (0.5 * girth + nose) * down], [[0.13, 0.085], [0.09, 0.055]], segments=12))
    parts += pair(ellipsoid(spine[0] + [0.74 * girth, -0.1 * girth, 0.2 * girth], 0.05, rings=8))
    hook = fins * np.array([(0.5, 0.0), (0.0, 0.75), (-0.45, 1.0), (-0.25, 0.5), (-0.35, 0.0)])
    parts.append(moved(plate(hook, 0.11, across="x"), [0, girth * 0.8, -0.08]))
    fluke = plate(
        [(-0.06, 0.12), (0.3, 0.05), (0.52, -0.2), (0.5, -0.3), (0.2, -0.2), (-0.06, -0.18)], 0.11, across="y"
    )
    parts += pair(moved(turned(fluke, 2 * 45 * arch, "x"), spine[-1] + [0, 0, -0.05]))
    paddle = plate(fins * np.array([(0.0, 0.3), (0.6, 0.0), (0.95, -0.55), (0.5, -0.5), (0.0, -0.3)]), 0.11, across="y")
    return join([*parts, *pair(moved(turned(paddle, -28, "z"), [girth * 0.65, -girth * 0.55, 0.3]))])


def fish(rng: Rng, traits: Traits) -> Part:
    """Draw a fish: a round-bellied body, a flat forked tail, a flat back fin and belly fin, two side fins, eyes."""
    fins = traits.draw(rng, "fins", (0.08, 0.12), (0.28, 0.36), (0.62, 0.75))
    tail = traits.draw(rng, "tail", (0.14, 0.19), (0.4, 0.5), (0.85, 1.0))
    length, height = rng.uniform(0.66, 0.86), rng.uniform(0.4, 0.52)
    parts = [ellipsoid([0, 0, 0], [rng.uniform(0.25, 0.35), height, length])]
    root = -length * 0.85
    fork = np.array([(0.0, 0.12), (-0.55, 0.8), (-0.95, 0.95), (-0.8, 0.4), (-0.7, 0.0)])
    fork = np.concatenate([fork, (fork * [1, -1])[-2::-1]]) * tail
    stem = limb([[0, 0, root + 0.2], [0, 0, root - 0.12 - 0.1 * tail]], [[0.14, 0.1], [0.11, 0.07]], segments=10)
    parts += [stem, moved(plate(fork, 0.11, across="x"), [0, 0, root])]
    spread = 0.75 + 0.25 * fins
    back = [(0.34 * spread, -0.12), (0.1, 0.75 * fins), (-0.35 * spread, fins), (-0.5 * spread, -0.12)]
    parts.append(moved(plate(back, 0.11, across="x"), [0, height * 0.9, 0.0]))
    belly = [(0.14, 0.12), (-0.12, -0.8 * fins), (-0.42 * spread, -0.75 * fins), (-0.3 * spread, 0.12)]
    parts.append(moved(plate(belly, 0.11, across="x"), [0, -height * 0.88, -0.1]))
    side = plate(
        [(0.1, 0.1), (-0.5 * fins, 0.45 * fins), (-fins, 0.0), (-0.6 * fins, -0.45 * fins), (0.1, -0.1)],
        0.11,
        across="x",
    )
    parts += pair(moved(turned(side, -38, "y"), [0.24, -height * 0.22, length * 0.25]))
    return join([*parts, *pair(ellipsoid([0.17, height * 0.2, length * 0.66], 0.085, rings=8))])


def shark(rng: Rng, traits: Traits) -> Part:
    """Draw a shark: a pointed body, a tall triangular back fin, level side fins, an upright crescent tail."""
    fins = traits.draw(rng, "fins", (0.12, 0.16), (0.44, 0.54), (0.9, 1.05))
    tail = traits.draw(rng, "tail", (0.16, 0.22), (0.52, 0.62), (1.0, 1.15))
    girth, length = rng.uniform(0.26, 0.34), rng.uniform(0.9, 1.15)
    spine = np.stack(
        [np.zeros(6), [0.04, 0.0, 0.0, 0.0, 0.03, 0.06], np.array([0.95, 0.55, 0.1, -0.4, -0.8, -1.05]) * length], 1
    )
    parts = [limb(spine, girth * np.array([0.22, 0.75, 1.0, 0.85, 0.42, 0.28]), segments=20)]
    end = spine[-1] + [0, 0, 0.04]
    parts.append(
        moved(
            plate(
                tail * np.array([(0.3, -0.1), (-0.1, 0.55), (-0.55, 1.15), (-0.65, 1.05), (-0.4, 0.3), (-0.2, -0.12)]),
                0.11,
                across="x",
            ),
            end,
        )
    )
    parts.append(
        moved(
            plate(
                tail * np.array([(0.3, 0.1), (-0.1, -0.4), (-0.4, -0.75), (-0.5, -0.65), (-0.3, -0.2), (-0.2, 0.1)]),
                0.11,
                across="x",
            ),
            end,
        )
    )
    hook = fins * np.array([(0.55, 0.0), (0.0, 0.75), (-0.35, 1.05), (-0.3, 0.5), (-0.3, 0.0)])
    parts.append(moved(plate(hook, 0.12, across="x"), [0, girth * 0.75, 0.0]))
    blade = fins * np.array([(0.0, 0.35), (0.6, 0.0), (1.1, -0.55), (0.95, -0.65), (0.4, -0.4), (0.0, -0.3)])
    parts += pair(moved(turned(plate(blade, 0.11, across="y"), -18, "z"), [girth * 0.6, -girth * 0.45, length * 0.35]))
    rear = 0.45 * fins * np.array([(0.5, 0.0), (-0.3, 0.9), (-0.4, 0.0)])
    parts += [moved(plate(rear, 0.1, across="x"), [0, girth * 0.4, -length * 0.62])]
    return join([*parts, *pair(ellipsoid([girth * 0.5, 0.06, length * 0.68], 0.07, rings=8))])
