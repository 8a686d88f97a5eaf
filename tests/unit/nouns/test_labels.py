"""Every face of every member has a part, and a part that a prompt names is what changes with its degree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.nouns.families import FAMILIES, Traits, member
from meshdeform.nouns.labels import LabelledMember, code, labelled, labelled_member
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from meshdeform.vocabulary.solids import CARRIED_BY, PART_NAMES, layout, parent_of, part_label, parts_of
from tests.cases import each_case

NEARLY_ALIKE = {("boat", "sail"): "mast", ("tree", "crown"): "trunk"}
"""Parts with which another grows nearly as much."""


def _edge_lengths(shape: LabelledMember) -> NDArray[np.float64]:
    corners = shape.verts[shape.faces]
    return np.maximum(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2), 1e-9)


def _growth(lesser: LabelledMember, greater: LabelledMember) -> NDArray[np.float64]:
    """By which factor, as a logarithm, each face (F,) of the greater one differs in its edges, or its solid in size."""
    if np.array_equal(lesser.faces, greater.faces):
        return np.abs(np.log(_edge_lengths(greater) / _edge_lengths(lesser))).max(1)
    # A box numbers its corners by their places, which change.
    sizes = [
        np.array([np.ptp(one.verts[one.solids == k], axis=0) for k in range(int(one.solids.max()) + 1)])
        for one in (lesser, greater)
    ]
    return np.abs(np.log(sizes[1] / sizes[0])).max(1)[greater.solid_of_face]


@each_case("noun", FAMILIES)
def test_every_face_has_a_part_of_the_noun_and_labels_change_nothing(noun: str) -> None:
    shape = labelled_member(noun, (), np.random.default_rng(7))
    plain = member(noun, (), np.random.default_rng(7))
    assert np.array_equal(shape.verts, plain.verts)
    assert np.array_equal(shape.faces, plain.faces)
    assert shape.labels.shape == (len(shape.faces),)
    assert all(name in parts_of(noun) for name in shape.parts)
    assert np.unique(shape.solids).tolist() == list(range(int(shape.solids.max()) + 1))


@each_case("noun, part", [(noun, part) for noun, parts in NOUNS.items() for part in parts])
def test_a_part_that_a_prompt_names_is_what_changes_most_with_its_degree(noun: str, part: str) -> None:
    lesser, greater = (
        labelled(noun, FAMILIES[noun](np.random.default_rng(3), Traits([Attribute(part, degree)])))
        for degree in PARTS[part]
    )
    growth, label = _growth(lesser, greater), part_label(part)
    assert label in greater.parts
    own = growth[greater.labels == code(label)].max()
    assert own > 0.1
    carried = {PART_NAMES[k] for k in np.unique(greater.labels[greater.carried(label)[greater.faces].all(1)])}
    # Where the lesser neck ends in the head, its faces that grow may be the head's.
    others = (
        set(greater.parts) - {label, *carried, NEARLY_ALIKE.get((noun, part), label)} - ({"neck"} & {"head", label})
    )
    for other in others:
        assert np.median(growth[greater.labels == code(other)]) < own, other


def test_what_a_part_carries_ends_at_the_body() -> None:
    assert set(CARRIED_BY) <= set(PART_NAMES)
    for part in PART_NAMES:
        above = [part]
        while above[-1] in CARRIED_BY:
            above.append(CARRIED_BY[above[-1]])
            assert len(above) < 6, above
    assert parent_of("ear", ("body", "head")) == "head"
    assert parent_of("ear", ("body",)) == "body"
    assert parent_of("body", ("body", "leg")) is None
    horse = labelled_member("horse", (), np.random.default_rng(0))
    moving = horse.carried("neck")
    assert moving[horse.solids == horse.solids_named("ear")[0]].all()
    assert not moving[horse.solids == horse.solids_named("body")[0]].any()


def test_a_layout_is_found_by_its_solids() -> None:
    names = [[piece.part for piece in pieces] for pieces in layout("van", [1] * 4 + [8] * 2 + [9] * 4 + [5] * 4)]
    assert names == [["body"], ["window"], ["body"], ["roof"]] + [["window"]] * 2 + [["wheel"]] * 4 + [
        ["bumper"], ["bumper"], ["lamp"], ["lamp"]
    ]  # fmt: skip
    assert [len(pieces) for pieces in layout("dinosaur", [9] * 6)] == [1, 1, 1, 1, 3, 1]
    with pytest.raises(ValueError, match="dog"):
        layout("dog", [1])
