"""Read members of the families, whose parts are known, and print which share of their area is right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshdeform.nouns.deformed import Part
from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.labels import LabelledMember, labelled_member
from meshdeform.reading import read_asset
from meshdeform.reading.banks import candidate_member

_SEED = 4321
"""Of a member that is none of those that are fitted."""


def right_share(member: LabelledMember, noun: str) -> float:
    """Return the share of the area of a member that is read right, noun and front known."""
    reading = read_asset(Part(member.verts, member.faces), {noun: 1.0}, front_azimuth_deg=0.0)
    a, b, c = member.verts[member.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(areas[reading.labels == member.labels].sum() / areas.sum())


def print_members(nouns: Sequence[str]) -> None:
    """Read two members of each noun: one of those that are drawn for a reading, and another; by default of all."""
    shares = []
    for noun in nouns or list(FAMILIES):
        known, other = candidate_member(noun, 0), labelled_member(noun, (), np.random.default_rng(_SEED))
        shares.append((right_share(known, noun), right_share(other, noun)))
        print(f"{noun:12} {shares[-1][0]:7.1%} {shares[-1][1]:7.1%}", flush=True)
    table = np.array(shares)
    print(f"mean {table.mean(0)}, least {table.min(0)}, at least 98 %: {(table >= 0.98).sum(0)} of {len(shares)}")
