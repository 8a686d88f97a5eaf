"""What a source is taken for, and what follows from it."""

from __future__ import annotations

import pytest

from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.verdict import Recognition, front_of, known_source, recognise
from tests.cases import each_case
from training.evaluation.sources import source_mesh


def test_a_noun_that_is_given_is_taken() -> None:
    known = recognise(icosphere(2), "chair")
    assert known.to_dict() == {"noun": "chair", "probability": 1.0, "recognised": True}


def test_a_source_is_recognised_by_the_judge() -> None:
    known = recognise(source_mesh("vase"))
    assert known.noun == "vase"
    assert known.sure
    assert known.built


@each_case(
    "noun, probability, built", [("chair", 0.6, True), ("chair", 0.4, False), ("dog", 0.9, False), ("tree", 0.9, False)]
)
def test_what_people_build_is_known_by_its_noun(noun: str, probability: float, built: bool) -> None:
    assert Recognition(noun, probability).built is built


def test_nobody_is_asked_for_the_front_of_what_is_not_recognised() -> None:
    prior, params = load_prior("builtin", device="cpu"), resolve(DeformParams())
    unsure = front_of(Recognition("dog", 0.3), prior, params, "a giraffe")
    assert unsure is not None
    assert unsure.grader is None
    assert unsure.grown
    sure = front_of(Recognition("dog", 0.7), prior, params, "")
    assert sure is not None
    assert sure.grader is not None
    assert not sure.grown
    vase = front_of(Recognition("bottle", 0.9), prior, params, "a tall vase")
    assert vase is not None
    assert (vase.built, vase.grown, vase.crooked) == (True, False, False)
    leaning = front_of(Recognition("bottle", 0.9), prior, params, "a leaning vase")
    assert leaning is not None
    assert leaning.crooked
    assert (
        known_source(icosphere(1), prior, resolve(DeformParams.model_validate({"guidance": {"orientation": "keep"}})))
        is None
    )
    assert known_source(icosphere(1), None, params) is None
    assert front_of(None, prior, params, "a giraffe") is None


def test_probabilities_are_rounded_in_the_report() -> None:
    assert Recognition("dog", 0.123456).to_dict()["probability"] == pytest.approx(0.1235)
