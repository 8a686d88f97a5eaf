"""The counts of the house are a ceiling: what is added beyond a little is written down, and so it is seen."""

from __future__ import annotations

import json
import shutil

import pytest

from bench.code_shape import counted
from bench.house import EXPECTED, ROOM, counts


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_what_is_added_is_written_down() -> None:
    kept = json.loads(EXPECTED.read_text())
    now = counts()
    assert now.keys() == kept.keys()
    room = {name: ROOM if name.endswith(("_lines", "_words")) and "functions" not in name else 0 for name in kept}
    grown = {name: count - kept[name] for name, count in now.items() if count - kept[name] > room[name]}
    assert not grown, f"{grown}: take something out, or run `python -m bench.house --write` and say who uses it"


def test_what_makes_code_hard_to_read_is_counted() -> None:
    """A table of functions must stand below them, and so must what is made of it."""
    body = "".join(f"    x{number} = 0\n" for number in range(60))
    table = "\nTABLE = [far]\nSIZE = len(TABLE)\n"
    first = f"class A:\n    def long(self, a, b, c, d, e, f, g, h): ...\n\ndef far():\n{body}{table}"
    assert counted({"a.py": first, "b.py": "class B: ...\n"}) == {
        "functions_over_60_lines": 1,
        "functions_over_8_arguments": 0,
        "class_names_twice": 0,
        "modules_with_constants_below": 0,
    }
    second = "class A: ...\n\ndef wide(a, b, c, d, e, f, g, h, i): ...\n\nNEAR = 1\n"
    assert list(counted({"a.py": first, "c.py": second}).values()) == [1, 1, 1, 1]
