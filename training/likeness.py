"""Describe members of all nouns, by which assets are told: ``python -m training.likeness [OUT]``.

It draws `PER_NOUN` members of each noun, of forms that no other noun has as well, and `PER_KIND` of each further kind,
and writes `meshdeform/reading/members.npz`. As long as the families stay, the file is the same. Run
it when a noun or a kind is new, or is drawn otherwise.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.forms import drawn, other_kinds
from meshdeform.nouns.labels import Floats, LabelledMember
from meshdeform.reading.banks import MEMBERS, SAMPLES, candidate_member, is_general
from meshdeform.reading.likeness import KEPT, MEMBERS_FILE, described
from meshdeform.reading.samples import spread

PER_NOUN, PER_KIND = 12, 4
_STEPS = 127


def members_of(noun: str) -> list[LabelledMember]:
    """Return the members of a noun that are described: some of those by which it is read, and of each other kind."""
    own = islice((number for number in range(MEMBERS) if not is_general(noun, number)), PER_NOUN)
    members = [candidate_member(noun, number) for number in own]
    kinds = other_kinds(noun)
    return members + [drawn(kind, (), np.random.default_rng([k, 74])) for kind in kinds for k in range(PER_KIND)]


def described_member(member: LabelledMember) -> Floats:
    """Return the description (D,) of a member."""
    samples = spread(member.verts, member.faces, SAMPLES, 2)
    return described(samples.positions, samples.normals, member.verts.min(0), member.verts.max(0))


def reduced(each: Mapping[str, Floats]) -> dict[str, Any]:
    """Return what `Likeness.read` reads, of the descriptions (M, D) of the members of each noun."""
    together, counts = np.concatenate(list(each.values())), np.array([len(own) for own in each.values()])
    mean = together.mean(0)
    _, components = np.linalg.eigh(np.cov((together - mean).T))
    basis = components[:, ::-1][:, :KEPT]
    scores = (together - mean) @ basis
    noun_of = np.repeat(np.arange(len(counts)), counts)
    centres = np.stack([np.bincount(noun_of, column) / counts for column in scores.T], 1)
    within = np.sqrt(np.square(scores - centres[noun_of]).mean(0))
    weights = np.sqrt(within[0] / within)
    scores *= weights
    steps = np.abs(scores).max(0) / _STEPS
    return {
        "nouns": np.array(list(each)),
        "counts": counts.astype(np.uint16),
        "mean": mean.astype(np.float32),
        "basis": (basis * weights).astype(np.float16),
        "steps": steps.astype(np.float32),
        "members": np.rint(scores / steps).astype(np.int8),
    }


def main() -> None:
    """Draw, describe, reduce and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", default=MEMBERS_FILE)
    out = parser.parse_args().out
    each = {noun: np.stack([described_member(member) for member in members_of(noun)]) for noun in FAMILIES}
    with out.open("wb") as file:
        np.savez_compressed(file, **reduced(each))


if __name__ == "__main__":
    main()
