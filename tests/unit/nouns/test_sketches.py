"""What the words of a sketch mean, and that kinds are sound; sketches of nouns are tested with all families."""

import numpy as np
import pytest

from meshdeform.nouns.families import FAMILIES, Part, Traits
from meshdeform.nouns.families.sketches import SKETCHED_KINDS, read
from meshdeform.nouns.forms import drawn
from meshdeform.nouns.labels import solids_of
from meshdeform.nouns.solids import parts_of
from meshdeform.priors.builtin.grammar import Attribute
from tests.cases import each_case
from tests.unit.nouns.test_families import border_edges, volume

BLOCK = """
# A block whose height is twice its width; two feet, then a row of three of them.
block: w 2 2, a=handle 1 1
  body box 0 w 0, w 2w .5w, .1; foot drum .4w 0 0, .1 .05 | pair; handle rod 0 2w 0 .1,
    0 2w+a 0 .1; leg ball 0 0 1, .1 | row 3 0 0 .5
block/cube: w 1 1
  body box 0 0 0, w w w
"""


def test_a_sketch_is_drawn_as_its_words_say() -> None:
    sketches = read(BLOCK)
    assert list(sketches) == ["block", "block/cube"]
    block = sketches["block"](np.random.default_rng(0), Traits())
    assert np.ptp(block.verts, axis=0)[0] == pytest.approx(2.0)
    assert block.verts[:, 1].max() == pytest.approx(2 * 2 + 1 + 0.1)  # the handle's end is round
    assert block.verts[:, 2].max() == pytest.approx(2.1, abs=0.01)  # the third leg stands at 2
    long = sketches["block"](np.random.default_rng(0), Traits([Attribute("handle", "long")]))
    assert long.verts[:, 1].max() > 2 * 2 + 1.7
    np.testing.assert_allclose(np.ptp(sketches["block/cube"](np.random.default_rng(0), Traits()).verts, axis=0), 1.0)


@each_case("noun, kind", SKETCHED_KINDS)
def test_a_kind_is_closed_and_has_the_parts_of_its_noun(noun: str, kind: str) -> None:
    assert noun in FAMILIES
    for seed in range(2):
        member = drawn(kind, (), np.random.default_rng(seed))
        assert set(member.parts) <= parts_of(noun)
        assert 200 < len(member.faces) < 4500
        shape = Part(member.verts, member.faces)
        of_solid = solids_of(shape)[shape.faces[:, 0]]
        assert all(volume(Part(shape.verts, shape.faces[of_solid == one])) > 0 for one in np.unique(of_solid))
    assert border_edges(shape) == 0
