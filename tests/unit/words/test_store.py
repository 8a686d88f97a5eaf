"""A folder keeps words, all or none; what is damaged in it is left out, and told of who asks for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.errors import AssetError, NotFoundError, ParameterError
from meshdeform.words import WordFolder
from tests.unit.words.words import BOX, WEDGE, box, word


def test_words_are_kept_replaced_and_removed(tmp_path: Path) -> None:
    store = WordFolder(tmp_path / "words")
    assert store.words() == []
    store.add([WEDGE, BOX])
    assert store.words() == [BOX, WEDGE]
    assert store.word("wedge") == WEDGE
    other = word("wedge", box(2, 1, 1))
    with pytest.raises(ParameterError, match="You have"):
        store.add([other])
    store.add([other], replace=True)
    assert store.word("wedge") == other
    store.remove(["wedge"])
    assert store.words() == [BOX]


def test_of_several_words_all_are_kept_or_none(tmp_path: Path) -> None:
    store = WordFolder(tmp_path)
    with pytest.raises(ParameterError):
        store.add([BOX, word("dog", box())])
    with pytest.raises(ParameterError, match="would be one"):
        store.add([WEDGE, word("chock", box())])
    assert list(tmp_path.iterdir()) == []
    store.add([BOX])
    with pytest.raises(NotFoundError, match="wedge"):
        store.remove(["dragon-box", "wedge"])
    assert store.words() == [BOX]


def test_a_damaged_file_is_left_out_and_told_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    store = WordFolder(tmp_path)
    store.add([BOX])
    (tmp_path / "wedge.word").write_bytes(WEDGE.data[:-1])
    (tmp_path / "other.word").write_bytes(WEDGE.data)
    assert store.words() == [BOX]
    assert "wedge.word" in caplog.text
    assert "other.word" in caplog.text
    with pytest.raises(AssetError, match="damaged"):
        store.word("wedge")


def test_no_name_leads_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "wedge.word").write_bytes(WEDGE.data)
    store = WordFolder(tmp_path / "words")
    for reach in (store.word, lambda noun: store.remove([noun])):
        with pytest.raises(NotFoundError):
            reach("../wedge")
    assert (tmp_path / "wedge.word").is_file()
