"""Draw vehicles on wheels and tracks, all facing +Z."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshdeform.nouns.families.parts import Part, box, ellipsoid, extrude, join, lathe, limb, moved, pair, turned
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["bus", "motorcycle", "tank", "tractor", "train", "truck"]


def _wheel(radius: float, half: float, centre: ArrayLike) -> Part:
    """Return a tyre with a hub that stands out, its axle along X; `half` is half the tyre's width."""
    tyre = [(0.9 * radius, -half), (radius, -0.6 * half), (radius, 0.6 * half), (0.9 * radius, half)]
    dish = [(0.6 * radius, half), (0.5 * radius, 0.6 * half), (0.3 * radius, 0.6 * half), (0.25 * radius, 1.15 * half)]
    profile = [*((r, -y) for r, y in dish[::-1]), *tyre, *dish]
    return moved(turned(lathe(profile), 90, "z"), centre)


def bus(rng: Rng, traits: Traits) -> Part:
    """Draw a bus: a long tall box with a sunk band of windows between posts under a thick roof, on four wheels."""
    width, length = rng.uniform(0.72, 0.82), rng.uniform(1.9, 2.2)
    lower, pane = rng.uniform(0.36, 0.44), rng.uniform(0.3, 0.36)
    wheel = traits.draw(rng, "wheels", (0.1, 0.13), (0.2, 0.24), (0.4, 0.46))
    floor = 0.6 * wheel + 0.04
    top = floor + lower + pane
    parts = [box([0, floor + lower / 2, 0], [width, lower, length], round_by=0.12)]
    parts += [box([0, floor + lower, 0], [width - 0.16, 2 * pane, length - 0.16], round_by=0.1)]
    parts += [box([0, top + 0.05, 0], [width, 0.18, length], round_by=0.45)]
    parts += [box([0, floor + 0.1, length / 2], [width * 1.04, 0.13, 0.14], round_by=0.4)]
    posts = np.linspace(-length / 2 + 0.07, length / 2 - 0.07, 6)
    parts += [box([0, floor + lower + pane / 2, z], [width, pane + 0.1, 0.1], round_by=0.2) for z in posts[1:-1]]
    corner = [box([width / 2 - 0.06, floor + lower + pane / 2, z], [0.12, pane + 0.1, 0.12]) for z in posts[[0, -1]]]
    for part in (*corner, *(_wheel(wheel, 0.1, [width / 2, wheel, z * length]) for z in (-0.3, 0.32))):
        parts += pair(part)
    lamp = ellipsoid([width * 0.34, floor + lower * 0.55, length / 2], 0.08, rings=8)
    return join([*parts, *pair(lamp)])


def motorcycle(rng: Rng, traits: Traits) -> Part:
    """Draw a motorcycle: two thick wheels in line, an engine, a tank, a seat, a raked fork with a broad handlebar."""
    wheel = traits.draw(rng, "wheels", (0.23, 0.27), (0.37, 0.42), (0.58, 0.66))
    base, half = rng.uniform(0.64, 0.72), rng.uniform(0.1, 0.13)
    hub, high = wheel, rng.uniform(0.76, 0.86) + 0.3 * wheel
    front, rear = [0.0, hub, base], [0.0, hub, -base]
    parts = [_wheel(wheel, half, front), _wheel(wheel, half, rear)]
    parts += [box([0, hub + 0.12, -0.02], [0.34, 0.42, 0.5], round_by=0.35)]
    parts += [limb([[0, hub, -base], [0, hub + 0.05, 0], [0, high - 0.2, base * 0.6]], [0.09, 0.12, 0.09], segments=10)]
    parts += [limb([[0, high - 0.2, 0.3], [0, high - 0.2, 0.05]], [[0.16, 0.18], [0.17, 0.16]], segments=12)]
    parts += [limb([[0, high - 0.3, 0.0], [0, high - 0.28, -0.4], [0, high - 0.1, -base * 1.1]], [[0.11, 0.17]] * 3)]
    parts += [ellipsoid([0, high - 0.05, base * 0.72], [0.14, 0.14, 0.12], rings=10)]
    top, grip = [0.11, high, base * 0.5], [0.46, high + 0.08, base * 0.25]
    parts += pair(limb([[half + 0.06, hub, base], top], [0.075, 0.075], segments=8))
    parts += pair(limb([[0.0, high, base * 0.55], [0.25, high + 0.1, base * 0.45], grip], [0.075] * 3, segments=8))
    pipe = [[0.2, hub, 0.2], [0.21, hub, -0.1], [0.22, hub + 0.04, -base * 0.7]]
    return join([*parts, *pair(limb(pipe, [0.07, 0.075, 0.085], segments=8))])


def tank(rng: Rng, traits: Traits) -> Part:
    """Draw a tank: two broad tracks with discs in them, a low hull, a flat turret with a hatch and a long gun."""
    width, length = rng.uniform(0.5, 0.58), rng.uniform(0.84, 0.98)
    gun = traits.draw(rng, "gun", (0.08, 0.16), (0.62, 0.78), (1.5, 1.8))
    track, tall = rng.uniform(0.24, 0.3), rng.uniform(0.4, 0.46)
    outline = [(-length * 0.72, 0), (length * 0.72, 0), (length * 0.97, tall * 0.4), (length, tall * 0.75)]
    outline += [(length * 0.9, tall), (-length * 0.9, tall), (-length, tall * 0.75), (-length * 0.97, tall * 0.4)]
    belt = moved(turned(extrude(outline, track, bevel=0.2), -90, "y"), [width, 0, 0])
    parts = pair(belt)
    for z in np.linspace(-0.62, 0.62, 4):
        parts += pair(_wheel(0.17 * length, 0.07, [width + track / 2, tall * 0.42, z * length]))
    deck = tall + 0.1
    parts.append(box([0, tall * 0.75, 0], [2 * width, 0.34, 1.75 * length], round_by=0.3))
    turret, radius = rng.uniform(0.26, 0.32), rng.uniform(0.42, 0.48)
    dome = lathe([(radius, 0.0), (1.05 * radius, 0.35 * turret), (0.78 * radius, turret), (0.3, turret + 0.02)])
    parts.append(moved(Part(dome.verts * [1.0, 1.0, 1.2], dome.faces), [0, deck - 0.04, -0.1]))
    parts.append(moved(lathe([(0.15, 0.0), (0.15, 0.1), (0.1, 0.14)]), [-0.12, deck + turret - 0.06, -0.22]))
    height, start = deck + 0.45 * turret, radius * 1.1 - 0.1
    parts.append(box([0, height, start], [0.32, 0.24, 0.24], round_by=0.4))
    barrel = [[0, height, start], [0, height, start + 0.2 + gun], [0, height, start + 0.34 + gun]]
    muzzle = [[0, height, start + 0.22 + gun], [0, height, start + 0.34 + gun]]
    return join([*parts, limb(barrel, [0.085] * 3, segments=10), limb(muzzle, [0.115, 0.115], segments=10)])


def tractor(rng: Rng, traits: Traits) -> Part:
    """Draw a tractor: two huge wheels beside a cabin behind, two small ones before, a slim bonnet, an exhaust pipe."""
    rear = traits.draw(rng, "wheels", (0.22, 0.27), (0.5, 0.58), (0.76, 0.86))
    width, hood = rng.uniform(0.3, 0.36), rng.uniform(0.85, 1.0)
    front, level = 0.52 * rear, 0.3 + 0.7 * rear
    cabin, tall = rng.uniform(0.5, 0.58), rng.uniform(0.5, 0.6)
    parts = [box([0, level, hood / 2], [width, 0.4, hood], round_by=0.35)]
    parts += [box([0, level - 0.18, hood * 0.3], [width * 0.7, 0.3, hood * 1.2], round_by=0.2)]
    parts += [box([0, level - 0.1, -0.18], [cabin, 0.4, 0.6], round_by=0.2)]
    parts += [box([0, level + tall / 2 + 0.05, -0.16], [cabin - 0.12, tall, 0.46], round_by=0.1)]
    parts += [box([0, level + tall + 0.1, -0.16], [cabin + 0.12, 0.13, 0.72], round_by=0.4)]
    parts += [limb([[0, level + 0.1, hood * 0.6], [0, level + 0.6, hood * 0.6]], [0.07, 0.07], segments=10)]
    parts += [limb([[-cabin * 0.7, rear, -0.22], [cabin * 0.7, rear, -0.22]], [0.12, 0.12], segments=10)]
    parts += [limb([[0, front, hood * 0.82], [0, level - 0.1, hood * 0.82]], [0.11, 0.11], segments=10)]
    parts += [limb([[-width, front, hood * 0.82], [width, front, hood * 0.82]], [0.09, 0.09], segments=10)]
    for z in (-0.4, 0.08):
        parts += pair(box([cabin / 2 - 0.05, level + tall / 2 + 0.05, z], [0.1, tall + 0.05, 0.1], round_by=0.3))
    parts += pair(_wheel(rear, 0.17, [cabin / 2 + 0.2, rear, -0.22]))
    parts += pair(_wheel(front, 0.11, [width + 0.02, front, hood * 0.82]))
    return join([*parts, *pair(ellipsoid([width * 0.32, level + 0.05, hood], 0.075, rings=8))])


def train(rng: Rng, traits: Traits) -> Part:
    """Draw a steam locomotive: a round boiler, a flared chimney, a dome, a cab behind, a cowcatcher, six wheels."""
    boiler, length = rng.uniform(0.29, 0.34), rng.uniform(1.15, 1.35)
    wheel = traits.draw(rng, "wheels", (0.1, 0.13), (0.22, 0.26), (0.42, 0.48))
    cab, frame = rng.uniform(0.5, 0.58), 1.3 * wheel + 0.06
    axis, back = frame + boiler + 0.06, -length * 0.35
    front = back + length
    tube = [(boiler * 0.8, -0.1), (boiler, 0.0), (boiler, length - 0.06), (boiler * 1.12, length - 0.05)]
    tube += [(boiler * 1.12, length + 0.06), (boiler * 0.86, length + 0.08), (boiler * 0.4, length + 0.16)]
    stack = [(0.12, 0.0), (0.11, boiler + 0.2), (0.22, boiler + 0.42), (0.22, boiler + 0.5), (0.15, boiler + 0.5)]
    dome = [(0.17, 0.0), (0.17, boiler + 0.1), (0.1, boiler + 0.19)]
    width, tall = 2.2 * boiler, 2 * boiler + 0.34
    parts = [moved(turned(lathe(tube), 90, "x"), [0, axis, back]), moved(lathe(stack), [0, axis, front - 0.16])]
    parts += [moved(lathe(dome), [0, axis, back + length * 0.42])]
    parts += [box([0, frame, (front + back - cab) / 2], [width * 0.9, 0.2, length + cab], round_by=0.2)]
    parts += [box([0, frame + tall / 2, back - cab / 2], [width - 0.12, tall, cab - 0.1], round_by=0.06)]
    parts += [box([0, frame + tall * 0.28, back - cab / 2], [width, tall * 0.56, cab], round_by=0.1)]
    parts += [box([0, frame + tall + 0.03, back - cab / 2], [width + 0.16, 0.15, cab + 0.2], round_by=0.45)]
    for z in (0.06, cab - 0.06):
        parts += pair(box([width / 2 - 0.06, frame + tall / 2, back - z], [0.12, tall, 0.12], round_by=0.3))
    plough = extrude([(-0.3, 0.0), (0.3, 0.0), (0.05, 0.36), (-0.05, 0.36)], width * 0.9, bevel=0.1)
    parts.append(moved(turned(plough, 90, "y"), [0, 0.3 * frame, front + 0.02]))
    for z in (-0.34, 0.16, 0.66):
        parts += pair(_wheel(wheel, 0.09, [width / 2 - 0.04, wheel, back + z * length * 0.95]))
    return join(parts)


def truck(rng: Rng, traits: Traits) -> Part:
    """Draw a truck: a cab with a sunk windscreen and a bumper, a gap, a taller ribbed box behind, six wheels."""
    width, length = rng.uniform(0.76, 0.86), rng.uniform(1.25, 1.5)
    wheel = traits.draw(rng, "wheels", (0.1, 0.13), (0.22, 0.26), (0.42, 0.48))
    floor, load, tall = wheel + 0.1, rng.uniform(0.82, 0.95), rng.uniform(0.54, 0.62)
    cab = rng.uniform(0.46, 0.54)
    front = length * 0.42 + 0.16
    middle = front + cab / 2
    parts = [box([0, floor, 0.16], [width * 0.7, 0.2, length + cab + 0.1], round_by=0.2)]
    parts += [box([0, floor + load / 2, front - 0.16 - length / 2], [width, load, length], round_by=0.06)]
    parts += [box([0, floor + tall * 0.28, middle + 0.06], [width * 0.94, tall * 0.66, cab + 0.12], round_by=0.25)]
    parts += [box([0, floor + tall / 2, middle - 0.03], [width * 0.78, tall, cab - 0.12], round_by=0.1)]
    parts += [box([0, floor + tall + 0.04, middle - 0.04], [width * 0.94, 0.13, cab - 0.02], round_by=0.45)]
    parts += [box([0, floor - 0.1, front + cab + 0.1], [width, 0.16, 0.16], round_by=0.4)]
    for z in (-cab / 2 + 0.04, cab / 2 - 0.1):
        parts += pair(box([width * 0.41, floor + tall * 0.7, middle + z], [0.1, tall * 0.7, 0.1], round_by=0.3))
    for z in np.linspace(front - 0.1 - length, front - 0.22, 5):
        parts.append(box([0, floor + load / 2, z], [width + 0.1, load + 0.06, 0.1], round_by=0.4))
    for z in (front - length * 0.98, front - length * 0.98 + 2.1 * min(wheel, 0.3), middle + 0.02):
        parts += pair(_wheel(wheel, 0.11, [width / 2 - 0.02, wheel, z]))
    return join([*parts, *pair(ellipsoid([width * 0.32, floor + 0.1, front + cab + 0.12], 0.08, rings=8))])
