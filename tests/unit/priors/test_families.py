import numpy as np
import pytest

from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.priors.builtin.vocabulary import ADJECTIVES, NOUNS, PARTS
from tests.cases import each_case
from training.prior.families import FAMILIES, Part, member

pytestmark = pytest.mark.training


def _volume(shape: Part) -> float:
    a, b, c = (shape.verts[shape.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _border_edges(shape: Part) -> int:
    """Directed edges without their opposite: none on a closed, oriented surface."""
    directed = {(int(a), int(b)) for face in shape.faces for a, b in zip(face, np.roll(face, -1), strict=True)}
    return sum((b, a) not in directed for a, b in directed)


@each_case("noun", FAMILIES)
def test_members_are_closed_outward_and_fill_the_unit_sphere(noun: str) -> None:
    for seed in range(3):
        shape = member(noun, (), np.random.default_rng(seed))
        assert np.isfinite(shape.verts).all()
        assert np.linalg.norm(shape.verts, axis=1).max() == pytest.approx(1.0)
        np.testing.assert_allclose(shape.verts.min(0) + shape.verts.max(0), 0, atol=1e-9)
        assert _volume(shape) > 0
        assert len(np.unique(shape.faces)) == len(shape.verts)
    assert _border_edges(shape) == 0


@each_case("noun", ["vase", "dog", "lamp", "tree"])
@each_case("word", ADJECTIVES)
def test_attributes_of_the_whole_do_what_they_say(noun: str, word: str) -> None:
    plain = member(noun, (), np.random.default_rng(4))
    shape = member(noun, (Attribute("whole", word),), np.random.default_rng(4))
    assert _volume(shape) > 0
    x, y, z = np.ptp(shape.verts, axis=0) / np.ptp(plain.verts, axis=0)
    # Ratios of extents do not depend on how the shape is scaled to fit.
    match word:
        case "tall":
            assert y / x > 1.35
            assert y / z > 1.35
        case "short" | "flat":
            assert y / x < 0.65
        case "thin":
            assert x / y < 0.62
        case "fat":
            assert x / y > 1.25
        case "wide":
            assert x / y > 1.45
            assert x / z > 1.45
        case "long":
            assert z / x > 1.45
        case "leaning":
            assert _slope(shape) - _slope(plain) > 0.3
        case "bent":
            assert _slope(shape) - _slope(plain) > 0.3
        case "tapered":
            assert _spread(shape, top=True) / _spread(shape, top=False) < 0.8 * (
                _spread(plain, top=True) / _spread(plain, top=False)
            )
        case "pinched":
            assert _waist(shape) < 0.7 * _waist(plain)
        case "twisted":
            assert np.abs(shape.verts - plain.verts).max() > 0.15


def _slope(shape: Part) -> float:
    """How fast the shape goes sideways as it rises: least squares of x on y."""
    return float(np.polyfit(shape.verts[:, 1], shape.verts[:, 0], 1)[0])


def _spread(shape: Part, *, top: bool) -> float:
    """Largest distance from the axis within the top or the bottom quarter."""
    height = (shape.verts[:, 1] - shape.verts[:, 1].min()) / np.ptp(shape.verts[:, 1])
    quarter = shape.verts[height > 0.75] if top else shape.verts[height < 0.25]
    return float(np.linalg.norm(quarter[:, [0, 2]], axis=1).max())


def _waist(shape: Part) -> float:
    """Girth at half height over that at the top and the bottom: largest distances from the axis."""
    # Points along the edges: not every shape has a vertex at half height.
    start, end = shape.verts[shape.faces], shape.verts[np.roll(shape.faces, -1, axis=1)]
    points = np.concatenate([start + t * (end - start) for t in np.linspace(0, 1, 20)]).reshape(-1, 3)
    height = (points[:, 1] - points[:, 1].min()) / np.ptp(points[:, 1])
    away = np.linalg.norm(points[:, [0, 2]], axis=1)
    return float(away[np.abs(height - 0.5) < 0.12].max() / away[np.abs(height - 0.5) > 0.35].max())


@each_case("noun", [noun for noun, own in NOUNS.items() if own])
def test_both_degrees_of_a_part_change_the_shape(noun: str) -> None:
    for part in NOUNS[noun]:
        low, high = PARTS[part]
        lesser, greater = (member(noun, (Attribute(part, d),), np.random.default_rng(3)) for d in (low, high))
        plain = member(noun, (), np.random.default_rng(3))
        for sized in (lesser, greater):
            assert sized.verts.shape == plain.verts.shape
            assert np.linalg.norm(sized.verts - plain.verts, axis=1).max() > 0.05
        assert np.linalg.norm(lesser.verts - greater.verts, axis=1).max() > 0.1
