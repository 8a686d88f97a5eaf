"""Draw machines of building sites and fields, all facing +Z."""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.families.chassis import (
    WHEELS,
    Solids,
    bar,
    block,
    circle,
    drum,
    share,
    side,
    wheel,
    wheels,
)  # fmt: skip
from meshdeform.nouns.families.parts import Array, Part, ellipsoid, moved, named, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = [
    "bulldozer", "crane", "excavator", "forklift", "harvester", "quad", "rover", "steamroller",
]  # fmt: skip


def _tracks(long: float, tall: float, wide: float, x: float) -> Solids:
    """Return two tracks with rollers between them."""
    half = tall / 2
    belt = np.concatenate([circle(half, half, long - half, -90, 90, 5), circle(half, half, half - long, 90, 270, 5)])
    rollers = [drum(0.62 * half, wide / 2 + 0.03, [x, half, z]) for z in np.linspace(half - long, long - half, 3)]
    return {"track": pair(side(belt, wide, at=x)), "wheel": [each for one in rollers for each in pair(one)]}


def _cab(low: float, tall: float, wide: float, back: float, front: float, lean: float = 0.12) -> Solids:
    """Return a driver's cabin with raised panes and a roof."""
    outline = np.array([(back, low), (back + 0.02, low + tall), (front - lean, low + tall), (front, low)])
    middle = outline.mean(0) + [0, 0.12 * tall]
    panes = [side(middle + (outline - middle) * [0.76, 0.6], 2 * wide + 0.04, bevel=0.03)]
    panes += [side(middle + (outline - middle) * [1.08, 0.62], 1.6 * wide, bevel=0.03)]
    roof = block([0, low + tall, (back + front - lean) / 2], [2 * wide + 0.08, 0.07, front - back + 0.02], 0.4)
    return {"cabin": [side(outline, 2 * wide)], "window": panes, "roof": [roof]}


def _bucket(size: float, wide: float) -> Part:
    """Return a scoop about the origin, open ahead, that hangs from its upper end."""
    outer = [(0.0, 0.1), (-0.5, -0.1), (-0.55, -0.6), (-0.2, -1.0), (0.6, -0.9)]
    inner = [(0.5, -0.72), (-0.1, -0.8), (-0.35, -0.5), (-0.3, -0.15), (0.1, -0.05)]
    return side(size * np.array(outer + inner), wide, bevel=0.03)


def excavator(rng: Rng, traits: Traits) -> Part:
    """Draw an excavator: a house with a cabin that turns on tracks or wheels, a bent arm, a toothed bucket."""
    reach = traits.draw(rng, "arms", (0.3, 0.38), (0.68, 0.8), (1.2, 1.4))
    long, tall, wide = share(rng, 0.62, 0.7), share(rng, 0.26, 0.32), share(rng, 0.4, 0.46)
    deck = tall + 0.08
    house = share(rng, 0.28, 0.34)
    solids = _tracks(long, tall, 0.2, wide) | _cab(deck + 0.04, 0.58, 0.17, -0.06, 0.4)
    solids = {name: [moved(each, [0.22, 0, 0]) if name in ("cabin", "window", "roof") else each for each in several]
              for name, several in solids.items()}  # fmt: skip
    rear = [(-0.62, deck), (-0.66, deck + house), (0.1, deck + house), (0.36, deck + 0.1), (0.36, deck)]
    solids["body"] = [side(rear, 0.84, bevel=0.06), drum(0.3, 0.14, [0, tall, 0], "y"),
                      block([0, tall * 0.6, 0], [2 * wide, 0.14, 0.5])]  # fmt: skip
    root = np.array([-0.14, deck + 0.16, 0.3])
    elbow = root + reach * np.array([0, share(rng, 0.95, 1.15), 0.62])
    knee = elbow + reach * np.array([0, share(rng, 0.0, 0.15), 0.5])
    wrist = knee + reach * np.array([0, share(rng, -1.15, -0.9), share(rng, 0.0, 0.4)])
    solids["arm"] = [bar(root, elbow, knee, radius=(0.08, 0.1, 0.075)), bar(knee, wrist, radius=(0.085, 0.055))]
    size = 0.26
    scoop = moved(turned(_bucket(size, 0.34), share(rng, 150, 190), "y"), wrist + [0, -0.02, 0])
    solids["basket"] = [scoop]
    return named(**solids)


def bulldozer(rng: Rng, traits: Traits) -> Part:
    """Draw a bulldozer: tracks, a bonnet with an exhaust, a cabin behind, a broad curved blade on two arms."""
    size = traits.draw(rng, "blade", (0.1, 0.16), (0.4, 0.48), (0.8, 0.95))
    long, tall, wide = share(rng, 0.6, 0.7), share(rng, 0.36, 0.42), share(rng, 0.38, 0.44)
    deck = tall + 0.02
    solids = _tracks(long, tall, 0.22, wide) | _cab(deck, share(rng, 0.52, 0.6), 0.3, -0.52, 0.08, 0.06)
    hood = [(-long, 0.2), (-long, deck + 0.12), (0.04, deck + 0.14), (0.04, deck + 0.28), (long, deck + 0.22)]
    solids["body"] = [side([*hood, (long, 0.2)], 0.52, bevel=0.06)]
    solids["chimney"] = [bar([0.1, deck, 0.4], [0.1, deck + 0.5, 0.4], radius=0.04)]
    front, high = long + 0.24, 0.02
    curve = circle(1.0, 0.5, 0.9, 145, 215, 6) * [1, 1]
    curve = np.concatenate([curve, (curve + [0.12, 0])[::-1]]) * size + [front, high]
    solids["blade"] = [side(curve, 2.6 * wide, bevel=0.03)]
    solids["arm"] = pair(bar([wide + 0.16, 0.22, 0], [wide + 0.16, 0.2, front + 0.1 * size], radius=0.06))
    return named(**solids)


def forklift(rng: Rng, traits: Traits) -> Part:
    """Draw a forklift: a short heavy body with a seat under a cage, an upright mast ahead, two flat forks."""
    long, wide, tall = share(rng, 0.46, 0.54), share(rng, 0.3, 0.35), share(rng, 0.34, 0.4)
    radius = 0.17 * traits.draw(rng, "wheels", *WHEELS)
    top, mast = tall + share(rng, 0.55, 0.65), share(rng, 1.05, 1.35)
    lift = share(rng, 0.04, 0.5)
    body = [(-long, 0.12), (-long - 0.04, tall + 0.12), (-0.2, tall + 0.14), (-0.1, tall - 0.08), (long, tall - 0.04)]
    solids: Solids = {
        "body": [side([*body, (long, 0.12)], 2 * wide, bevel=0.06)],
        "seat": [block([0, tall + 0.1, -0.12], [0.34, 0.14, 0.3], 0.3), block([0, tall + 0.3, -0.3], [0.34, 0.36, 0.1], 0.3)],
        "roof": [block([0, top, -0.06], [1.9 * wide, 0.06, 1.5 * long], 0.3)],
        "frame": [*pair(bar([0.85 * wide, tall, -0.8 * long], [0.85 * wide, top, -0.66 * long], radius=0.035)),
                  *pair(bar([0.85 * wide, tall - 0.1, 0.85 * long], [0.85 * wide, top, 0.5 * long], radius=0.035))],
        "mast": [*pair(block([0.62 * wide, mast / 2 + 0.06, long + 0.1], [0.08, mast, 0.1])),
                 *(block([0, y, long + 0.1], [1.3 * wide, 0.07, 0.06]) for y in (0.3, mast))],
        "fork": [*pair(block([0.5 * wide, lift, long + 0.46], [0.12, 0.05, 0.66])),
                 *pair(block([0.5 * wide, lift + 0.14, long + 0.17], [0.12, 0.32, 0.05])),
                 block([0, lift + 0.26, long + 0.17], [1.5 * wide, 0.06, 0.06])],
        "wheel": [*wheels(radius, 0.08, wide, [0.62 * long]), *wheels(0.85 * radius, 0.07, wide, [-0.7 * long])],
    }  # fmt: skip
    return named(**solids)


def crane(rng: Rng, traits: Traits) -> Part:
    """Draw a crane: a tower crane with a jib, a counterweight and a hook, or one on wheels with a raised arm."""
    reach = traits.draw(rng, "arms", (0.25, 0.35), (0.85, 1.0), (1.5, 1.75))
    if rng.random() < 0.6:
        return _tower_crane(rng, reach)
    long, wide, lean = 0.75, 0.3, share(rng, 35, 55)
    solids = _cab(0.3, 0.4, 0.3, 0.45, 0.78)
    solids["body"] = [block([0, 0.26, 0], [2 * wide, 0.2, 2 * long]), drum(0.24, 0.1, [0, 0.4, -0.3], "y")]
    solids["body"] += [block([0, 0.56, -0.42], [0.52, 0.26, 0.5])]
    solids["wheel"] = wheels(0.17, 0.08, wide, [-0.55, -0.15, 0.55])
    root, way = np.array([0, 0.6, -0.5]), np.array([0, np.sin(np.radians(lean)), np.cos(np.radians(lean))])
    end = root + way * (0.5 + reach)
    solids["arm"] = [bar(root, root + way * (0.3 + 0.5 * reach), radius=0.1), bar(root + way * 0.2, end, radius=0.065)]
    solids |= _hook(end, share(rng, 0.3, 0.5))
    return named(**solids)


def _hook(above: Array, drop: float) -> Solids:
    """Return a rope with a hook at its end."""
    end = above - [0, drop, 0]
    arc = [end + 0.09 * np.array([0, np.sin(a) - 1, np.cos(a)]) for a in np.radians([90, 30, -30, -90, -150])]
    return {"rope": [bar(above, end, radius=0.022)], "claw": [bar(*arc, radius=0.035), drum(0.06, 0.05, end, "y", 10)]}


def _tower_crane(rng: Rng, reach: float) -> Part:
    """Draw a mast of braced posts on a base, a jib ahead, a shorter one behind with a weight, stays from a peak."""
    tall, half = share(rng, 1.2, 1.5), 0.1
    top = tall + share(rng, 0.26, 0.34)
    corners = [(x, z) for x in (-half, half) for z in (-half, half)]
    steps = np.linspace(0.05, tall, 6)
    mast = [block([x, tall / 2, z], [0.045, tall, 0.045]) for x, z in corners]
    for k, (low, high) in enumerate(zip(steps, steps[1:], strict=False)):
        x = half if k % 2 else -half
        mast += [bar([-x, low, z], [x, high, z], radius=0.022, segments=5) for z in (-half, half)]
    jib = [bar([x, tall, -0.1], [x, tall, 0.25 + reach], radius=0.028, segments=5) for x in (-0.07, 0.07)]
    jib.append(bar([0, tall + 0.13, 0], [0, tall + 0.13, 0.2 + reach], radius=0.028, segments=5))
    for z in np.linspace(0.1, 0.2 + reach, 5):
        jib += pair(bar([0.07, tall, z], [0, tall + 0.13, z - 0.05], radius=0.02, segments=5))
    peak, stay = [0, top, 0], bar([0, top, 0], [0, tall + 0.1, 0.1 + 0.8 * reach], radius=0.02, segments=5)
    solids: Solids = {
        "base": [block([0, 0.04, 0], [0.5, 0.1, 0.5])],
        "tower": [*mast, bar([0, tall, 0], peak, radius=0.04), stay, bar(peak, [0, tall, -0.45], radius=0.02)],
        "cabin": [block([0.15, tall - 0.06, 0.08], [0.16, 0.2, 0.2])],
        "arm": [*jib, block([0, tall, -0.24], [0.16, 0.06, 0.56])],
        "weight": [block([0, tall - 0.04, -0.46], [0.18, 0.24, 0.16])],
    }
    return named(**solids, **_hook(np.array([0, tall, 0.1 + share(rng, 0.5, 0.9) * reach]), share(rng, 0.3, 0.7)))


def steamroller(rng: Rng, traits: Traits) -> Part:
    """Draw a road roller: a broad drum ahead in a fork, wheels or a second drum behind, a roof on posts."""
    long, wide, tall = share(rng, 0.5, 0.58), share(rng, 0.32, 0.38), share(rng, 0.26, 0.32)
    radius, steam = 0.3 * traits.draw(rng, "wheels", *WHEELS), rng.random() < 0.4
    level, top = radius + 0.12, radius + 0.12 + tall + share(rng, 0.44, 0.52)
    front = long + 0.22
    solids: Solids = {
        "body": [block([0, level + 0.02, -0.3 * long], [1.5 * wide, tall, 1.3 * long])],
        "wheel": [drum(radius, wide, [0, radius, front], segments=22)],
        "fork": [*pair(block([wide + 0.06, 0.5 * radius + 0.5 * level, front], [0.06, level - radius + 0.3, 0.14])),
                 block([0, level + 0.2, front], [2 * wide + 0.18, 0.1, 0.16]),
                 block([0, level + 0.12, front - 0.4], [0.2, 0.14, 0.8])],
        "roof": [block([0, top, -0.3 * long], [1.7 * wide, 0.07, 1.5 * long], 0.4)],
        "frame": [each for z in (-0.9 * long, 0.3 * long) for each in
                  pair(bar([0.7 * wide, level, z], [0.7 * wide, top, z], radius=0.035))],
        "seat": [block([0, level + tall / 2 + 0.12, -0.5 * long], [0.3, 0.24, 0.14], 0.3)],
    }  # fmt: skip
    if steam:
        solids["body"].append(drum(0.2, 0.42, [0, level + 0.12, 0.55 * long], "z"))
        solids["chimney"] = [bar([0, level, 0.95 * long], [0, top + 0.1, 0.95 * long], radius=(0.05, 0.07))]
        solids["wheel"] += pair(wheel(1.3 * radius, 0.12, [wide, 1.3 * radius, -0.6 * long]))
    else:
        solids["wheel"] += [drum(radius, wide, [0, radius, -0.75 * long], segments=22)]
    return named(**solids)


def harvester(rng: Rng, traits: Traits) -> Part:
    """Draw a combine harvester: a tall body with a tank, a cabin ahead, large front wheels, a broad reel before it."""
    long, wide, tall = share(rng, 0.7, 0.8), share(rng, 0.32, 0.37), share(rng, 0.52, 0.6)
    radius = 0.3 * traits.draw(rng, "wheels", *WHEELS)
    floor, reel = 0.26, share(rng, 0.72, 0.9)
    body = [(-long, floor + 0.16), (-long - 0.04, floor + 0.7 * tall), (-0.7 * long, floor + tall), (0.2, floor + tall)]
    solids = _cab(floor + 0.2, 0.58 * tall + 0.2, 0.8 * wide, 0.18, 0.62, 0.0)
    solids["body"] = [side([*body, (0.24, floor), (-0.5 * long, floor)], 2 * wide, bevel=0.06)]
    solids["tank"] = [block([0, floor + tall + 0.06, -0.24], [1.6 * wide, 0.16, 0.6])]
    y, z = 0.2, long + 0.32
    solids["plough"] = [block([0, 0.16, z - 0.18], [2 * reel, 0.24, 0.1]), block([0, 0.05, z], [2 * reel, 0.06, 0.44]),
                        side([(0.3, 0.3), (0.3, 0.52), (z - 0.16, 0.24), (z - 0.16, 0.1)], 0.4)]  # fmt: skip
    solids["plough"] += pair(side([(z - 0.22, 0.04), (z - 0.2, 0.38), (z + 0.34, 0.06)], 0.06, at=reel))
    solids["roller"] = [drum(0.06, reel, [0, y + 0.08, z + 0.02], segments=8)]
    for turn in np.arange(5) * 72.0:
        bat = turned(block([0, 0.17, 0], [2 * reel - 0.06, 0.05, 0.03]), turn, "x")
        arm = turned(block([0, 0.09, 0], [0.05, 0.2, 0.03]), turn, "x")
        solids["roller"] += [moved(bat, [0, y + 0.08, z + 0.02]), *pair(moved(arm, [0.9 * reel, y + 0.08, z + 0.02]))]
    solids["wheel"] = [
        *wheels(radius, 0.13, wide + 0.04, [0.2]),
        *wheels(0.6 * radius, 0.08, wide - 0.04, [-0.72 * long]),
    ]
    solids["exhaust"] = [
        bar([-0.6 * wide, floor + 0.2, -0.7 * long], [-0.9 * wide, floor + tall + 0.2, -long - 0.1], radius=0.05)
    ]
    return named(**solids)


def quad(rng: Rng, traits: Traits) -> Part:
    """Draw a quad bike: four fat tyres under mudguards, a long saddle, handlebars, racks."""
    long, track = share(rng, 0.55, 0.62), share(rng, 0.34, 0.4)
    radius = 0.25 * traits.draw(rng, "wheels", *WHEELS)
    level = 0.3 + 0.5 * radius
    solids: Solids = {
        "body": [side([(-long, level), (-0.2, level + 0.14), (0.1, level + 0.04), (0.22, level + 0.26),
                       (0.5 * long, level + 0.28), (0.95 * long, level + 0.12), (long, level - 0.04), (0.3, 0.2),
                       (-0.3, 0.2)], 0.3, bevel=0.2)],
        "seat": [side([(-0.85 * long, level + 0.12), (-0.8 * long, level + 0.24), (-0.1, level + 0.18),
                       (0.12, level + 0.22), (0.14, level + 0.08)], 0.28, bevel=0.25)],
        "handle": [*pair(bar([0, level + 0.28, 0.34], [0.18, level + 0.44, 0.3], [0.38, level + 0.44, 0.22], radius=0.035))],
        "lamp": pair(drum(0.07, 0.05, [0.13, level + 0.16, 0.86 * long], "z", 12)),
        "wheel": wheels(radius, 0.13, track, [-0.68 * long, 0.68 * long]),
        "bumper": [block([0, level - 0.02, long + 0.05], [0.44, 0.05, 0.06])],
        "axle": [bar([-track, radius, z * long], [track, radius, z * long], radius=0.045) for z in (-0.68, 0.68)],
    }  # fmt: skip
    for z in (-0.68 * long, 0.66 * long):
        guard = circle(0.32, level - 0.22, 0, 35, 145, 7)
        guard = np.concatenate([guard, (guard - [0, 0.06])[::-1]]) + [z, 0.08]
        solids["bumper"] += pair(side(guard, 0.3, at=track - 0.06))
    return named(**solids)


def rover(rng: Rng, traits: Traits) -> Part:
    """Draw a rover for planets: a flat box on six wheels at rockers, a mast with a camera, an arm or a dish."""
    long, wide = share(rng, 0.42, 0.52), share(rng, 0.3, 0.38)
    radius, tall = 0.16 * traits.draw(rng, "wheels", *WHEELS), share(rng, 0.4, 0.55)
    level, x = 0.46, wide + 0.18
    head = level + 0.1 + tall
    solids: Solids = {
        "body": [block([0, level, 0], [2 * wide, 0.22, 2 * long]),
                 block([0, level + 0.13, -0.05], [2 * wide + 0.2, 0.04, 1.9 * long])],
        "wheel": wheels(radius, 0.09, x, [-long - 0.06, 0, long + 0.06]),
        "leg": [*pair(bar([x - 0.06, radius, long + 0.06], [x - 0.1, level, 0.1], [x - 0.06, radius, 0], radius=0.035)),
                *pair(bar([x - 0.1, level, 0.0], [x - 0.06, radius, -long - 0.06], radius=0.035))],
        "stem": [bar([0.5 * wide, level, 0.7 * long], [0.5 * wide, head, 0.7 * long], radius=0.04)],
        "head": [block([0.5 * wide, head, 0.72 * long], [0.26, 0.14, 0.16], 0.2)],
        "eye": [drum(0.045, 0.05, [0.5 * wide + dx, head, 0.72 * long + 0.08], "z", 10) for dx in (-0.07, 0.07)],
    }  # fmt: skip
    if rng.random() < 0.5:
        dish = ellipsoid([0, 0, 0], [0.24, 0.06, 0.24], rings=6)
        solids["dish"] = [moved(turned(dish, share(rng, 20, 50), "x"), [-0.5 * wide, level + 0.34, -0.4 * long])]
        solids["stem"] += [
            bar([-0.5 * wide, level, -0.4 * long], [-0.5 * wide, level + 0.34, -0.4 * long], radius=0.035)
        ]
    else:
        start = [-0.5 * wide, level, long]
        solids["arm"] = [
            bar(start, [-0.5 * wide, level + 0.22, long + 0.24], [-0.5 * wide, 0.2, long + 0.4], radius=0.04)
        ]
        solids["hand"] = [drum(0.09, 0.06, [-0.5 * wide, 0.2, long + 0.4], "z", 12)]
    return named(**solids)
