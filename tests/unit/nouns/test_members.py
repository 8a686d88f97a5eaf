"""Members stay what they were: weights, judges and readings were made with them."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from meshdeform.nouns.families import FAMILIES, member
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from tests.unit.test_imports import among, loaded_by

EXPECTED = Path(__file__).with_name("members.txt")
_BLOCKED = "import sys\nfor name in ('torch', 'numba', 'diffusers', 'trimesh'): sys.modules[name] = None\n"


def _digest(noun: str) -> str:
    """A digest of a plain member and one with each degree of its parts; places to 1e-6: sines differ by processor."""
    digest = hashlib.sha256()
    for seed in range(3):
        attributes = [Attribute(part, PARTS[part][seed - 1]) for part in NOUNS[noun]] if seed else []
        shape = member(noun, attributes, np.random.default_rng(seed))
        digest.update(shape.faces.tobytes())
        digest.update((shape.verts.round(6) + 0.0).tobytes())
    return digest.hexdigest()[:8]


def test_every_noun_has_a_family_whose_members_are_what_they_were() -> None:
    expected = dict(line.split() for line in EXPECTED.read_text().splitlines())
    assert FAMILIES.keys() == NOUNS.keys() == expected.keys()
    assert {noun: _digest(noun) for noun in FAMILIES} == expected


def test_the_shapes_of_nouns_load_without_torch() -> None:
    loaded = loaded_by("meshdeform.nouns", "meshdeform.reading", before=_BLOCKED)
    assert among(loaded, ["fastapi", "PIL"]) == {}
