"""Samples of members are kept in files: the same with and without, drawn anew when damaged, one version at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from meshdeform.reading import banks
from meshdeform.reading.banks import Bank, bank_of
from meshdeform.reading.version import MEMBERS_VERSION

_NOUN = "mug"


@pytest.fixture(autouse=True)
def few_members(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(banks, "MEMBERS", 3)
    shapes = {name: (3, *shape[1:]) for name, shape in banks._SHAPES.items()}
    monkeypatch.setattr(banks, "_SHAPES", shapes)
    bank_of.cache_clear()
    yield
    bank_of.cache_clear()


def _again(folder: Path | None) -> Bank:
    bank_of.cache_clear()
    return bank_of(_NOUN, folder)


def _same(one: Bank, other: Bank) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in banks._SHAPES)


def test_a_file_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = _again(None)
    assert drawn.places.shape == (3, banks.SAMPLES, 3)
    folder = tmp_path / "new" / "banks"
    assert _same(_again(folder), drawn)
    assert [path.name for path in folder.iterdir()] == [f"{_NOUN}-{MEMBERS_VERSION}.npz"]
    monkeypatch.setattr(banks, "_drawn", lambda _: pytest.fail("it was drawn again"))
    assert _same(_again(folder), drawn)


def test_damaged_files_are_drawn_anew(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    drawn = _again(tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    at = len(whole) // 2
    np.savez(tmp_path / "other.npz", places=np.zeros(3))
    other = (tmp_path / "other.npz").read_bytes()
    (tmp_path / "other.npz").unlink()
    for damaged in (b"", whole[:at], whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :], b"x" * 100, other):
        path.write_bytes(damaged)
        caplog.clear()
        assert _same(_again(tmp_path), drawn)
        assert "drawn anew" in caplog.text
        assert path.read_bytes() == whole


def test_files_of_other_versions_go(tmp_path: Path) -> None:
    for name in (f"{_NOUN}-0123456789abcdef.npz", "dog-0123456789abcdef.npz"):
        (tmp_path / name).write_bytes(b"old")
    _again(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {f"{_NOUN}-{MEMBERS_VERSION}.npz", "dog-0123456789abcdef.npz"}


def test_where_nothing_can_be_written_it_is_drawn(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("no folder")
    assert _same(_again(tmp_path / "file" / "banks"), _again(None))
    assert "not kept" in caplog.text
