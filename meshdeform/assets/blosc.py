"""Unpack Blosc chunks whose compressor is LZ4, the only one that OpenVDB writes. Pure Python and numpy.

A level set is thousands of chunks of at most 2 kB each, so a library would save little; what is here reads no byte
outside a chunk and writes no more than was asked for, whatever the chunk says.

Source: the Blosc 1 chunk format (Blosc, README_HEADER) and the LZ4 block format (Collet, lz4_Block_format).
"""

from __future__ import annotations

import struct

import numpy as np

__all__ = ["unpack_blosc"]

_HEADER = struct.Struct("<4B3I")
_SHUFFLED, _STORED, _BITS_SHUFFLED, _WHOLE_BLOCKS, _LZ4 = 1, 2, 4, 16, 1
_MOST_STREAMS, _SHORTEST_STREAM = 16, 128


def unpack_blosc(chunk: bytes, size: int) -> bytes:
    """Return the `size` bytes that a chunk holds.

    Raises
    ------
    ValueError
        The chunk is damaged, holds another number of bytes, or was made by another compressor.
    """
    try:
        return _unpack(chunk, size)
    except (IndexError, struct.error) as error:
        raise ValueError("a Blosc chunk ends early") from error


def _unpack(chunk: bytes, size: int) -> bytes:
    _, _, flags, width, whole, block, packed = _HEADER.unpack_from(chunk)
    if whole != size or packed != len(chunk):
        raise ValueError("a Blosc chunk of another size")
    if flags & _STORED:
        if len(chunk) != _HEADER.size + size:
            raise ValueError("a Blosc chunk of another size")
        return chunk[_HEADER.size :]
    if flags & _BITS_SHUFFLED or flags >> 5 != _LZ4 or not block or not width:
        raise ValueError("a Blosc chunk of another compressor")
    out = bytearray()
    for number in range(-(-size // block)):
        (at,) = struct.unpack_from("<I", chunk, _HEADER.size + 4 * number)
        length = min(block, size - number * block)
        split = length == block and not flags & _WHOLE_BLOCKS and width <= _MOST_STREAMS
        streams = width if split and block // width >= _SHORTEST_STREAM else 1
        if length % streams:
            raise ValueError("a Blosc chunk of broken streams")
        found = bytearray()
        for _ in range(streams):
            (step,) = struct.unpack_from("<I", chunk, at)
            stream = chunk[at + 4 : at + 4 + step]
            if len(stream) != step:
                raise ValueError("a Blosc chunk ends early")
            found += stream if step == length // streams else _unpack_lz4(stream, length // streams)
            at += 4 + step
        out += _unshuffled(bytes(found), width) if flags & _SHUFFLED else found
    return bytes(out)


def _unshuffled(data: bytes, width: int) -> bytes:
    """Return bytes whose elements of `width` were stored first bytes first; a rest that fills none stays."""
    whole = len(data) // width * width
    return np.frombuffer(data[:whole], np.uint8).reshape(width, -1).T.tobytes() + data[whole:]


def _unpack_lz4(data: bytes, size: int) -> bytearray:
    out, at = bytearray(), 0
    while True:
        token = data[at]
        at += 1
        length = token >> 4
        if length == 15:
            while data[at] == 255:
                length += 255
                at += 1
            length += data[at]
            at += 1
        out += data[at : at + length]
        at += length
        if at >= len(data):
            break
        back = data[at] | data[at + 1] << 8
        at += 2
        length = token & 15
        if length == 15:
            while data[at] == 255:
                length += 255
                at += 1
            length += data[at]
            at += 1
        length += 4
        first = len(out) - back
        if not back or first < 0 or length > size - len(out):
            raise ValueError("a broken LZ4 stream")
        if back >= length:
            out += out[first : first + length]
        else:  # the match overlaps what it writes, so it repeats
            out += (out[first:] * (length // back + 1))[:length]
    if at != len(data) or len(out) != size:
        raise ValueError("a broken LZ4 stream")
    return out
