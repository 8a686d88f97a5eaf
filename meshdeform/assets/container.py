"""Read and write the GLB container: a header, a JSON chunk, a binary chunk and any further chunks. Pure Python.

Source: glTF 2.0 specification, section 4 (GLB File Format Specification).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from mmap import mmap

from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError, AssetTruncatedError

__all__ = ["GLB_MAGIC", "Data", "Layout", "glb_layout", "pack_glb", "padded"]

_JSON = 0x4E4F534A
_BINARY = 0x004E4942
GLB_MAGIC = b"glTF"

Data = bytes | bytearray | memoryview | mmap


@dataclass(frozen=True)
class Layout:
    """The byte ranges of a GLB's chunks in the file."""

    json: slice
    binary: slice | None
    rest: slice  # unknown chunks with their headers, preserved unchanged


def glb_layout(data: Data, limits: Limits) -> Layout:
    """Find the chunks of a GLB and check every length.

    Raises
    ------
    AssetFormatError
        Not a GLB, or not version 2.
    AssetError
        Bytes follow the end, or the first chunk is not JSON.
    AssetTruncatedError
        A length disagrees with the file's size.
    AssetTooLargeError
        The JSON chunk is over its limit.
    """
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

    Parameters
    ----------
    json_text : bytes
        The JSON chunk in UTF-8. Padded with spaces.
    binary : list of bytes-like
        The pieces of the binary chunk, in order. Padded with zeros; without pieces no chunk is written.
    rest : bytes
        Further chunks with their headers, written unchanged.
    """
    json_text += b" " * (-len(json_text) % 4)
    parts: list[bytes | memoryview] = [struct.pack("<II", len(json_text), _JSON), json_text]
    if binary:
        length = sum(len(piece) for piece in binary)
        parts += [struct.pack("<II", padded(length), _BINARY), *binary, b"\0" * (-length % 4)]
    parts.append(rest)
    total = 12 + sum(len(part) for part in parts)
    if total >= 2**32:
        raise AssetTooLargeError("The result has more than 4 GiB, which a GLB cannot hold.")
    return b"".join([struct.pack("<4sII", GLB_MAGIC, 2, total), *parts])
