"""Samples of members are kept in files: the same with and without, drawn anew when damaged, one version at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from meshdeform.nouns.families import KINDS
from meshdeform.nouns.forms import other_kinds, own_forms
from meshdeform.reading import banks
from meshdeform.reading.banks import Bank, bank_of, candidate_member, form_of, members_with_parts, pose_of
from meshdeform.reading.version import MEMBERS_VERSION
from meshdeform.vocabulary.lookup import Attribute

_NOUN = "can"  # whose kinds are no further members


@pytest.fixture(autouse=True)
def few_members(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(banks, "MEMBERS", 3)
    monkeypatch.setattr(banks, "_WISHED", 5)
    monkeypatch.setattr(banks, "_WISHED_WITH_ATTRIBUTES", 4)
    monkeypatch.setattr(banks, "_MOST_FILES", 2)
    banks._bank_of.cache_clear()
    yield
    banks._bank_of.cache_clear()


def _again(folder: Path | None, noun: str = _NOUN, attributes: tuple[Attribute, ...] | None = None) -> Bank:
    banks._bank_of.cache_clear()
    return bank_of(noun, folder, attributes)


def _same(one: Bank, other: Bank) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in banks._SHAPES)


def test_a_file_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = _again(None)
    assert drawn.positions.shape == (3, banks.SAMPLES, 3)
    folder = tmp_path / "new" / "banks"
    assert _same(_again(folder), drawn)
    assert [path.name for path in folder.iterdir()] == [f"{_NOUN}-{MEMBERS_VERSION}.npz"]
    monkeypatch.setattr(banks, "_draw_bank", lambda *_: pytest.fail("it was drawn again"))
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


LONG_TAIL, BIG_EARS = Attribute("tail", "long"), Attribute("ears", "big")


def test_members_with_attributes_have_files_of_their_own_of_which_the_newest_stay(tmp_path: Path) -> None:
    _again(tmp_path, "dog")
    plain, long = _again(tmp_path, "dog", ()), _again(tmp_path, "dog", (LONG_TAIL,))
    assert {path.name.partition("-")[0] for path in tmp_path.iterdir()} == {"dog", "dog+", "dog+long_tail"}
    assert (len(plain), len(long)) == (5, 4)
    assert _same(_again(tmp_path, "dog", (LONG_TAIL,)), long)
    for number, path in enumerate(sorted(tmp_path.iterdir())):
        os.utime(path, (number, number))
    _again(tmp_path, "dog", (BIG_EARS,))
    _again(tmp_path, "dog", (BIG_EARS, LONG_TAIL))
    left = {path.name.partition("-")[0] for path in tmp_path.iterdir()}
    assert left == {"dog", "dog+", "dog+big_ears", "dog+big_ears+long_tail"}


def test_every_member_with_attributes_has_them_in_each_of_its_poses() -> None:
    tails = []
    for attributes in ((), (LONG_TAIL,)):
        numbers = [number for number in range(64) if form_of("dog", number, attributes) in ("dog", "upright-dog")]
        members = [candidate_member("dog", number, attributes) for number in numbers]
        assert {form_of("dog", number, attributes) for number in range(64)} >= {"dog", "upright-dog", "husky"}
        assert {pose_of("dog", number, attributes) for number in numbers} == {"", "sitting", "lying", "T"}
        rows = [member.solids == member.solids_named("tail")[0] for member in members]
        size = [np.linalg.norm(np.ptp(member.verts[row], axis=0)) for member, row in zip(members, rows, strict=True)]
        tails.append(size)
    assert max(tails[0]) < min(tails[1])


def test_forms_of_a_noun_look_like_it_and_can_have_the_attributes() -> None:
    bears = ("bear", "standing-bear", *KINDS["bear"], "upright-bear")
    assert own_forms("bear", ()) == own_forms("bear", (BIG_EARS,)) == bears
    assert own_forms("chair", ()) == ("chair", "office-chair", "desk-chair", *KINDS["chair"])
    assert own_forms("giraffe", ()) == ("giraffe",)
    assert not {"standing-bear", "upright-bear"} & set(own_forms("bear", (LONG_TAIL,)))


def test_kinds_by_which_parts_are_not_read_come_last(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(banks, "_OF_A_KIND", 1)
    kinds = other_kinds("mug")
    assert len(kinds) > 1
    assert [form_of("mug", 3 + number) for number in range(len(kinds))] == list(kinds)
    drawn = _again(None, "mug")
    assert len(drawn) == 3 + len(kinds)
    assert members_with_parts("mug") == 3
    last = candidate_member("mug", 2 + len(kinds))
    assert last.noun == kinds[-1]
    np.testing.assert_allclose(drawn.high[-1], last.verts.max(0), atol=1e-3)
    assert other_kinds("battery") == ()
