"""Readings that are kept: keys, the folder of a machine, and several places."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import pytest

from meshdeform.assets.limits import Limits
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.requests.groups import grouped
from meshdeform.runs import changes
from meshdeform.runs.kept_readings import MOST_BYTES, FolderReadings, Several, Unkept, key_of


def params(**named: object) -> ResolvedParams:
    return resolve(DeformParams.model_validate(grouped(named)))


def test_a_key_has_all_that_a_reading_depends_on_and_nothing_else() -> None:
    plain = key_of("ab", ".glb", params())
    others = [
        key_of("ac", ".glb", params()),
        key_of("ab", ".obj", params()),
        key_of("ab", ".glb", params(exclude=["Ground"])),
        key_of("ab", ".glb", params(backdrop="deform")),
        key_of("ab", ".glb", params(source_noun="dog")),
        key_of("ab", ".glb", params(orientation=0)),
        key_of("ab", ".glb", params(orientation=90)),
        key_of("ab", ".glb", params(), subdivided=True),
    ]
    assert len({plain, *others}) == len(others) + 1
    same = [
        key_of("ab", ".GLB", params(preset="preview", seed=7)),
        key_of("ab", ".glb", params(orientation="keep")),
        key_of("ab", ".glb", params(parts=[{"name": "ears", "faces": [1]}])),
        key_of("ab", ".glb", params(source_noun="an unknown noun")),
    ]
    assert set(same) == {plain}
    assert key_of("ab", ".glb", params(source_noun="puppies")) == key_of("ab", ".glb", params(source_noun="dog"))
    assert key_of("ab", ".glb", params(orientation=-90)) == key_of("ab", ".glb", params(orientation=270))


def test_a_folder_keeps_what_was_used_last(tmp_path: Path) -> None:
    kept = FolderReadings(tmp_path / "cache", most=3, most_bytes=100)
    assert kept.get("a") is None
    for second, key in enumerate("abc"):
        kept.put(key, key.encode() * 10)
        os.utime(tmp_path / "cache" / "readings" / f"{key}.reading", (second, second))
    assert kept.get("a") == b"a" * 10  # and is the newest now
    kept.put("d", b"d" * 10)
    assert [key for key in "abcd" if kept.get(key) is not None] == ["a", "c", "d"]
    kept.put("e", b"e" * 85)
    assert kept.get("e") == b"e" * 85
    assert sum(path.stat().st_size for path in (tmp_path / "cache" / "readings").iterdir()) <= 100
    kept.put("f", b"f" * 101)
    assert kept.get("f") is None
    assert not [path for path in (tmp_path / "cache" / "readings").iterdir() if path.name.startswith(".")]


def test_a_folder_that_cannot_be_written_keeps_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    kept = FolderReadings(tmp_path / "file")
    kept.put("a", b"a")
    assert kept.get("a") is None
    assert MOST_BYTES < 2**30


def test_what_one_place_has_all_get(tmp_path: Path) -> None:
    near, far = FolderReadings(tmp_path / "near"), FolderReadings(tmp_path / "far")
    both = Several(Unkept(None), near, far)
    far.put("a", b"far")
    assert both.get("a") == near.get("a") == b"far"
    both.put("b", b"b")
    assert near.get("b") == far.get("b") == both.get("b") == b"b"
    assert both.get("c") is None
    assert both.samples == near.samples != far.samples


def test_a_child_is_handed_what_was_kept_of_just_this_question(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    handed: list[bytes | None] = []

    class Child:
        @staticmethod
        def ask(task: dict[str, Any], _folder: Path, _timeout_s: float) -> dict[str, Any]:
            path = Path(task["reading"])
            handed.append(path.read_bytes() if path.is_file() else None)
            path.write_bytes(task["params"]["source_noun"].encode())
            return {"missing": None, "parts": []}

    monkeypatch.setattr(changes, "_QUESTION", Child)
    file, kept = tmp_path / "a.glb", FolderReadings(tmp_path / "cache")
    file.write_bytes(b"any")
    for readings, noun in ((None, "dog"), (None, "dog"), (kept, "dog"), (kept, "cat"), (kept, "dog")):
        changes.parts_of(file, "a.glb", "", params(source_noun=noun), Limits(), readings)
    assert handed == [None, None, None, None, b"dog"]
    assert kept.get(key_of(hashlib.sha256(b"any").hexdigest(), ".glb", params(source_noun="cat"))) == b"cat"
