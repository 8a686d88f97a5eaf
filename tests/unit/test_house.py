"""The counts of the house are a ceiling: what is added beyond a little is written down, and so it is seen."""

from __future__ import annotations

import json
import shutil

import pytest

from bench.house import EXPECTED, ROOM, counts


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_what_is_added_is_written_down() -> None:
    kept = json.loads(EXPECTED.read_text())
    now = counts()
    assert now.keys() == kept.keys()
    room = {name: 0 if name == "parameters" else ROOM for name in kept}
    grown = {name: count - kept[name] for name, count in now.items() if count - kept[name] > room[name]}
    assert not grown, f"{grown}: take something out, or run `python -m bench.house --write` and say who uses it"
