"""Guesses of drawings with the weights of the package, the search for a member, and the fit of such weights."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from meshdeform.assets.drawing import read_drawing
from meshdeform.errors import ModelError, ParameterError
from meshdeform.kinds.sketch.guessing import guess, is_unsure
from meshdeform.kinds.sketch.lines import View
from meshdeform.kinds.sketch.looking import WEIGHTS, Projection, read_projection
from meshdeform.kinds.sketch.matching import DrawnLines, distance
from meshdeform.nouns.forms import drawn
from meshdeform.vocabulary.nouns import NOUNS
from meshdeform.words import in_use
from meshdeform.words.file import ShapeSource, WordShape, write_word
from tests.drawings import drawing_of
from training.sketch.train import fitted, warped


def test_lines_of_members_are_among_the_guesses() -> None:
    right = 0
    for noun in ("giraffe", "chair", "airplane", "snail", "umbrella", "guitar"):
        right += noun in [each.noun for each in guess(drawing_of(noun, View(60, 12)))]
    assert right >= 4


def test_a_house_that_is_drawn_by_hand_is_a_house() -> None:
    page = Image.new("L", (400, 400), 255)
    pen = ImageDraw.Draw(page)
    for box in ((100, 180, 300, 360), (176, 260, 224, 360), (120, 220, 160, 260), (240, 220, 280, 260)):
        pen.rectangle(box, outline=0, width=4)
    pen.line([(80, 180), (200, 72), (320, 180), (80, 180)], fill=0, width=4)
    buffer = io.BytesIO()
    page.save(buffer, "PNG")
    guesses = guess(buffer.getvalue())
    assert "house" in [each.noun for each in guesses]
    assert [each.probability for each in guesses] == sorted((each.probability for each in guesses), reverse=True)
    assert len({each.noun for each in guesses}) == 3
    assert is_unsure(guesses) == (guesses[0].probability < 0.95)
    (only,) = guess(buffer.getvalue(), noun="tent")
    assert only.noun == "tent"
    assert not is_unsure([only], noun="tent")
    with pytest.raises(ParameterError, match="no noun"):
        guess(buffer.getvalue(), noun="justice")


def test_sliders_follow_the_drawing() -> None:
    less, more = (guess(drawing_of("giraffe", neck=at), noun="giraffe")[0].values for at in (-1.0, 1.0))
    assert float(more["neck"]) > float(less["neck"]) + 0.5


def test_a_word_of_ones_own_is_found_by_its_shapes() -> None:
    member = drawn("umbrella", (), np.random.default_rng(5))
    size = float(np.linalg.norm(np.ptp(member.verts, axis=0)))
    whole = WordShape(member.verts / size, member.faces, np.zeros(len(member.faces), np.int64))
    with in_use([write_word("zorp", [whole], [ShapeSource("zorp.glb")], parts=("body",))]):
        guesses = guess(drawing_of("zorp"))
        assert "zorp" in [each.noun for each in guesses]
        assert len(guesses[0].glb()) > 1000


def test_lines_are_nearer_to_themselves_than_to_others() -> None:
    one, other = (DrawnLines(read_drawing(drawing_of(noun))) for noun in ("giraffe", "car"))
    assert distance(one, one) == 0
    assert distance(one, other) == pytest.approx(distance(other, one))
    assert 0.01 < distance(one, other) < 0.12


def test_weights_are_small_and_those_that_are_damaged_are_told(tmp_path: Path) -> None:
    assert WEIGHTS.stat().st_size < 5_000_000
    assert set(read_projection().nouns) <= set(NOUNS)
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(WEIGHTS.read_bytes()[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        read_projection(damaged)


def test_a_fit_tells_classes_apart_and_repeats() -> None:
    rng = np.random.default_rng(0)
    middles = rng.normal(0, 1, (6, 1764)).astype(np.float32)
    of = np.repeat(np.arange(6), 8)
    people, members = ((middles[of] + rng.normal(0, 0.6, (48, 1764))).astype(np.float32) for _ in range(2))
    first, second = (fitted(people, of, members, of) for _ in range(2))
    assert all(np.array_equal(first[name], second[name]) for name in first)
    projection = Projection(first, ("a", "b", "c", "d"))
    picture = read_drawing(drawing_of("car"))
    likely = projection.likelihoods(picture, {"e": projection.placed(picture[None])[0]})
    assert max(likely, key=lambda each: likely[each]) == "e"
    assert sum(likely.values()) < 1  # what is left is of the classes that are no noun


def test_a_warped_drawing_has_as_much_ink_at_another_place() -> None:
    picture = read_drawing(drawing_of("car"))[None]
    other = warped(picture, np.random.default_rng(1))
    assert other.sum() == pytest.approx(picture.sum(), rel=0.35)
    assert np.abs(other - picture).sum() > 0.3 * picture.sum()
