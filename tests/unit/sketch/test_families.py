"""Procedural families: closed solids of the stated proportions, and parameters by name."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.errors import ParameterError
from meshdeform.sketch.families import FAMILIES, Family
from tests.cases import each_case
from training.sketch.lines import joined

EVERY = each_case("family", FAMILIES.values(), ids=list(FAMILIES))


@EVERY
def test_solids_are_closed_and_turned_outwards(family: Family) -> None:
    for seed in range(8):
        for name, solid in family.solids(family.draw(np.random.default_rng(seed))).items():
            faces = joined({name: solid}).faces
            edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
            there, back = ({tuple(edge) for edge in each.tolist()} for each in (edges, edges[:, ::-1]))
            assert len(there) == len(edges)
            assert there == back
            corners = solid.verts[solid.faces]
            assert np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) > 0


@EVERY
def test_parameters_return_from_shares(family: Family) -> None:
    values = family.draw(np.random.default_rng(3))
    found = family.values(family.shares(values), family.indices(values))
    assert found == {k: pytest.approx(v, abs=1e-4) if isinstance(v, float) else v for k, v in values.items()}
    assert family.checked(family.defaults()) == family.defaults()


@EVERY
def test_every_option_changes_the_shape(family: Family) -> None:
    plain = family.solids({})
    for choice in family.choices:
        for option in choice.options[1:]:
            other = family.solids({choice.name: option})
            same = other.keys() == plain.keys() and all(
                np.array_equal(other[name].verts, plain[name].verts) for name in plain
            )
            assert not same, (choice.name, option)


def test_proportions_are_those_that_the_parameters_state() -> None:
    def box(name: str, **values: object) -> tuple[np.ndarray, np.ndarray]:
        verts = joined(FAMILIES[name].solids(values)).verts
        return verts.min(0), verts.max(0)

    low, high = box("table", depth=0.8, height=0.5)
    np.testing.assert_allclose(high - low, [1.0, 0.5, 0.8], atol=1e-12)
    low, high = box("chair", width=0.5, back_height=0.4)
    np.testing.assert_allclose([high[0] - low[0], high[1], low[1]], [0.5, 0.85, 0.0], atol=1e-12)
    low, high = box("airplane", span=1.0, engines="none")
    np.testing.assert_allclose(high[0] - low[0], 2.0, atol=0.02)
    for name in ("vase", "goblet", "lamp"):
        low, high = box(name)
        np.testing.assert_allclose([low[1], high[1]], [0.0, 1.0], atol=1e-9)


@each_case("values", [{"wings": 2}, {"width": 7}, {"width": "wide"}, {"width": float("nan")}, {"legs": "x"}])
def test_parameters_that_do_not_exist_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ParameterError):
        FAMILIES["chair"].solids(values)
