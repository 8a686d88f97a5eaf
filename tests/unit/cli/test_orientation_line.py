"""The line that `meshdeform run` prints about the front."""

from __future__ import annotations

from meshdeform.cli.orientation import orientation_line
from meshdeform.deformation.orientation import Orientation, OrientationSource


def test_a_front_that_was_searched_is_named_and_one_that_was_given_is_not() -> None:
    found = Orientation(180.0, OrientationSource.FOUND, 0.437, (0.2, 0.1))
    assert orientation_line(found.to_dict()) == (
        "Front: the side at 180 degrees (0 is +Z, 90 is +X); it fits the prompt 44% better than +Z"
    )
    assert found.to_dict()["grades"] == [[0.0, 0.2], [180.0, 0.1]]
    others = [source for source in OrientationSource if source is not OrientationSource.FOUND]
    lines = {source: orientation_line(Orientation(source=source).to_dict()) for source in others}
    assert lines[OrientationSource.UNDECIDED].startswith("Front: +Z; no side")
    assert "params.orientation" in lines[OrientationSource.UNCONDITIONED]
    for source in (OrientationSource.KEPT, OrientationSource.GIVEN, OrientationSource.CONTINUED):
        assert not lines[source]
