"""Parse glTF's JSON under limits, and write it with unedited values unchanged. Pure Python."""

from __future__ import annotations

import json
import math
import re
from itertools import accumulate
from typing import Any, NoReturn

from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetTooLargeError

__all__ = ["Json", "clone", "dump_json", "parse_json"]

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
