"""Move the limbs of labelled members: walking, sitting, lying, a turned head, wings, arms.

A pose turns pieces about the places where they hang; faces, labels and all parts that it does not move stay. With the
turn R(a) about the axis x, a point at y, z from its pivot goes to (y cos a - z sin a, y sin a + z cos a).

A leg of length l whose hip is h above the ground reaches it at the angle acos(h / l) from straight down.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.nouns.families import KINDS
from meshdeform.nouns.labels import Flags, Floats, Index, LabelledMember
from meshdeform.vocabulary.nouns import TABLE

__all__ = ["POSES", "head_and_neck", "hind_and_front", "limbs", "posed", "throat", "top_of", "turn"]

_UPRIGHT = (
    "standing-rabbit upright-bear upright-cat upright-cow upright-deer upright-dog upright-elephant upright-fox"
    " upright-horse upright-lion upright-pig upright-wolf"
)
_OF_FORMS: dict[str, str] = {
    "walking": "quadruped two-legged-dragon standing-bear great-cat standing-cat",
    "sitting": "quadruped standing-bear great-cat",
    "lying": "quadruped standing-bear great-cat standing-cat",
    "turned": "quadruped standing-bear great-cat standing-cat standing-bird",
    "T": _UPRIGHT,
    "A": "",
    "hanging": "",
    "swimming": "",
    "spread": "two-legged-dragon standing-bird",
    "folded": "two-legged-dragon",
}
"""The forms of `forms` that take each pose; the traits of a noun tell which it takes."""

_UNFIT = {"round-penguin": "swimming"}
"""A pose of its noun that a kind does not take: its head is half of its body."""

_TOUCHING = 0.01
_TOP = 0.1
"""Share of a limb's height or reach, from where it hangs, that tells where it hangs."""
_ON_THE_FLANK = 1.5
"""Ratio of a wing's length along the body to its width across it from which it lies on the flank."""
_OFF_THE_MIDDLE = 0.1
"""Least distance of a wing on the flank from the middle, as a share of its greatest."""
POSES: dict[str, tuple[str, ...]] = {
    form: tuple(pose for pose in _OF_FORMS if pose in row.traits and pose != _UNFIT.get(form))
    for noun, row in TABLE.items()
    for form in (noun, *KINDS.get(noun, ()))
} | {
    form: tuple(pose for pose, forms in _OF_FORMS.items() if form in forms.split())
    for form in sorted({form for forms in _OF_FORMS.values() for form in forms.split()})
}
"""The poses of each noun, of its kinds, and of each form of `forms`, besides the one in which it is drawn."""


def limbs(member: LabelledMember, part: str) -> list[Index]:
    """Return the vertices of each piece of a part, with all that moves with it: of each leg with its foot."""
    moving = member.carried(part)
    numbers = np.unique(member.solids[moving])
    low, high = (
        np.array([bound(member.verts[member.solids == k], axis=0) for k in numbers]) for bound in (np.min, np.max)
    )
    side = np.sign((low + high)[:, 0].round(3))
    touch = (low[:, None] <= high[None] + _TOUCHING).all(2) & (low[None] <= high[:, None] + _TOUCHING).all(2)
    _, owner = csgraph.connected_components(sparse.csr_matrix(touch & (side[:, None] == side[None])), directed=False)
    owner_of_solid = np.full(int(member.solids.max()) + 1, -1)
    owner_of_solid[numbers] = owner
    owners = owner_of_solid[member.solids]
    return [np.flatnonzero(owners == k) for k in range(owner.max() + 1)]


def posed(member: LabelledMember, pose: str, rng: np.random.Generator) -> LabelledMember:
    """Return the member in a pose, whose angles are drawn.

    Raises
    ------
    KeyError
        There is no such pose.
    """
    return member.moved(_MOVES[pose](member, rng))


def turn(verts: Floats, rows: Index | Flags, pivot: Floats, degrees: float, axis: str) -> None:
    """Turn some vertices in place about an axis through a place, counter-clockwise seen from the axis's tip."""
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    angle = np.radians(degrees)
    one, two = verts[rows, first] - pivot[first], verts[rows, second] - pivot[second]
    verts[rows, first] = pivot[first] + np.cos(angle) * one - np.sin(angle) * two
    verts[rows, second] = pivot[second] + np.sin(angle) * one + np.cos(angle) * two


def top_of(verts: Floats, rows: Index) -> Floats:
    """Return where (3,) a limb hangs that hangs from its top."""
    own = verts[rows]
    return np.asarray(own[own[:, 1] >= own[:, 1].max() - _TOP * np.ptp(own[:, 1])].mean(0))


def _inner_end(verts: Floats, rows: Index) -> Floats:
    """Return where (3,) a limb hangs that hangs on the side of the body."""
    own, reach = verts[rows], np.abs(verts[rows, 0])
    return np.asarray(own[reach <= reach.min() + _TOP * np.ptp(reach)].mean(0))


def _outer_end(verts: Floats, rows: Index) -> Floats:
    own, reach = verts[rows], np.abs(verts[rows, 0])
    return np.asarray(own[reach >= reach.max() - _TOP * np.ptp(reach)].mean(0))


def head_and_neck(member: LabelledMember) -> Flags:
    """Return the vertices (V,) of neck and head, and of what they carry."""
    return member.carried("neck" if "neck" in member.parts else "head")


def throat(member: LabelledMember, verts: Floats) -> Floats:
    """Return where (3,) head and neck hang on the body."""
    moving = head_and_neck(member)
    rest = verts[~moving].mean(0)
    own = verts[moving]
    away = np.linalg.norm(own - rest, axis=1)
    return np.asarray(own[away <= np.percentile(away, 8)].mean(0))


def hind_and_front(member: LabelledMember, verts: Floats) -> tuple[list[Index], list[Index]]:
    """Return the vertices of each hind and of each front leg."""
    legs = limbs(member, "leg")
    middle = np.mean([verts[rows, 2].mean() for rows in legs])
    hind = [rows for rows in legs if verts[rows, 2].mean() < middle]
    return hind, [rows for rows in legs if verts[rows, 2].mean() >= middle]


def _walking(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Swing the legs about their hips, the arms against them."""
    verts = member.verts.copy()
    legs = limbs(member, "leg")
    step = rng.uniform(12, 35)
    for number, rows in enumerate(legs):
        degrees = step * (-1) ** number if len(legs) == 2 else rng.normal(0, 32)
        turn(verts, rows, top_of(verts, rows), degrees, "x")
    if "arm" in member.parts:
        for number, rows in enumerate(limbs(member, "arm")):
            turn(verts, rows, _inner_end(verts, rows), -0.8 * step * (-1) ** number, "x")
    return verts


def _turned(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Nod head and neck about the throat, and turn the head about the neck's axis."""
    verts = member.verts.copy()
    nod = rng.normal(0, 9 if "neck" not in member.parts or "leg" not in member.parts else 18)
    turn(verts, head_and_neck(member), throat(member, verts), nod, "x")
    head = member.carried("head")
    middle = verts[member.solids_named("head").min() == member.solids].mean(0)
    turn(verts, head, middle, rng.normal(0, 22), "y")
    return verts


def _sitting(member: LabelledMember, rng: np.random.Generator) -> Floats:
    return _sitting_upright(member, rng) if len(limbs(member, "leg")) == 2 else _sitting_on_haunches(member, rng)


def _sitting_upright(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Turn the thighs forward about the hips, and the shins down about the knees."""
    verts = member.verts.copy()
    thigh = rng.uniform(75, 90)
    for rows in limbs(member, "leg"):
        hip = top_of(verts, rows)
        below = rows[verts[rows, 1] < (hip[1] + verts[rows, 1].min()) / 2]
        turn(verts, rows, hip, -thigh, "x")
        joint = rows[~np.isin(rows, below)]
        knee = verts[joint][np.argmax(verts[joint, 2])] * [0, 1, 1] + [verts[rows, 0].mean(), 0, 0]
        turn(verts, below, knee, rng.uniform(0.85, 1.0) * thigh, "x")
    return verts


def _sitting_on_haunches(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Raise the front about the hips, keep the head level and the front legs upright, fold the hind legs."""
    verts = member.verts.copy()
    hind, front = hind_and_front(member, verts)
    hip = np.mean([top_of(verts, rows) for rows in hind], axis=0)
    rise = rng.uniform(35, 55)
    shoulders = [top_of(verts, rows) for rows in front]
    upper = np.ones(len(verts), bool)
    upper[np.concatenate(hind)] = False
    turn(verts, upper, hip, -rise, "x")
    turn(verts, head_and_neck(member), throat(member, verts), 0.85 * rise, "x")
    ground = float(verts[np.isin(member.solids, member.solids_named("body")), 1].min())
    for rows in limbs(member, "tail") if "tail" in member.parts else []:
        root = verts[rows][np.argmin(np.linalg.norm(verts[rows] - hip, axis=1))]
        turn(verts, rows, root, 0.9 * rise, "x")
    for rows, shoulder in zip(front, shoulders, strict=True):
        pivot = shoulder[None].copy()
        turn(pivot, np.array([0]), hip, -rise, "x")
        turn(verts, rows, pivot[0], rise, "x")
        length = float(pivot[0, 1] - verts[rows, 1].min())
        verts[rows, 1] = pivot[0, 1] + (verts[rows, 1] - pivot[0, 1]) * (pivot[0, 1] - ground) / max(length, 1e-9)
    for rows in hind:
        _lay(verts, rows, ground)
    return verts


def _lying(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Fold the legs forward beside a body that lies on the ground; a hanging tail lies behind it."""
    verts = member.verts.copy()
    body = np.isin(member.solids, member.solids_named("body"))
    ground = float(verts[body, 1].min())
    for rows in limbs(member, "leg"):
        _lay(verts, rows, ground + rng.uniform(0, 0.02))
    for rows in limbs(member, "tail") if "tail" in member.parts else []:
        if verts[rows, 1].min() < ground:
            _lay(verts, rows, ground, forward=-1)
    return verts


def _lay(verts: Floats, rows: Index, ground: float, *, forward: int = 1) -> None:
    """Turn a limb forward, or back (-1), about where it hangs until its end is on the ground, in place."""
    hip = top_of(verts, rows)
    length = max(float(hip[1] - verts[rows, 1].min()), 1e-9)
    degrees = float(np.degrees(np.arccos(np.clip((hip[1] - ground) / length, -1, 1))))
    turn(verts, rows, hip, -forward * degrees, "x")


def _swimming(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Lay an upright bird on its belly, its feet behind, its head raised so that it looks ahead."""
    verts = member.verts.copy()
    lean = rng.uniform(70, 90)
    turn(verts, np.arange(len(verts)), verts.mean(0), lean, "x")
    turn(verts, head_and_neck(member), throat(member, verts), -0.85 * lean, "x")
    for number in member.solids_named("foot"):
        rows = np.flatnonzero(member.solids == number)
        turn(verts, rows, top_of(verts, rows), lean, "x")
    return verts


def _arms(low_deg: float, high_deg: float) -> Callable[[LabelledMember, np.random.Generator], Floats]:
    def move(member: LabelledMember, rng: np.random.Generator) -> Floats:
        """Turn the arms about the shoulders to an angle from straight down."""
        verts, angle = member.verts.copy(), rng.uniform(low_deg, high_deg)
        for rows in limbs(member, "arm"):
            shoulder = _inner_end(verts, rows)
            hand = verts[rows][np.argsort(np.linalg.norm(verts[rows] - shoulder, axis=1))[-len(rows) // 8 :]].mean(0)
            side = np.sign(hand[0])
            now = np.degrees(np.arctan2(side * (hand[0] - shoulder[0]), shoulder[1] - hand[1]))
            turn(verts, rows, shoulder, side * (angle - now), "z")
        return verts

    return move


def _raise_wing(verts: Floats, rows: Index, elevation_deg: float) -> Floats:
    """Turn a wing about its root to an elevation, in place; return the root (3,)."""
    root, tip = _inner_end(verts, rows), _outer_end(verts, rows)
    side = np.sign(tip[0])
    now = np.degrees(np.arctan2(tip[1] - root[1], side * (tip[0] - root[0])))
    turn(verts, rows, root, side * (elevation_deg - now), "z")
    return root


def _open_wing(verts: Floats, rows: Index, elevation_deg: float) -> None:
    """Turn a wing that lies on the flank, in place, until it stands off: its front end is its root."""
    own = verts[rows]
    root = own[own[:, 2] >= own[:, 2].max() - _TOP * np.ptp(own[:, 2])].mean(0)
    turn(verts, rows, root, 90.0, "x")  # its lower edge behind, its end up
    turn(verts, rows, root, float(np.sign(root[0])) * (elevation_deg - 90.0), "z")


def _is_on_the_flank(wing: Floats) -> bool:
    """Return whether a wing (W, 3) lies along the body, and is not raised steeply from the middle of the back."""
    reach = np.abs(wing[:, 0])
    return bool(np.ptp(wing[:, 2]) > _ON_THE_FLANK * np.ptp(reach) and reach.min() > _OFF_THE_MIDDLE * reach.max())


def _spread(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Hold the wings level; an upright animal's, out to its sides."""
    verts, elevation = member.verts.copy(), rng.uniform(-8, 12)
    for rows in limbs(member, "wing"):
        if member.noun == "butterfly":
            side = np.sign(verts[rows, 0].mean())
            root, tip = _inner_end(verts, rows), _outer_end(verts, rows)
            sweep = np.degrees(np.arctan2(tip[2] - root[2], side * (tip[0] - root[0])))
            turn(verts, rows, root, side * (sweep + elevation), "y")
        elif _is_on_the_flank(verts[rows]):
            _open_wing(verts, rows, elevation)
        else:
            _raise_wing(verts, rows, elevation)
    return verts


def _folded(member: LabelledMember, rng: np.random.Generator) -> Floats:
    """Lay the wings on the flanks, their tips behind."""
    verts, back = member.verts.copy(), rng.uniform(72, 92)
    body = verts[np.isin(member.solids, member.solids_named("body"))]
    for rows in limbs(member, "wing"):
        root = _raise_wing(verts, rows, -86.0)
        turn(verts, rows, root, back, "x")
        verts[rows, 0] += np.sign(root[0]) * 0.9 * float(np.abs(body[:, 0]).max()) - root[0]
    return verts


_MOVES: dict[str, Callable[[LabelledMember, np.random.Generator], Floats]] = {
    "walking": _walking,
    "turned": _turned,
    "sitting": _sitting,
    "lying": _lying,
    "swimming": _swimming,
    "T": _arms(82, 95),
    "A": _arms(35, 55),
    "hanging": _arms(4, 14),
    "spread": _spread,
    "folded": _folded,
}
