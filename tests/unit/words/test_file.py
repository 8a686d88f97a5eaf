"""A word comes back from its bytes; equal words have equal bytes; whatever is damaged or hostile is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load

from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError
from meshdeform.words import MAX_FACES, MAX_SHAPES, ShapeSource, Word, WordShape, joined, read_words, write_word
from meshdeform.words.limits import MAX_WORD_BYTES, MAX_WORDS
from tests.cases import each_case
from tests.unit.words.words import BOX, WEDGE, box, word


def test_a_word_comes_back_from_its_bytes() -> None:
    read = Word.read(WEDGE.data).checked()
    assert read == WEDGE
    assert (read.noun, read.synonyms, read.parts, read.faces) == (
        "wedge",
        ("chock", "doorstop"),
        ("body", "head"),
        (12, 12),
    )
    for own, given in zip(read.shapes, (box(1, 2, 3), box(3, 1, 1)), strict=True):
        np.testing.assert_allclose(own.verts, given.verts, atol=1e-7)
        assert np.array_equal(own.faces, given.faces)
        assert np.array_equal(own.labels, 1 - given.labels)  # the body comes first now


def test_equal_words_have_equal_bytes_in_whatever_order_names_were_given() -> None:
    shape = box()
    other = WordShape(shape.verts, shape.faces, 1 - shape.labels)
    one = word("box", shape, parts=("head", "body"), synonyms=("crate-like", "cube"))
    two = word("box", other, parts=("body", "head"), synonyms=("cube", "crate-like", "cube"))
    assert one.data == two.data
    assert one.sha256 != word("box", shape).sha256


def test_other_programs_read_it_as_safetensors() -> None:
    arrays = load(WEDGE.data)
    assert {name: array.shape for name, array in arrays.items()} == {
        "counts": (2, 2),
        "faces": (24, 3),
        "labels": (24,),
        "verts": (16, 3),
    }


def changed(change: Callable[[dict[str, Any], dict[str, Any]], None]) -> bytes:
    """Return the bytes of a word whose header, and what it says of the word, were changed."""
    length = int.from_bytes(WEDGE.data[:8], "little")
    header = json.loads(WEDGE.data[8 : 8 + length])
    told = json.loads(header["__metadata__"]["word"])
    change(header, told)
    header["__metadata__"]["word"] = json.dumps(told, sort_keys=True, separators=(",", ":"))
    text = json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + WEDGE.data[8 + length :]


def test_a_header_that_nobody_changed_is_as_it_was() -> None:
    assert changed(lambda _header, _told: None) == WEDGE.data


@each_case(
    "change",
    [
        lambda _, told: told.update(noun="../wedge"),
        lambda _, told: told.update(noun="Wedge"),
        lambda _, told: told.update(noun="w" * 41),
        lambda _, told: told.update(synonyms=["doorstop", "chock"]),
        lambda _, told: told.update(synonyms=[f"a{'b' * k}" for k in range(17)]),
        lambda _, told: told.update(parts=["body", "body"]),
        lambda _, told: told.update(parts=["<b>"]),
        lambda _, told: told.update(like=3),
        lambda _, told: told.update(shapes=told["shapes"][:1]),
        lambda _, told: told.update(shapes=[]),
        lambda _, told: told["shapes"][0].update(source="x" * 201),
        lambda _, told: told["shapes"][0].update(source=["x"]),
        lambda _, told: told["shapes"][0].update(sha256="0"),
        lambda _, told: told["shapes"][0].update(command="rm"),
        lambda _, told: told.pop("like"),
        lambda _, told: told.update(note="hidden"),
        lambda header, _: header["verts"].update(shape=[15, 3]),
        lambda header, _: header["verts"].update(shape=[2**40, 3]),
        lambda header, _: header["verts"].update(dtype="F64"),
        lambda header, _: header["faces"].update(shape=[12, 6]),
        lambda header, _: header["labels"].update(data_offsets=[0, 24]),
        lambda header, _: header.update(more={"dtype": "U8", "shape": [0], "data_offsets": [0, 0]}),
        lambda header, _: header.pop("labels"),
        lambda header, _: header["__metadata__"].update(note="hidden"),
    ],
    ids=str,
)
def test_a_header_that_says_otherwise_is_refused(change: Callable[[Any, Any], None]) -> None:
    with pytest.raises(AssetError, match="damaged"):
        Word.read(changed(change))


@each_case("kept", [0, 4, 8, 100, len(WEDGE.data) - 1])
def test_a_file_that_is_cut_short_is_refused(kept: int) -> None:
    with pytest.raises(AssetError):
        Word.read(WEDGE.data[:kept])
    with pytest.raises(AssetError):
        read_words(WEDGE.data[:kept])


def test_what_is_no_word_is_refused_before_anything_of_it_is_read() -> None:
    with pytest.raises(AssetFormatError, match="no word"):
        Word.read((2**60).to_bytes(8, "little") + WEDGE.data[8:])
    with pytest.raises(AssetFormatError, match="no word"):
        Word.read(b"glTF" + bytes(2000))
    with pytest.raises(AssetFormatError, match="meshdeform-word-9"):
        Word.read(changed(lambda header, _: header["__metadata__"].update(format="meshdeform-word-9")))
    with pytest.raises(AssetTooLargeError):
        Word.read(WEDGE.data + bytes(MAX_WORD_BYTES))
    with pytest.raises(AssetError, match="bytes"):
        Word.read(WEDGE.data + b"\0")


def poked(offset_from_end: int, value: bytes) -> Word:
    data = bytearray(WEDGE.data)
    at = len(data) - offset_from_end
    data[at : at + len(value)] = value
    return Word.read(bytes(data))


_VERTS = 16 * 12
_LABELS = _VERTS + 24
_FACES = _LABELS + 24 * 6


@each_case(
    "offset, value, reason",
    [
        (4, np.float32(np.nan).tobytes(), "finite"),
        (_VERTS // 2, bytes(_VERTS // 2), "no area"),
        (8, np.float32(np.inf).tobytes(), "finite"),
        (_VERTS, np.float32(7).tobytes(), "frame"),
        (_LABELS, b"\2", "part"),
        (_FACES, (8).to_bytes(2, "little"), "vertex"),
    ],
)
def test_numbers_out_of_range_are_refused(offset: int, value: bytes, reason: str) -> None:
    word = poked(offset, value)  # its header is as it should be
    with pytest.raises(AssetError, match=reason):
        word.checked()


def test_counts_that_do_not_fit_the_arrays_are_refused() -> None:
    with pytest.raises(AssetError, match="lengths"):
        poked(_FACES + 8, (9).to_bytes(2, "little"))


def test_a_word_has_so_many_shapes_and_faces_and_no_more() -> None:
    shape = box(parts=0)
    with pytest.raises(AssetError, match=f"{MAX_SHAPES + 1} shapes"):
        word("box", *[shape] * (MAX_SHAPES + 1))
    many = WordShape(
        shape.verts, np.tile(shape.faces, (MAX_FACES // 12 + 1, 1)), np.tile(shape.labels, MAX_FACES // 12 + 1)
    )
    with pytest.raises(AssetError, match="faces"):
        word("box", many)
    with pytest.raises(AssetError, match="no shape"):
        write_word("box", [], [ShapeSource("a.glb")])


def test_a_file_of_several_words_has_them_by_the_alphabet() -> None:
    data = joined([WEDGE, BOX])
    assert data == joined([BOX, WEDGE])
    assert read_words(data) == [BOX, WEDGE]
    assert read_words(WEDGE.data) == [WEDGE]
    for wrong in (WEDGE.data + BOX.data, WEDGE.data * 2, b""):
        with pytest.raises(AssetError):
            read_words(wrong)


def test_a_file_of_more_words_than_an_owner_has_is_refused() -> None:
    with pytest.raises(AssetTooLargeError, match=f"more than {MAX_WORDS} words"):
        read_words(WEDGE.data * (MAX_WORDS + 1))
