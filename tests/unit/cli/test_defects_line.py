"""The line that `meshdeform run` prints about damaged faces."""

from __future__ import annotations

import pytest

from meshdeform.cli.defects import defects_line


@pytest.mark.parametrize(
    ("flipped", "added", "collapsed", "line"),
    [
        (0, 0, 0, ""),
        (0, None, 0, ""),
        (0, 1234, 0, "Damaged faces, of 5,120: 1,234 newly cutting others"),
        (2, 44, 1, "Damaged faces, of 5,120: 2 flipped, 44 newly cutting others, 1 without area"),
    ],
)
def test_only_defects_are_told(flipped: int, added: int | None, collapsed: int, line: str) -> None:
    quality = {"flipped_faces": flipped, "self_intersections_added": added, "collapsed_faces": collapsed}
    assert defects_line(quality, 5120) == line
