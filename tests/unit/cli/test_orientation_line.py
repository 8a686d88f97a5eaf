"""The line that `meshdeform run` prints about the front."""

from __future__ import annotations

from meshdeform.cli.report_lines import orientation_line, source_line
from meshdeform.deformation.orientation import Orientation, OrientationSource


def test_a_front_that_was_searched_is_named_and_one_that_was_given_is_not() -> None:
    found = Orientation(180.0, OrientationSource.FOUND, 0.437, (0.2, 0.1))
    assert orientation_line(found.to_dict()) == (
        "Front: the side at 180 degrees (0 is +Z, 90 is +X); it fits what the asset is 44% better than the next one"
    )
    assert found.to_dict()["grades"] == [[0.0, 0.2], [180.0, 0.1]]
    others = [source for source in OrientationSource if source is not OrientationSource.FOUND]
    lines = {source: orientation_line(Orientation(source=source).to_dict()) for source in others}
    assert lines[OrientationSource.UNDECIDED].endswith("no side is clearly better")
    assert "params.guidance.orientation" in lines[OrientationSource.UNCONDITIONED]
    assert "source_noun" in lines[OrientationSource.UNRECOGNISED]
    for source in (OrientationSource.KEPT, OrientationSource.GIVEN, OrientationSource.CONTINUED):
        assert not lines[source]


def test_what_an_asset_was_taken_for_and_what_was_kept_is_said() -> None:
    known = {"noun": "chair", "probability": 0.64, "recognised": True}
    carrier = {"kind": "lattice", "cells": 900, "mirror": "x", "level": True}
    assert source_line({"source_noun": known, "carrier": carrier}) == (
        "Taken for: chair (64%; --set source_noun=NOUN corrects it). Kept: mirror symmetry across x, level and upright"
    )
    assert source_line({"source_noun": {**known, "recognised": False}, "carrier": {**carrier, "level": False}}) == (
        "Kept: mirror symmetry across x"
    )
    assert not source_line({"source_noun": None, "carrier": {"kind": "surface", "cells": None}})
