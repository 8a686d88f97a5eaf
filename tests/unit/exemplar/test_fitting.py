"""Fits: a shape that is its own goal hardly moves; grounds stay; nothing folds; mirror and scale change nothing."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from bench.keep.cost import split
from meshdeform.exemplar import engine
from meshdeform.exemplar.choosing import Exemplar
from meshdeform.exemplar.distances import mean_distance, stretch
from meshdeform.exemplar.engine import ExemplarFit
from meshdeform.exemplar.fitting import Fitted, SourceFit
from meshdeform.exemplar.mending import Mended, mended
from meshdeform.exemplar.shapes import Shape, Wish
from meshdeform.exemplar.symmetry import asymmetry, evened, is_even, quarter_asymmetry
from meshdeform.nouns.families.parts import Part, box, ellipsoid, join
from meshdeform.nouns.labels import Floats, labelled_member
from meshdeform.reading.result import GROUND, NO_PART
from meshdeform.reading.samples import spread
from meshdeform.support.recent import Recent


def shape_of(noun: str, seed: int = 1) -> Shape:
    """Return a member in the frame of fits."""
    member = labelled_member(noun, (), np.random.default_rng(seed))
    low, high = member.verts.min(0), member.verts.max(0)
    verts = (member.verts - (low + high) / 2) / np.linalg.norm(high - low)
    return Shape(noun, verts, member.faces, member.labels, member.solid_of_face)


def apart(one: Shape, other: Floats) -> float:
    """Return the distance between a shape and its like with other vertices."""
    return mean_distance(spread(one.verts, one.faces, 1500, 0), spread(other, one.faces, 1500, 1), 0.02)


def fit(source: Shape, goal: Shape) -> Fitted:
    """Fit a source to a goal."""
    return SourceFit(source).fit(goal)


def mended_fit(source: Shape, fitted: Fitted) -> Mended:
    """Return the way that suits the nouns, mended."""
    return mended(source.verts, next(iter(fitted.ways.values())), source.faces)


@functools.cache
def dog_as_giraffe() -> tuple[Fitted, Mended]:
    """Return a fit that several tests look at, and what is left of it when it is mended."""
    fitted = fit(shape_of("dog"), shape_of("giraffe"))
    return fitted, mended_fit(shape_of("dog"), fitted)


@pytest.mark.parametrize("noun", ["horse", "car"])
def test_a_shape_fitted_to_itself_hardly_moves(noun: str) -> None:
    shape = shape_of(noun)
    result = mended_fit(shape, fit(shape, shape))
    assert np.linalg.norm(result.verts - shape.verts, axis=1).max() < 2e-3
    assert result.flipped == 0


def test_a_dog_becomes_a_giraffe_and_stays_its_own_mirror_image() -> None:
    dog, giraffe = shape_of("dog"), shape_of("giraffe")
    fitted, result = dog_as_giraffe()
    near = mean_distance(
        spread(result.verts, dog.faces, 1500, 0), spread(fitted.goal.verts, fitted.goal.faces, 1500, 1), 0.02
    )
    before = mean_distance(spread(dog.verts, dog.faces, 1500, 0), spread(giraffe.verts, giraffe.faces, 1500, 1), 0.02)
    assert near < 0.35 * before
    assert result.flipped == 0
    assert asymmetry(fitted.ways["smooth"], dog.faces, 0) < asymmetry(dog.verts, dog.faces, 0) + 0.001
    assert abs(result.verts[:, 1].min() - giraffe.verts[:, 1].min()) < 0.02


def test_the_ground_stays_and_is_not_fitted() -> None:
    cow = shape_of("cow")
    plate = box([0, cow.verts[:, 1].min() - 0.01, 0], [1.5, 0.01, 1.5])
    whole = join([Part(cow.verts, cow.faces), plate])
    labels = np.concatenate([cow.labels, np.full(len(plate.faces), GROUND)])
    source = Shape("cow", whole.verts, whole.faces, labels)
    result = mended_fit(source, fit(source, shape_of("elephant")))
    rows = slice(len(cow.verts), None)
    np.testing.assert_array_equal(result.verts[rows], whole.verts[rows])


def test_without_parts_there_is_only_the_smooth_fit() -> None:
    ball = ellipsoid([0, 0, 0], 0.3, rings=16)
    egg = Shape("", ball.verts * [1, 1.3, 1], ball.faces, np.full(len(ball.faces), NO_PART))
    source = Shape("", ball.verts, ball.faces, egg.labels)
    fitted = fit(source, egg)
    assert fitted.matching is None
    assert apart(egg, mended_fit(source, fitted).verts) < 0.004


def test_an_asset_is_turned_scaled_and_moved_with_its_result() -> None:
    bottle = shape_of("bottle")
    wish = Wish(targets=(shape_of("vase"),))
    results = []
    for scale, shift in ((1.0, 0.0), (40.0, 7.0)):
        run = ExemplarFit(bottle.verts * scale + shift, bottle.faces, None, wish, labels=bottle.labels)
        stages = list(run)
        assert [stage.share for stage in stages] == sorted(stage.share for stage in stages)
        assert stages[-1].share == 1
        last = stages[-1].verts
        assert last is not None
        results.append((last - shift) / scale)
        assert run.result.distance < run.result.distance_before
    # Which of two faces is nearer to a place on their edge is up to rounding.
    np.testing.assert_allclose(results[0], results[1], atol=2e-3)
    assert np.abs(results[0] - results[1]).mean() < 1e-4


def test_another_mesh_of_the_same_surface_goes_to_the_same_place() -> None:
    dog, giraffe = shape_of("dog"), shape_of("giraffe")
    fine_dog = Shape("dog", *split(dog.verts, dog.faces), np.repeat(dog.labels, 4))
    coarse, fine = dog_as_giraffe()[1], mended_fit(fine_dog, fit(fine_dog, giraffe))
    apart = np.linalg.norm(fine.verts[: len(dog.verts)] - coarse.verts, axis=1)
    assert apart.mean() < 0.02


def test_the_mirror_image_of_a_source_goes_to_that_of_the_result() -> None:
    cow, mirror = shape_of("cow", 5), np.array([-1.0, 1, 1])
    cow = cow.moved(cow.verts + np.outer(np.maximum(cow.verts[:, 2], 0) ** 2, [0.5, 0, 0]))  # it looks to one side
    horse = shape_of("horse")
    image, image_horse = (Shape(one.noun, one.verts * mirror, one.faces[:, ::-1], one.labels) for one in (cow, horse))
    one, other = mended_fit(cow, fit(cow, horse)).verts, mended_fit(image, fit(image, image_horse)).verts
    assert np.linalg.norm(one - other * mirror, axis=1).mean() < 0.02


def test_of_several_targets_the_nearest_is_taken() -> None:
    ball = ellipsoid([0, 0, 0], 0.3, rings=12)
    none = np.full(len(ball.faces), NO_PART)
    targets = tuple(
        Shape("", ball.verts * scales, ball.faces, none) for scales in ([0.3, 1, 1], [1, 1.1, 1], [1, 1, 2])
    )
    run = ExemplarFit(ball.verts, ball.faces, None, Wish(targets=targets), labels=none)
    list(run)
    assert run.result.member["target"] == 1


def test_strength_goes_part_of_the_way() -> None:
    ball = ellipsoid([0, 0, 0], 0.3, rings=12)
    none = np.full(len(ball.faces), NO_PART)
    target = Shape("", ball.verts * [1, 1.5, 1], ball.faces, none)
    ends = []
    for strength in (1.0, 0.5):
        run = ExemplarFit(ball.verts, ball.faces, None, Wish(targets=(target,), strength=strength), labels=none)
        list(run)
        ends.append(run.result.verts - run.source.verts)
    np.testing.assert_allclose(ends[1], ends[0] / 2, atol=1e-3)


def test_another_strength_of_a_wish_goes_the_way_that_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    ball, seeds = ellipsoid([0, 0, 0], [0.3, 0.3, 0.3]), list[int]()

    def chosen(source: Shape, wish: Wish, *_: object, **__: object) -> list[Exemplar]:
        seeds.append(wish.seed)
        return [Exemplar(source.moved(source.verts * [1, 1.5, 1]), 0.1, 0.1)]

    monkeypatch.setattr(engine, "_recent", Recent(4))
    monkeypatch.setattr(engine, "exemplars", chosen)
    monkeypatch.setattr(engine, "moulded", lambda _, goal: goal.verts)
    gone = {}
    for seed, strength in ((0, 1.0), (0, 0.5), (1, 0.5)):
        wish = Wish("vase", seed=seed, strength=strength)
        run = ExemplarFit(ball.verts, ball.faces, None, wish)
        assert list(run)[-1].verts is not None
        gone[seed, strength] = run.result.verts - run.source.verts
    assert seeds == [0, 1]
    np.testing.assert_allclose(gone[0, 0.5], gone[0, 1.0] / 2, atol=1e-12)
    np.testing.assert_array_equal(gone[1, 0.5], gone[0, 0.5])


def test_the_stretch_of_a_surface_does_not_count_its_scale() -> None:
    ball = ellipsoid([0, 0, 0], 0.3, rings=16)
    assert stretch(ball.verts, 3 * ball.verts, ball.faces) < 1e-9
    plate = box([0, 0, 0], [1, 0.5, 1])
    doubled = stretch(plate.verts, plate.verts * [1, 2, 1], plate.faces)
    assert 0.1 < doubled < np.log(2)


def test_symmetry_is_found() -> None:
    vase, chair = shape_of("vase"), shape_of("chair")
    assert is_even(vase.verts, vase.faces, 0)
    assert is_even(vase.verts, vase.faces, 2)
    assert is_even(chair.verts, chair.faces, 0)
    assert not is_even(chair.verts, chair.faces, 2)
    assert not is_even(chair.verts + np.outer(chair.verts[:, 1], [0.3, 0, 0]), chair.faces, 0)
    assert quarter_asymmetry(vase.verts, vase.faces) < 0.01 < quarter_asymmetry(chair.verts, chair.faces)


def test_displacements_of_mirror_images_are_made_mirror_images() -> None:
    chair = shape_of("chair")
    moved = chair.verts + np.random.default_rng(0).normal(0, 0.01, chair.verts.shape)
    even = evened(chair.verts, moved, (0,))
    np.testing.assert_allclose(evened(chair.verts, even, (0,)), even, atol=1e-12)
    assert asymmetry(even, chair.faces, 0) < 0.5 * asymmetry(moved, chair.faces, 0)
    np.testing.assert_array_equal(evened(chair.verts, moved, ()), moved)
