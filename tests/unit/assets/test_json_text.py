"""JSON that comes back as it was written, within limits."""

from __future__ import annotations

import json

import pytest

from meshdeform.assets.json_text import clone, dump_json, parse_json
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetTooLargeError

LIMITS = Limits()
TEXT = (
    r'{"asset": {"version" : "2.0"}, "a": [1.0, 1, 0.1000, 1e5, 1E+05, -0, -0.0, 12345678901234567890.0],'
    '\n "nodes": [ {"translation": [0.10, 2, 3.0], "extras": {"kept": 1.50}} , {"b": "\\u00e9\\/é"} ], "z": null}'
)


def test_an_unchanged_document_keeps_every_value_as_it_was_written() -> None:
    root = parse_json(TEXT.encode(), LIMITS, keep_text=True)
    written = dump_json(clone(root), TEXT).decode()
    for part in ('"a":[1.0, 1, 0.1000, 1e5, 1E+05, -0, -0.0, 12345678901234567890.0]', r'{"b": "\u00e9\/é"}'):
        assert part in written
    assert json.loads(written) == json.loads(TEXT)
    assert list(json.loads(written)) == ["asset", "a", "nodes", "z"]


def test_numbers_inside_a_changed_value_keep_their_text() -> None:
    root = parse_json(TEXT.encode(), LIMITS, keep_text=True)
    root["nodes"][0]["mesh"] = 7
    written = dump_json(root, TEXT).decode()
    assert '{"translation":[0.10,2,3.0],"extras":{"kept":1.50},"mesh":7}' in written
    assert r'{"b": "\u00e9\/é"}' in written  # its neighbour was not touched


def test_elements_may_be_added_and_removed() -> None:
    text = '{"v": [ 1.0 , 2.00, 3.000 ]}'
    root = parse_json(text.encode(), LIMITS, keep_text=True)
    assert dump_json({"v": [*root["v"], 4]}, text) == b'{"v":[1.0,2.00,3.000,4]}'
    assert dump_json({"v": root["v"][:1], "w": {}}, text) == b'{"v":[1.0],"w":{}}'


def test_a_lone_surrogate_survives() -> None:
    text = r'{"name": "\ud800", "n": 1}'
    root = parse_json(text.encode(), LIMITS, keep_text=True)
    assert json.loads(dump_json(root, None)) == json.loads(text)


def test_duplicate_keys_are_no_crash_and_the_last_one_counts() -> None:
    text = '{"a": 1, "a": [2.50]}'
    root = parse_json(text.encode(), LIMITS, keep_text=True)
    assert dump_json(root, text) == b'{"a":[2.50]}'


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"[]",
        b"nonsense",
        b'{"a": NaN}',
        b'{"a": -Infinity}',
        b'{"a": "\xff"}',
        b'{"a": ' + b"9" * 5000 + b"}",
        b'{"a": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
        b'{"a": ' + b"[" * 100_000,
        b'{"a": ' + b'{"a":' * 100_000,
        b'{"unterminated',
        b'{"a": 1} {"b": 2}',
    ],
)
def test_what_is_not_a_json_object_is_one_clear_error(text: bytes) -> None:
    with pytest.raises(AssetError):
        parse_json(text, LIMITS)


def test_brackets_inside_strings_do_not_count_as_depth() -> None:
    text = json.dumps({"a": "[" * 1000 + '"' + "\\" * 3 + '"{'}).encode()
    assert parse_json(text, Limits(max_json_depth=3))["a"].startswith("[[")


def test_huge_numbers_are_no_crash() -> None:
    root = parse_json(b'{"a": 1e999, "b": -1e999, "c": ' + b"9" * 4000 + b"}", LIMITS, keep_text=True)
    assert b'"a":1e999' in dump_json(root, None)


def test_values_are_counted_before_they_are_made() -> None:
    with pytest.raises(AssetTooLargeError):
        parse_json(b'{"a": [' + b"[]," * 1000 + b"1]}", Limits(max_json_values=1000))
