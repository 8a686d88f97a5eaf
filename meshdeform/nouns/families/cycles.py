"""Draw what one rides, pushes or sits in on light wheels, all facing +Z."""

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
    spoked,
    wheel,
    wheels,
)
from meshdeform.nouns.families.parts import Part, box, limb, named, pair
from meshdeform.nouns.families.traits import Rng, Traits

__all__ = ["bicycle", "scooter", "skateboard", "stroller", "tricycle", "wheelchair"]


def bicycle(rng: Rng, traits: Traits) -> Part:
    """Draw a bicycle: two thin spoked wheels, a frame of two triangles, a saddle, a handlebar, pedals."""
    radius = 0.36 * traits.draw(rng, "wheels", *WHEELS)
    base, tube, down = share(rng, 0.54, 0.6), share(rng, 0.028, 0.036), share(rng, 0.0, 0.3)
    seat, crank = np.array([0, 0.86, -0.24]), np.array([0, 0.32, -0.06])
    head, rear, front = np.array([0, 0.82, 0.34]), np.array([0, radius, -base]), np.array([0, radius, base])
    post = crank + 0.85 * (seat - crank)
    grip = head + [0.26, share(rng, 0.06, 0.16), share(rng, -0.16, 0.1)]
    solids: Solids = {
        "wheel": [*spoked(radius, 0.035, rear, 5), *spoked(radius, 0.035, front, 5)],
        "frame": [bar(crank, seat, radius=tube), bar(post - [0, down, 0], head - [0, 0.06, 0], radius=tube),
                  bar(crank, head - [0, 0.12, -0.02], radius=tube),
                  *pair(bar(crank + [0.05, 0, 0], rear + [0.07, 0, 0], post + [0.02, -0.06, 0], radius=0.75 * tube))],
        "fork": [*pair(bar(front + [0.07, 0, 0], head + [0.05, -0.16, 0.03], head + [0, 0.02, 0], radius=tube))],
        "handle": [*pair(bar(head + [0, 0.02, 0], head + [0, 0.1, 0.02], grip, grip + [0.02, -0.02, -0.12],
                             radius=(tube, tube, tube, 1.3 * tube)))],
        "seat": [limb([seat + [0, 0.03, -0.1], seat + [0, 0.03, 0.16]], [[0.1, 0.045], [0.035, 0.035]], segments=10)],
        "pedal": [drum(0.1, 0.02, crank + [0.06, 0, 0]),
                  bar(crank + [0.08, 0, 0], crank + [0.09, -0.14, 0.06], radius=0.022),
                  bar(crank + [-0.08, 0, 0], crank + [-0.09, 0.14, -0.06], radius=0.022),
                  block(crank + [0.15, -0.14, 0.06], [0.12, 0.03, 0.08]),
                  block(crank + [-0.15, 0.14, -0.06], [0.12, 0.03, 0.08])],
    }  # fmt: skip
    if rng.random() < 0.3:
        solids["basket"] = [block(head + [0, -0.02, 0.2], [0.3, 0.2, 0.22])]
    return named(**solids)


def scooter(rng: Rng, traits: Traits) -> Part:
    """Draw a scooter: one to kick, with a board and a tall bar, or one with an engine, a seat and a leg shield."""
    size = traits.draw(rng, "wheels", *WHEELS)
    if rng.random() < 0.5:
        radius, long, high = 0.12 * size, share(rng, 0.5, 0.6), share(rng, 0.95, 1.15)
        top = np.array([0, high, long * 0.62])
        foot = np.array([0, 0.14, long - 0.02])
        return named(
            body=[block([0, 0.13, -0.05], [0.2, 0.06, 1.5 * long], 0.3), bar([0, 0.13, 0.6 * long], foot, radius=0.05)],
            fork=[bar(foot, top, radius=0.04), bar([0, radius, long + 0.02], foot + [0, 0.14, -0.02], radius=0.05)],
            handle=[*pair(bar(top, top + [0.26, 0.0, -0.02], radius=0.04)),
                    *pair(bar(top + [0.14, 0, 0], top + [0.28, 0.0, -0.02], radius=0.055))],
            wheel=[wheel(radius, 0.05, [0, radius, z]) for z in (-0.85 * long, long + 0.02)],
        )  # fmt: skip
    radius, base = 0.2 * size, share(rng, 0.5, 0.56)
    high = share(rng, 0.82, 0.92)
    back = [(-0.84, 0.34), (-0.8, 0.52), (-0.1, 0.56), (0.0, 0.24), (-0.2, 0.18), (-0.5, 0.2)]
    top = np.array([0, high, 0.36])
    guard = circle(0.25, 0.2, base + 0.02, 15, 165, 8)
    return named(
        body=[side(back, 0.36, bevel=0.3), block([0, 0.2, 0.12], [0.34, 0.07, 0.6], 0.4)],
        panel=[side([(0.3, 0.18), (0.37, 0.18), (0.46, 0.5), (0.38, high - 0.04), (0.28, high - 0.04), (0.36, 0.5)],
                    0.44, bevel=0.3)],
        seat=[limb([[0, 0.56, -0.68], [0, 0.58, -0.4], [0, 0.56, -0.14]], [[0.15, 0.07]] * 3, segments=10)],
        fork=[bar([0, radius, base + 0.02], top, radius=0.06)],
        bumper=[side(np.concatenate([guard, (guard - [0, 0.07])[::-1]]), 0.2)],
        handle=[bar(top - [0.34, -0.02, 0.06], top, top - [-0.34, -0.02, 0.06], radius=0.05)],
        lamp=[drum(0.1, 0.08, [0, high, 0.44], "z")],
        wheel=[wheel(radius, 0.09, [0, radius, z]) for z in (-base, base + 0.02)],
    )  # fmt: skip


def tricycle(rng: Rng, traits: Traits) -> Part:
    """Draw a child's tricycle: a large front wheel with pedals in a fork, two small ones behind, a saddle."""
    front = 0.3 * traits.draw(rng, "wheels", *WHEELS)
    rear, base, wide = 0.6 * front, share(rng, 0.42, 0.5), share(rng, 0.28, 0.34)
    head = np.array([0, 0.74, 0.3])
    hub, axle = np.array([0, front, base]), np.array([0, rear, -base])
    grip = head + [0.28, share(rng, 0.08, 0.16), -0.08]
    return named(
        wheel=[*(spoked(front, 0.06, hub) if rng.random() < 0.5 else [wheel(front, 0.07, hub)]),
               *wheels(rear, 0.06, wide, [-base])],
        frame=[bar(axle, [0, 0.42, -0.24], head - [0, 0.12, 0], radius=0.045),
               bar([-wide, rear, -base], [wide, rear, -base], radius=0.035)],
        fork=[*pair(bar(hub + [0.11, 0, 0], head + [0.09, -0.1, 0], head, radius=0.04))],
        handle=[*pair(bar(head, head + [0.08, 0.1, 0], grip, radius=(0.04, 0.04, 0.05)))],
        seat=[limb([[0, 0.5, -0.36], [0, 0.5, -0.08]], [[0.17, 0.06], [0.07, 0.05]], segments=12),
              bar([0, 0.34, -0.24], [0, 0.48, -0.24], radius=0.04)],
        pedal=[bar(hub + [0.1, 0, 0], hub + [0.14, -0.12, 0.05], hub + [0.26, -0.12, 0.05], radius=0.035),
               bar(hub - [0.1, 0, 0], hub - [0.14, -0.12, 0.05], hub - [0.26, -0.12, 0.05], radius=0.035)],
    )  # fmt: skip


def wheelchair(rng: Rng, traits: Traits) -> Part:
    """Draw a wheelchair: a seat and a back between two large spoked wheels, castors, footrests, push handles."""
    radius = 0.42 * traits.draw(rng, "wheels", *WHEELS)
    wide, level, back = share(rng, 0.28, 0.33), 0.5, share(rng, 0.5, 0.62)
    hub = np.array([wide + 0.08, radius, -0.16])
    return named(
        seat=[box([0, level, 0], [2 * wide, 0.09, 0.6], round_by=0.4, cells=3)],
        back=[box([0, level + back / 2, -0.3], [2 * wide, back, 0.08], round_by=0.4, cells=3)],
        arm=pair(bar([wide, level + 0.02, 0.2], [wide, level + 0.26, 0.2], [wide, level + 0.26, -0.28], radius=0.045)),
        handle=pair(bar([wide - 0.03, level, -0.32], [wide - 0.03, level + back + 0.06, -0.32],
                        [wide - 0.03, level + back + 0.08, -0.52], radius=0.04)),
        wheel=[*(each for x in (1, -1) for each in spoked(radius, 0.035, hub * [x, 1, 1], 4)),
               *wheels(0.11, 0.04, wide - 0.02, [0.32])],
        fork=pair(bar([wide - 0.02, 0.12, 0.32], [wide - 0.02, level, 0.26], radius=0.04)),
        leg=pair(bar([wide - 0.06, level, 0.26], [wide - 0.08, 0.14, 0.5], radius=0.04)),
        foot=pair(block([wide - 0.14, 0.13, 0.56], [0.2, 0.04, 0.22])),
        axle=[bar(hub, hub * [-1, 1, 1], radius=0.035)],
    )  # fmt: skip


def stroller(rng: Rng, traits: Traits) -> Part:
    """Draw a pram: a tub under a folding hood on crossed bars, four wheels, a long push bar."""
    radius = 0.2 * traits.draw(rng, "wheels", *WHEELS)
    long, wide, level = share(rng, 0.46, 0.54), share(rng, 0.24, 0.29), share(rng, 0.5, 0.58)
    tub = [
        (-long, level + 0.34),
        (long, level + 0.34),
        (0.85 * long, level + 0.06),
        (0.6 * long, level),
        (-0.6 * long, level),
    ]
    hood = circle(0.9 * long, level + 0.3, 0.5 * long, 0, share(rng, 115, 150), 8)
    hood = np.concatenate([[[0.5 * long, level + 0.3]], hood]) * [1, 1]
    push = np.array([wide, level + 0.62, -long - 0.36])
    return named(
        body=[side([*tub, (-0.85 * long, level + 0.06)], 2 * wide, bevel=0.2)],
        canopy=[side(hood, 2 * wide + 0.05, bevel=0.2)],
        handle=[*pair(bar([wide, level + 0.2, -0.4 * long], push, radius=0.035)),
                bar(push, push * [-1, 1, 1], radius=0.045)],
        frame=[*pair(bar([0.9 * wide, radius, 0.8 * long], [0.9 * wide, level + 0.1, -0.5 * long], radius=0.035)),
               *pair(bar([0.9 * wide, radius, -0.8 * long], [0.9 * wide, level + 0.1, 0.5 * long], radius=0.035)),
               *(bar([-wide, radius, z], [wide, radius, z], radius=0.03) for z in (-0.8 * long, 0.8 * long))],
        wheel=[each for z in (-0.8 * long, 0.8 * long) for x in (-1, 1)
               for each in spoked(radius, 0.035, [x * (wide + 0.06), radius, z], 3)],
    )  # fmt: skip


def skateboard(rng: Rng, traits: Traits) -> Part:
    """Draw a skateboard: a thin board with raised rounded ends, two axles with four small wheels."""
    radius = 0.085 * traits.draw(rng, "wheels", *WHEELS)
    long, wide, kick = share(rng, 0.9, 1.0), share(rng, 0.22, 0.27), share(rng, 0.08, 0.16)
    board = box([0, 0, 0], [2 * wide, 0.05, 2 * long], round_by=0.3, cells=10)
    x, y, z = board.verts.T
    past = np.clip(np.abs(z) - 0.66 * long, 0, None) / (0.34 * long)
    round_end = np.sqrt(np.clip(1 - 0.92 * past**2.5, 0, 1))
    board = board._replace(verts=np.column_stack([x * round_end, y + kick * past**1.3 + 0.17, z]))
    axles = (-0.56 * long, 0.56 * long)
    return named(
        body=[board],
        axle=[bar([-0.85 * wide, radius, at], [0.85 * wide, radius, at], radius=0.03) for at in axles]
        + [block([0, 0.12, at], [0.16, 0.12, 0.18]) for at in axles],
        wheel=[each for at in axles for each in pair(drum(radius, 0.055, [0.85 * wide, radius, at]))],
    )
