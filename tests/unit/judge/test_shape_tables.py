"""Tables of shapes: solids of known volume, what stands before them, and errors that name the paragraph."""

from __future__ import annotations

import numpy as np
import pytest

from training.judge.shapes.solids import surfaced
from training.judge.shapes.table import Table

pytestmark = pytest.mark.training


def measures(text: str) -> tuple[float, list[float]]:
    """Return the volume and the centroid of the noun `it`."""
    part = surfaced(Table(f"it: {text}").shape("it", np.random.default_rng(0)), 90, 0.0)
    a, b, c = part.verts[part.faces].transpose(1, 0, 2)
    parts = (a * np.cross(b, c)).sum(1) / 6
    return float(parts.sum()), ((a + b + c) / 4 * parts[:, None]).sum(0).tolist() / parts.sum()


@pytest.mark.parametrize(
    ("text", "volume", "centre"),
    [
        ("r=.4~.4; at 1,2,3 ball 0,0,0 r", 4 / 3 * np.pi * 0.4**3, (1, 2, 3)),
        ("pair ball 1,0,0 .4", 8 / 3 * np.pi * 0.4**3, (0, 0, 0)),
        ("block 0,0,0 2,1,1 0; hole block 1,0,0 2,2,2 0", 1.0, (-0.5, 0, 0)),
        ("size -2,1,1 block 1,0,0 1,1,1 0", 2.0, (-2, 0, 0)),
        ("row 3 0,1,0 ball 0,K,0 .4", 4 * np.pi * 0.4**3, (0, 1, 0)),
        ("turn 0,90,0 ring 2 block 1,0,1 .5,.5,1 0", 0.5, (0, 0, 0)),
        ("plate %0,0:1,0:0,1 .5", 0.5, (0, 1 / 3, 0)),
        ("platex 0,0:1,0:1,2:0,2 .5", 1.0, (0, 1, 0.5)),
        ("_two r=.4\n_two: r?=9\n  ball 0,0,r r; size 1,2,1 ball 0,0,-r r", 4 * np.pi * 0.4**3, (0, 0, -0.4 / 3)),
        ("[[ball 0,0,0 .4] | ball 0,0,0 pick(.4,.4)]\n ?0 ball 9,0,0 1", 4 / 3 * np.pi * 0.4**3, (0, 0, 0)),
    ],
)  # fmt: skip
def test_statements_make_solids_of_known_volume_and_place(
    text: str, volume: float, centre: tuple[float, float, float]
) -> None:
    found, middle = measures(text)
    assert found == pytest.approx(volume, rel=0.04)
    assert middle == pytest.approx(centre, abs=0.02)


def test_sizes_are_drawn_within_their_ranges_and_again_from_the_same_seed() -> None:
    table = Table("it: r=.2~.4 x=±3\n  ball x,0,0 r")
    drawn = [table.shape("it", np.random.default_rng(seed))[0] for seed in range(40)]
    radii = [(solid.high[0] - solid.low[0]) / 2 for solid in drawn]
    assert min(radii) > 0.2
    assert max(radii) < 0.4
    assert max(radii) - min(radii) > 0.15
    assert {bool((solid.high + solid.low)[0] > 0) for solid in drawn} == {True, False}
    assert table.shape("it", np.random.default_rng(7))[0].high.tolist() == drawn[7].high.tolist()


@pytest.mark.parametrize("text", ["bal 0,0,0 1", "ball 0,y,0 1", "ball 0,0,0", "ball 0,0,0 (1", "_none"])
def test_a_mistake_names_its_paragraph(text: str) -> None:
    with pytest.raises(ValueError, match="table's it:"):
        Table(f"it: {text}").shape("it", np.random.default_rng(0))


@pytest.mark.parametrize("text", ["it: [ball 0,0,0 1", "it: ball 0,0,0 1]", "it: ball 0,0,0 1\nit: ball 0,0,0 1"])
def test_a_table_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"[Bb]racket|More than one"):
        Table(text)
