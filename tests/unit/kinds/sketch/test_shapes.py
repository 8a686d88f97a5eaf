"""Shapes of nouns by sliders: sizes of parts, sides of the whole, kinds, poses and words of somebody's own."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets import Limits, load_asset
from meshdeform.errors import ParameterError
from meshdeform.kinds.sketch.shapes import PLAIN, known_noun, nouns, shape, shape_glb, sliders_of
from meshdeform.nouns.labels import code
from meshdeform.vocabulary.nouns import NOUNS
from tests.cases import each_case


def height_of(noun: str, part: str, **values: object) -> float:
    made = shape(noun, values)
    places = made.verts[made.faces[made.labels == code(part)]].reshape(-1, 3)
    return float(np.ptp(places[:, 1]))


def test_a_part_grows_with_its_slider_and_the_rest_stays() -> None:
    heights = [height_of("giraffe", "neck", neck=size) for size in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    assert heights == sorted(heights)
    assert heights[-1] > 2 * heights[0]
    legs, bodies = ([height_of("giraffe", part, neck=size) for size in (-1.0, 1.0)] for part in ("leg", "body"))
    assert legs[0] / bodies[0] == pytest.approx(legs[1] / bodies[1])


def test_sides_are_factors_and_variants_kinds_and_poses_are_other_shapes() -> None:
    plain = shape("dog", {})
    np.testing.assert_allclose(shape("dog", {"width": 1.5, "depth": 0.5}).verts, plain.verts * [1.5, 1, 0.5])
    sliders = sliders_of("dog")
    assert [each.name for each in sliders.choices] == ["kind", "variant", "pose"]
    for choice in sliders.choices:
        for option in choice.options[1:]:
            assert not np.array_equal(shape("dog", {choice.name: option}).verts, plain.verts), option
    assert sliders.checked({})["pose"] == PLAIN


def test_every_noun_has_sliders_and_a_shape_whose_nodes_are_its_parts() -> None:
    assert nouns() == sorted(NOUNS)
    for noun in nouns()[::40]:
        sliders = sliders_of(noun)
        assert {"width", "height", "depth"} <= {each.name for each in sliders.numbers}
        made = load_asset(shape_glb(noun, {}), "shape.glb", Limits.unlimited())
        assert len(made.surface.triangles) == len(shape(noun, {}).faces)
    teapot = load_asset(shape_glb("teapot", {}), "shape.glb", Limits.unlimited())
    assert {str(node["name"]) for node in teapot.pieces().nodes} >= {"handle", "spout"}


@each_case("values", [{"wings": 2}, {"width": 7}, {"width": "wide"}, {"width": float("nan")}, {"kind": "x"}])
def test_sliders_that_do_not_exist_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ParameterError):
        shape("chair", values)


def test_a_noun_has_its_other_names() -> None:
    assert known_noun("Office chair") == known_noun("seat") == "chair"
    with pytest.raises(ParameterError, match="no noun"):
        known_noun("justice")
