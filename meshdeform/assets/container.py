"""Read and write the GLB container and its JSON: a header, a JSON chunk, a binary chunk and any further chunks.

The JSON is parsed under limits, and written with unedited values unchanged. A field of a wrong type, or an index out of
range, raises an `AssetError` that names it. An integer written as a float, such as `0.0`, is replaced in the document
by the integer. Pure Python.

Source: glTF 2.0 specification, section 4 (GLB File Format Specification).
"""

from __future__ import annotations

import codecs
import json
import math
import re
import struct
from dataclasses import dataclass
from itertools import accumulate
from mmap import mmap
from typing import Any, NoReturn

from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError, AssetTruncatedError

_JSON = 0x4E4F534A
_BINARY = 0x004E4942
GLB_MAGIC = b"glTF"
Data = bytes | bytearray | memoryview | mmap
Json = dict[str, Any]
_STRING = re.compile(rb'"[^"]*"')
_NOT_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_DEEPER = {ord("["): 1, ord("{"): 1, ord("]"): -1, ord("}"): -1}


@dataclass(frozen=True)
class Layout:
    """The byte ranges of a GLB's chunks in the file."""

    json: slice
    binary: slice | None
    rest: slice  # unknown chunks with their headers, preserved unchanged


def glb_layout(data: Data, limits: Limits) -> Layout:
    """Find the chunks of a GLB and check every length."""
    size = len(data)
    if size < 12:
        raise AssetTruncatedError(f"A GLB starts with a header of 12 bytes; the file has {size}.")
    magic, version, total = struct.unpack("<4sII", bytes(data[:12]))
    if magic != GLB_MAGIC:
        raise AssetFormatError("The file does not start with 'glTF'.")
    if version != 2:
        raise AssetFormatError(
            f"The GLB has version {version}; only version 2 is supported.", advice="Export it again as glTF 2.0."
        )
    if total < size:
        raise AssetError(
            f"The file has {size - total} bytes after the end of the GLB, which its header puts at {total}.",
            advice="Remove the bytes after the end, or export the file again.",
        )
    if total > size:
        raise AssetTruncatedError(f"The GLB's header declares {total} bytes, but the file has {size}.")

    chunks: list[tuple[int, int, int]] = []
    offset = 12
    while offset < size and len(chunks) < 2:
        if offset + 8 > size:
            raise AssetTruncatedError(f"The GLB ends inside the header of chunk {len(chunks)}.")
        length, kind = struct.unpack("<II", bytes(data[offset : offset + 8]))
        start = offset + 8
        if length > size - start:
            raise AssetTruncatedError(
                f"Chunk {len(chunks)} of the GLB declares {length} bytes, but only {size - start} are left in the file."
            )
        if len(chunks) == 1 and kind != _BINARY:
            break
        chunks.append((kind, start, start + length))
        offset = start + length
    if not chunks or chunks[0][0] != _JSON:
        raise AssetError("The first chunk of the GLB is not JSON.")
    _check_rest(data, offset, limits)
    _, start, end = chunks[0]
    if end - start > limits.max_json_bytes:
        raise AssetTooLargeError(
            f"The JSON chunk has {end - start} bytes; the limit is {limits.max_json_bytes} (MESHDEFORM_MAX_JSON_BYTES)."
        )
    binary = slice(*chunks[1][1:]) if len(chunks) > 1 else None
    return Layout(slice(start, end), binary, slice(offset, size))


def _check_rest(data: Data, offset: int, limits: Limits) -> None:
    """Check the lengths of the chunks that are not read: a wrong one means that the file is truncated."""
    size, chunks = len(data), 2
    while offset < size:
        chunks += 1
        if chunks > limits.max_chunks:
            raise AssetTooLargeError(f"The GLB has more than {limits.max_chunks} chunks.", advice="Export it again.")
        if offset + 8 > size:
            raise AssetTruncatedError("The GLB ends inside a chunk's header.")
        (length,) = struct.unpack("<I", bytes(data[offset : offset + 4]))
        if length > size - offset - 8:
            raise AssetTruncatedError(
                f"A chunk of the GLB declares {length} bytes, but only {size - offset - 8} are left."
            )
        offset += 8 + length


def padded(length: int) -> int:
    """Return the length of a chunk after padding to a multiple of four."""
    return length + (-length % 4)


def pack_glb(json_text: bytes, binary: list[bytes | memoryview], rest: bytes) -> bytes:
    """Write a GLB.

    `json_text`: the JSON chunk in UTF-8. Padded with spaces. `binary`: the pieces of the binary chunk, in order. Padded
    with zeros; without pieces no chunk is written. `rest`: further chunks with their headers, written unchanged.
    """
    json_text += b" " * (-len(json_text) % 4)
    chunks: list[bytes | memoryview] = [struct.pack("<II", len(json_text), _JSON), json_text]
    if binary:
        length = sum(len(piece) for piece in binary)
        chunks += [struct.pack("<II", padded(length), _BINARY), *binary, b"\0" * (-length % 4)]
    chunks.append(rest)
    total = 12 + sum(map(len, chunks))
    if total >= 2**32:
        raise AssetTooLargeError("The result has more than 4 GiB, which a GLB cannot hold.")
    return b"".join([struct.pack("<4sII", GLB_MAGIC, 2, total), *chunks])


def parse_json(text: bytes, limits: Limits) -> Json:
    """Parse the JSON of an asset.

    `text`: UTF-8. Trailing padding is ignored. `limits`: `max_json_values` and `max_json_depth` are checked before the
    parser runs.
    """
    text = text.removeprefix(codecs.BOM_UTF8).rstrip(b"\0 \t\r\n")
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
