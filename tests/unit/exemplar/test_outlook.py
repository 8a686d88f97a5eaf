"""What cannot be is told before a run, with prompts that can be sent instead."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshdeform.exemplar.choosing import exemplars
from meshdeform.exemplar.outlook import FitOutlook, outlook
from meshdeform.exemplar.shapes import Wish
from meshdeform.nouns.forms import drawn
from meshdeform.vocabulary.grammar import parse
from tests.cases import each_case
from tests.unit.exemplar.test_choosing import asset, unread


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("banks")


def of(noun: str, wished: str, cache: Path) -> FitOutlook:
    source, wish = asset(drawn(noun, (), np.random.default_rng(7))), Wish(wished)
    told = outlook(source, wish, exemplars(source, wish, 1, cache=cache)[0])
    assert outlook(source, wish, cache=cache) == told
    return told


@each_case("noun, wished", [("house", "castle"), ("airplane", "rocket"), ("bed", "bathtub")])
def test_what_cannot_be_is_told_with_prompts_that_are_accepted(noun: str, wished: str, cache: Path) -> None:
    told = of(noun, wished, cache)
    assert told.doubtful
    assert any(wished in reason and noun in reason for reason in told.reasons)
    assert parse(told.suggestions[-1]).noun == noun
    assert wished not in {parse(prompt).noun for prompt in told.suggestions}


@each_case(
    "noun, wished", [("fox", "cat"), ("horse", "giraffe"), ("bottle", "vase"), ("dog", "bear"), ("duck", "duck")]
)
def test_what_is_near_raises_no_doubt(noun: str, wished: str, cache: Path) -> None:
    told = of(noun, wished, cache)
    assert (told.doubtful, told.reasons, told.suggestions) == (False, (), ())
    assert 0 < told.distance < 0.17


def test_an_asset_of_which_nothing_is_known_is_told_by_its_distance(cache: Path) -> None:
    source, wish = unread(asset(drawn("snake", (), np.random.default_rng(7)))), Wish("chair")
    told = outlook(source, wish, exemplars(source, wish, 1, cache=cache)[0])
    assert told.doubtful
    assert told.reasons == ("The nearest chair is too unlike this asset.",)


def test_a_lump_becomes_anything(cache: Path) -> None:
    ball = unread(asset(drawn("apple", (), np.random.default_rng(7))))
    ball = ball.moved(0.3 * ball.verts / np.maximum(np.linalg.norm(ball.verts, axis=1, keepdims=True), 1e-9))
    assert not outlook(ball, Wish("chair"), cache=cache).doubtful
