"""What an attribute does to a member is done to an asset: to the member itself exactly what it does to the member."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshdeform.exemplar.shapes import Frame, Shape, Wish
from meshdeform.exemplar.twins import twin
from meshdeform.nouns.labels import Floats, LabelledMember, code
from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.reading.banks import candidate_member, twin_member
from meshdeform.reading.result import NO_PART
from tests.cases import each_case
from tests.unit.exemplar.test_choosing import asset

pytestmark = pytest.mark.usefixtures("few_members")
NUMBER = 6


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("banks")


def of(noun: str) -> LabelledMember:
    return candidate_member(noun, NUMBER, ())


def expected(noun: str, attributes: tuple[Attribute, ...], still: str) -> Floats:
    """The other twin in the asset's frame, with a part where the asset has it, on the asset's ground."""
    plain, other = of(noun), twin_member(noun, NUMBER, attributes)
    frame = Frame.around(plain.verts, plain.faces, np.eye(3))
    rows = np.unique(plain.faces[plain.labels == code(still)])
    scale = np.linalg.norm(np.ptp(plain.verts[rows], axis=0)) / np.linalg.norm(np.ptp(other.verts[rows], axis=0))
    placed = frame.enter((other.verts - other.verts[rows].mean(0)) * scale + plain.verts[rows].mean(0))
    return np.asarray(placed + [0, frame.enter(plain.verts)[:, 1].min() - placed[:, 1].min(), 0])


@each_case(
    "noun, attributes, still",
    [
        ("elephant", (Attribute("ears", "big"),), "body"),
        ("teapot", (Attribute("spout", "long"),), "body"),
        ("giraffe", (Attribute("neck", "short"), Attribute("legs", "long")), "body"),
        ("table", (Attribute("legs", "long"),), "top"),
        ("lamp", (Attribute("shade", "big"),), "base"),
    ],
)
def test_a_member_becomes_its_twin(noun: str, attributes: tuple[Attribute, ...], still: str, cache: Path) -> None:
    source = asset(of(noun))
    verts = twin(source, Wish(noun, attributes), cache=cache)
    goal = expected(noun, attributes, still)
    assert verts is not None
    moved = np.linalg.norm(goal - source.verts, axis=1)
    left = np.linalg.norm(goal - verts, axis=1)
    assert moved.max() > 0.05
    assert left.mean() < 0.12 * moved[moved > 0.01].mean()
    assert verts[:, 1].min() == pytest.approx(source.verts[:, 1].min())
    again = twin(source, Wish(noun, attributes), cache=cache)
    assert again is not None
    assert np.array_equal(again, verts)


@each_case("attributes", [(), (Attribute("whole", "tall"),)])
def test_without_attributes_of_parts_nothing_moves(attributes: tuple[Attribute, ...], cache: Path) -> None:
    source = asset(of("dog"))
    verts = twin(source, Wish("dog", attributes), cache=cache)
    assert verts is not None
    assert np.array_equal(verts, source.verts)


def test_other_nouns_and_parts_that_the_asset_has_not_are_none_of_its_business(cache: Path) -> None:
    big_ears = (Attribute("ears", "big"),)
    dog = asset(of("dog"))
    assert twin(dog, Wish("elephant", big_ears), cache=cache) is None
    deaf = Shape("dog", dog.verts, dog.faces, np.where(dog.labels == code("ear"), code("head"), dog.labels))
    assert twin(deaf, Wish("dog", big_ears), cache=cache) is None


def test_what_hangs_on_a_part_goes_with_it_and_all_else_stays(cache: Path) -> None:
    dog = asset(of("dog"))
    head = np.unique(dog.faces[dog.labels == code("head")])
    top = dog.verts[head][np.argmax(dog.verts[head, 1])]
    hat = top + 0.03 * np.array([[-1, 0, -1], [1, 0, -1], [0, 0, 1], [0, 1.5, 0]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]) + len(dog.verts)
    labels = np.append(dog.labels, [NO_PART] * 4)
    source = Shape("dog", np.concatenate([dog.verts, hat]), np.concatenate([dog.faces, faces]), labels)
    verts = twin(source, Wish("dog", (Attribute("legs", "long"),)), cache=cache)
    assert verts is not None
    step = verts - source.verts
    lift = step[head].mean(0)
    assert lift[1] > 0.05
    np.testing.assert_allclose(step[-4:], np.tile(lift, (4, 1)), atol=1e-3)
    for part in ("head", "tail", "nose"):
        rows = np.unique(dog.faces[dog.labels == code(part)])
        np.testing.assert_allclose(step[rows], np.tile(lift, (len(rows), 1)), atol=0.02)


def test_mirror_images_move_alike(cache: Path) -> None:
    source = asset(of("elephant"))
    verts = twin(source, Wish("elephant", (Attribute("ears", "big"),)), cache=cache)
    assert verts is not None
    left, right = (np.flatnonzero(side * source.verts[:, 0] > 0.2) for side in (1, -1))
    assert len(left)
    order = [np.lexsort(source.verts[rows].round(7).T * [[side], [1], [1]]) for rows, side in ((left, 1), (right, -1))]
    one, two = (verts[rows[k]] for rows, k in zip((left, right), order, strict=True))
    np.testing.assert_allclose(one * [-1, 1, 1], two, atol=0.005)
