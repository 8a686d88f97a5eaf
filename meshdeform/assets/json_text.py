"""glTF's JSON, read under limits and written so that what nobody touched keeps its own text. Pure Python.

`1.0` stays `1.0` and `0.1000` stays `0.1000`: a value that still equals what its source text says is written as
that text, and a number inside a changed value remembers how it was written.
"""

from __future__ import annotations

import json
import re
from itertools import accumulate
from json.encoder import encode_basestring, encode_basestring_ascii
from typing import Any, NoReturn, Self

from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetTooLargeError

__all__ = ["Json", "SourceFloat", "clone", "dump_json", "parse_json"]

Json = dict[str, Any]

_STRING = re.compile(rb'"[^"]*"')
_NOT_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_DEEPER = {ord("["): 1, ord("{"): 1, ord("]"): -1, ord("}"): -1}
_SPACE = re.compile(r"[ \t\r\n]*")


class SourceFloat(float):
    """A float that remembers the text it was read from."""

    __slots__ = ("text",)
    text: str

    def __new__(cls, text: str) -> Self:
        """Parse the text and keep it."""
        self = super().__new__(cls, text)
        self.text = text
        return self


def parse_json(text: bytes, limits: Limits, *, keep_text: bool = False) -> Json:
    """Parse the JSON of an asset.

    Parameters
    ----------
    text : bytes
        UTF-8; trailing padding is ignored.
    limits : Limits
        `max_json_values` and `max_json_depth` are checked before the parser runs.
    keep_text : bool
        Whether floats become `SourceFloat`; what is written back needs it.

    Raises
    ------
    AssetError
        Not UTF-8, not JSON, not an object, or nested too deeply.
    AssetTooLargeError
        Too many values.
    """
    text = text.rstrip(b"\0 \t\r\n")
    _check_shape(text, limits)
    try:
        root = json.loads(
            text.decode("utf-8"),
            parse_float=SourceFloat if keep_text else float,
            parse_int=_parse_int if keep_text else int,
            parse_constant=_refuse_constant,
        )
    except (ValueError, RecursionError) as error:
        raise AssetError(f"The asset's JSON cannot be parsed: {error}.") from error
    if not isinstance(root, dict):
        raise AssetError("The asset's JSON is not an object.")
    return root


def _check_shape(text: bytes, limits: Limits) -> None:
    bare = _STRING.sub(b"", text.replace(b"\\\\", b"").replace(b'\\"', b""))
    values = sum(map(bare.count, (b",", b":", b"[", b"{")))
    if values > limits.max_json_values:
        raise AssetTooLargeError(f"The asset's JSON has {values} values; the limit is {limits.max_json_values}.")
    brackets = bare.translate(None, _NOT_BRACKETS)
    if max(accumulate(map(_DEEPER.__getitem__, brackets)), default=0) > limits.max_json_depth:
        raise AssetError(f"The asset's JSON nests deeper than {limits.max_json_depth} levels.")


def _parse_int(text: str) -> int | SourceFloat:
    return SourceFloat(text) if text == "-0" else int(text)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def clone(value: Any) -> Any:
    """Return a copy of a JSON value that shares no list and no object with it."""
    if isinstance(value, dict):
        return {key: clone(item) for key, item in value.items()}
    if isinstance(value, list):
        return [clone(item) for item in value]
    return value


def dump_json(root: Json, source: str | None = None) -> bytes:
    """Write JSON; members and array elements that still say the same as in `source` keep their text.

    Parameters
    ----------
    root : dict
        The document to write.
    source : str, optional
        The text that an earlier state of the document was parsed from.
    """
    texts = dict(_members(source)) if source is not None else {}
    members = [f"{_string(key)}:{_splice(value, texts.get(key))}" for key, value in root.items()]
    return ("{" + ",".join(members) + "}").encode("utf-8")


def _splice(value: Any, text: str | None) -> str:
    if text is None:
        return _encode(value)
    if json.loads(text) == value:
        return text
    if isinstance(value, list) and text.startswith("["):
        elements = _elements(text)
        kept = [_splice(item, elements[i] if i < len(elements) else None) for i, item in enumerate(value)]
        return "[" + ",".join(kept) + "]"
    return _encode(value)


def _members(text: str) -> list[tuple[str, str]]:
    """Split a valid JSON object into its keys and the texts of their values."""
    decoder, members = json.JSONDecoder(), []
    at = _skip(text, _skip(text, 0) + 1)
    while text[at] != "}":
        key, at = decoder.raw_decode(text, at)
        start = _skip(text, _skip(text, at) + 1)
        _, end = decoder.raw_decode(text, start)
        members.append((key, text[start:end]))
        at = _next(text, end)
    return members


def _elements(text: str) -> list[str]:
    """Split a valid JSON array into the texts of its elements."""
    decoder, elements = json.JSONDecoder(), []
    at = _skip(text, 1)
    while text[at] != "]":
        _, end = decoder.raw_decode(text, at)
        elements.append(text[at:end])
        at = _next(text, end)
    return elements


def _skip(text: str, at: int) -> int:
    match = _SPACE.match(text, at)
    assert match is not None  # the pattern matches the empty string
    return match.end()


def _next(text: str, at: int) -> int:
    at = _skip(text, at)
    return _skip(text, at + 1) if text[at] == "," else at


def _string(text: str) -> str:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:  # a lone surrogate exists in JSON only as an escape
        return encode_basestring_ascii(text)
    return encode_basestring(text)


def _encode(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ",".join(f"{_string(key)}:{_encode(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(_encode, value)) + "]"
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, SourceFloat):
        return value.text
    return json.dumps(value, allow_nan=False)
