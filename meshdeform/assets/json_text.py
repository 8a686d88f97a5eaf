"""Parse glTF's JSON under limits, read its fields, and write it with unedited values unchanged. Pure Python.

A field of a wrong type, or an index out of range, raises an `AssetError` that names it. An integer written as a float,
such as `0.0`, is replaced in the document by the integer.
"""

from __future__ import annotations

import json
import math
import re
from itertools import accumulate
from typing import Any, NoReturn

from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetTooLargeError

__all__ = [
    "Json",
    "clone",
    "dump_json",
    "extension",
    "index",
    "integer",
    "member",
    "numbers",
    "objects",
    "parse_json",
    "text",
]


Json = dict[str, Any]

_STRING = re.compile(rb'"[^"]*"')
_NOT_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_DEEPER = {ord("["): 1, ord("{"): 1, ord("]"): -1, ord("}"): -1}


def parse_json(text: bytes, limits: Limits) -> Json:
    """Parse the JSON of an asset.

    Parameters
    ----------
    text : bytes
        UTF-8. Trailing padding is ignored.
    limits : Limits
        `max_json_values` and `max_json_depth` are checked before the parser runs.

    Raises
    ------
    AssetError
        Not UTF-8, not JSON, not an object, nested too deeply, or with a number too large for a double.
    AssetTooLargeError
        Too many values.
    """
    text = text.rstrip(b"\0 \t\r\n")
    _check_shape(text, limits)
    try:
        root = json.loads(text.decode("utf-8"), parse_float=_finite, parse_constant=_refuse_constant)
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


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is too large for a double")
    return number


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def clone(value: Any) -> Any:
    """Return a deep copy of a JSON value."""
    if isinstance(value, dict):
        return {key: clone(item) for key, item in value.items()}
    if isinstance(value, list):
        return [clone(item) for item in value]
    return value


def dump_json(root: Json) -> bytes:
    """Write JSON, keeping values and their order.

    Integers are exact, and a float is the shortest text that reads as the same double.
    """
    try:
        return json.dumps(root, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode("utf-8")
    except UnicodeEncodeError:  # a lone surrogate exists in JSON only as an escape
        return json.dumps(root, separators=(",", ":"), allow_nan=False).encode("ascii")


def objects(parent: Json, key: str, where: str = "") -> list[Json]:
    """Return an array of objects, empty if absent."""
    value = parent.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise AssetError(f"{where}{key} must be an array of objects.")
    return value


def member(parent: Json, key: str, where: str) -> Json:
    """Return an object, empty if absent."""
    value = parent.get(key, {})
    if not isinstance(value, dict):
        raise AssetError(f"{where}.{key} must be an object.")
    return value


def extension(parent: Json, name: str, where: str) -> Json | None:
    """Return an extension's object, or None if absent."""
    extensions = member(parent, "extensions", where)
    return member(extensions, name, f"{where}.extensions") if name in extensions else None


def integer(
    parent: Json, key: str, where: str, *, default: int | None = None, minimum: int = 0, maximum: int = 2**53
) -> int:
    """Return an integer within bounds; without a default it is required."""
    value: Any = _integral(parent, key) if key in parent else default
    if not isinstance(value, int) or isinstance(value, bool) or not minimum <= value <= maximum:
        bounds = f"at least {minimum}" if maximum == 2**53 else f"{minimum} to {maximum}"
        raise AssetError(f"{where}.{key} must be an integer, {bounds}.")
    return value


def index(parent: Json, key: str, count: int, where: str) -> int | None:
    """Return an index into an array of `count` elements, or None if absent."""
    if key not in parent:
        return None
    value = _integral(parent, key)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < count:
        raise AssetError(f"{where}.{key} must be an index below {count}.")
    return value


def indices(parent: Json, key: str, count: int, where: str) -> list[int]:
    """Return an array of indices into an array of `count` elements, empty if absent."""
    value = parent.get(key, [])
    if not isinstance(value, list):
        raise AssetError(f"{where}.{key} must be an array of indices.")
    for at, item in enumerate(value):
        checked = index({key: item}, key, count, where)
        if checked is not item:
            value[at] = checked
    return value


def _integral(parent: Json, key: str) -> Any:
    value = parent[key]
    if isinstance(value, float) and value.is_integer():
        value = parent[key] = int(value)
    return value


def numbers(parent: Json, key: str, length: int | None, where: str) -> list[float] | None:
    """Return an array of finite numbers, or None if absent."""
    if key not in parent:
        return None
    value = parent[key]
    good = isinstance(value, list) and (length is None or len(value) == length)
    if not good or not all(
        isinstance(item, int | float) and not isinstance(item, bool) and abs(item) < 1e300 for item in value
    ):
        raise AssetError(f"{where}.{key} must be an array of {length or ''} finite numbers.".replace("  ", " "))
    return [float(item) for item in value]


def text(parent: Json, key: str, where: str) -> str | None:
    """Return a string, or None if absent."""
    value = parent.get(key)
    if value is not None and not isinstance(value, str):
        raise AssetError(f"{where}.{key} must be a string.")
    return value
