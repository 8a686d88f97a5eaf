import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.nouns.families import FAMILIES, Part, member
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from tests.cases import each_case

pytestmark = pytest.mark.training


def volumes(shape: Part) -> NDArray[np.float64]:
    """Signed volumes (F,) of the tetrahedra under faces."""
    a, b, c = (shape.verts[shape.faces[:, corner]] for corner in range(3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)


def volume(shape: Part) -> float:
    return float(volumes(shape).sum())


def border_edges(shape: Part) -> int:
    """Directed edges without their opposite: none on a closed, oriented surface."""
    directed = shape.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return len({*map(tuple, directed.tolist())} - {*map(tuple, directed[:, ::-1].tolist())})


@each_case("noun", FAMILIES)
def test_members_are_closed_outward_and_fill_the_unit_sphere(noun: str) -> None:
    for seed in range(3):
        shape = member(noun, (), np.random.default_rng(seed))
        assert np.isfinite(shape.verts).all()
        assert np.linalg.norm(shape.verts, axis=1).max() == pytest.approx(1.0)
        np.testing.assert_allclose(shape.verts.min(0) + shape.verts.max(0), 0, atol=1e-9)
        assert volume(shape) > 0
        assert len(np.unique(shape.faces)) == len(shape.verts)
    assert border_edges(shape) == 0


@each_case(
    "word, axes, at_least",
    [
        ("tall", (1, 0), 1.35),
        ("thin", (1, 0), 1.6),
        ("fat", (0, 1), 1.25),
        ("wide", (0, 2), 1.45),
        ("long", (2, 0), 1.45),
        ("flat", (0, 1), 1.5),
    ],
)
def test_attributes_of_the_whole_do_what_they_say(word: str, axes: tuple[int, int], at_least: float) -> None:
    """Ratios of extents do not depend on how the shape is scaled to fit."""
    for noun in ("vase", "dog", "lamp", "tree"):
        plain, shape = (member(noun, with_, np.random.default_rng(4)) for with_ in ((), (Attribute("whole", word),)))
        assert volume(shape) > 0
        grown = np.ptp(shape.verts, axis=0) / np.ptp(plain.verts, axis=0)
        assert grown[axes[0]] / grown[axes[1]] > at_least


@each_case("noun", [noun for noun, own in NOUNS.items() if own])
def test_both_degrees_of_a_part_change_the_shape(noun: str) -> None:
    for part in NOUNS[noun]:
        lesser, greater = (member(noun, (Attribute(part, d),), np.random.default_rng(3)) for d in PARTS[part])
        assert lesser.verts.shape == greater.verts.shape
        # Of a length of about 2: the ears of a tiger and the eyes of a lizard are small.
        assert np.linalg.norm(lesser.verts - greater.verts, axis=1).max() > 0.03
