"""Number the limbs by which poses differ: body, neck, head and tail, and each leg, arm and wing.

A limb has a code: sixteen times its place in `LIMBS`, and its number among those of its kind. What a limb carries, such
as a foot, counts as the limb; what hangs on the body, such as a hump, as none.
"""

from __future__ import annotations

import numpy as np

from meshdeform.nouns.labels import Index, LabelledMember
from meshdeform.nouns.poses import limbs
from meshdeform.vocabulary.solids import CARRIED_BY, PART_NAMES

__all__ = ["LIMBS", "LIMB_OF_PART", "NO_LIMB", "SEVERAL", "kind_of", "limb_codes", "limb_of"]

LIMBS = ("body", "neck", "head", "tail", "leg", "arm", "wing")
NO_LIMB = 255
SEVERAL = ("leg", "arm", "wing")
"""The kinds of limbs of which there is one on each side."""
_OF_A_KIND = 16


def _limb_of_part(part: str) -> int:
    """Return the place in `LIMBS` of the limb that carries a part, or -1."""
    name: str | None = part
    while name is not None and name not in LIMBS:
        name = CARRIED_BY.get(name)
    return -1 if name is None or (name == "body" and part != "body") else LIMBS.index(name)


LIMB_OF_PART = np.array([_limb_of_part(part) for part in PART_NAMES])
"""The place in `LIMBS` of each part in `PART_NAMES`, or -1."""


def limb_of(kind: int, number: int) -> int:
    """Return the code of a limb; the seventeenth of a kind counts with the first."""
    return _OF_A_KIND * kind + number % _OF_A_KIND


def kind_of(codes: Index) -> Index:
    """Return the place in `LIMBS` of limbs with codes (N,)."""
    return codes // _OF_A_KIND


def limb_codes(member: LabelledMember) -> Index:
    """Return the limb (F,) int64 of each face of a member, or `NO_LIMB`."""
    kinds = LIMB_OF_PART[member.labels]
    codes = np.where(kinds < 0, NO_LIMB, limb_of(1, 0) * kinds)
    for part in SEVERAL:
        if part in member.parts:
            for number, rows in enumerate(limbs(member, part)):
                inside = np.zeros(len(member.verts), bool)
                inside[rows] = True
                codes[inside[member.faces[:, 0]]] = limb_of(LIMBS.index(part), number)
    return np.asarray(codes, np.int64)
