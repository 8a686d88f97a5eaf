"""Decode mode 0 of meshopt's bitstreams: attributes, versions 0 and 1.

The bytes at one position of all elements are stored together, as differences from the previous element, in groups of
16 with 1, 2, 4 or 8 bits each; a value of all ones means that a whole byte follows the group. One pass in Python finds
the offset of each group, which depends on the data; all other steps process all groups at once.

Source: EXT_meshopt_compression and KHR_meshopt_compression, appendix A, "Mode 0: attributes".
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetError

_GROUP = 16
_ZERO, _BYTES = 0, 8
# Bits per delta for each value of a group's header.
_BITS_V0 = (_ZERO, 2, 4, _BYTES)
_BITS_V1 = ((_ZERO, 1, 2, 4), (1, 2, 4, _BYTES))
_CONTROL_ZERO, _CONTROL_LITERAL = 2, 3
Bytes = NDArray[np.uint8]
Groups = dict[int, list[tuple[int, int]]]  # bits -> (offset in the stream, index of the group's first delta)


def _sentinel_counts(bits: int) -> bytes:
    """Return, for each byte value, how many of its `bits`-wide fields are all ones."""
    ones = (1 << bits) - 1
    return bytes(sum(byte >> shift & ones == ones for shift in range(0, 8, bits)) for byte in range(256))


_SENTINELS = {bits: _sentinel_counts(bits) for bits in (1, 2, 4)}


def decode_attributes(data: bytes, count: int, stride: int) -> Bytes:
    """Decode an attribute stream.

    Parameters
    ----------
    data : bytes
        The whole stream, header and tail included.
    count, stride : int
        Number of elements and bytes of each; the stride is a multiple of four, at most 256.

    Returns
    -------
    (count, stride) uint8

    Raises
    ------
    AssetError
        The stream is not valid.
    """
    version = {0xA0: 0, 0xA1: 1}.get(data[0] if data else -1)
    if version is None:
        raise AssetError("A meshopt attribute stream does not start with its header.")
    tail_size = stride + stride // 4 if version else stride
    padded_tail = max(tail_size, 24 if version else 32)
    end = len(data) - padded_tail
    if end < 1:
        raise AssetError("A meshopt attribute stream is shorter than its tail.")
    tail = np.frombuffer(data, np.uint8, tail_size, len(data) - tail_size)
    deltas = np.zeros((stride, count + -count % _GROUP), np.uint8)
    groups: Groups = {bits: [] for bits in (1, 2, 4, _BYTES)}
    literals = list(_find_groups(data, end, deltas.shape, count, version, groups))
    stream = np.frombuffer(data, np.uint8)
    for bits, found in groups.items():
        _place_groups(stream, end, deltas.reshape(-1), bits, found)
    for offset, start, size in literals:
        deltas.reshape(-1)[start : start + size] = stream[offset : offset + size]
    modes = tail[stride:] if version else np.zeros(stride // 4, np.uint8)
    return _integrate(deltas[:, :count], tail[:stride], modes)


def _find_groups(
    data: bytes, end: int, shape: tuple[int, int], count: int, version: int, groups: Groups
) -> Iterator[tuple[int, int, int]]:
    """Walk the stream, record every group in `groups`, and yield literal ranges: (offset, first delta, size)."""
    stride, row = shape
    block_elements = min(8192 // stride & ~15, 256)
    at = 1
    for first in range(0, count, block_elements):
        elements = min(block_elements, count - first)
        control = data[at : at + stride // 4] if version else b""
        at += len(control)
        for place in range(stride):
            start = place * row + first
            bits_of = _BITS_V0
            if version:
                _require(len(control) == stride // 4)
                mode = control[place // 4] >> place % 4 * 2 & 3
                if mode == _CONTROL_ZERO:
                    continue
                if mode == _CONTROL_LITERAL:
                    _require(at + elements <= end)
                    yield at, start, elements
                    at += elements
                    continue
                bits_of = _BITS_V1[mode]
            at = _find_in_block(data, at, end, start, -(-elements // _GROUP), bits_of, groups)
    _require(at == end)


def _find_in_block(
    data: bytes, at: int, end: int, start: int, count: int, bits_of: tuple[int, ...], groups: Groups
) -> int:
    """Record the groups of one data block and return its end offset."""
    header = at
    at += -(-count // 4)
    _require(at <= end)
    for group in range(count):
        bits = bits_of[data[header + group // 4] >> group % 4 * 2 & 3]
        if bits == _ZERO:
            continue
        groups[bits].append((at, start + group * _GROUP))
        packed = 2 * bits
        at += packed
        if bits != _BYTES:
            at += sum(data[at - packed : at].translate(_SENTINELS[bits]))
        _require(at <= end)
    return at


def _require(good: bool) -> None:
    if not good:
        raise AssetError("A meshopt attribute stream ends too early, or contains more than its elements.")


def _place_groups(stream: Bytes, end: int, deltas: Bytes, bits: int, groups: list[tuple[int, int]]) -> None:
    """Unpack all groups of one width into `deltas`."""
    if not groups:
        return
    offsets, starts = np.array(groups, np.int64).T
    packed = stream[offsets[:, None] + np.arange(2 * bits)]
    values = packed
    if bits != _BYTES:
        # One-bit fields start at the least significant bit of a byte, two- and four-bit fields at the most significant.
        shifts = np.arange(8) if bits == 1 else np.arange(8 - bits, -1, -bits)
        ones = (1 << bits) - 1
        values = (packed[:, :, None] >> shifts.astype(np.uint8) & ones).reshape(len(groups), _GROUP)
        escaped = values == ones
        explicit = offsets[:, None] + 2 * bits + np.cumsum(escaped, axis=1) - 1
        values = np.where(escaped, stream[np.minimum(explicit, end - 1)], values)
    deltas[starts[:, None] + np.arange(_GROUP)] = values


def _integrate(deltas: Bytes, baseline: Bytes, modes: Bytes) -> Bytes:
    """Accumulate the deltas from the baseline element, using each four-byte channel's own mode."""
    elements = np.empty((deltas.shape[1], len(deltas)), np.uint8)
    for channel, mode in enumerate(modes):
        places = slice(4 * channel, 4 * channel + 4)
        dtype = {0: "<u1", 1: "<u2", 2: "<u4"}.get(int(mode) & 15)
        if dtype is None or (mode >> 4 and mode & 15 != 2):
            raise AssetError(f"A meshopt attribute stream has the unknown channel mode {mode}.")
        words = np.ascontiguousarray(deltas[places].T).view(dtype)
        first = np.ascontiguousarray(baseline[places]).view(dtype)
        if mode & 15 == 2:
            words = _rotate_right(words, int(mode) >> 4)
            values = np.bitwise_xor.accumulate(np.vstack([first, words]), axis=0)[1:]
        else:
            steps = words >> 1 ^ (0 - (words & 1)).astype(dtype)  # zigzag
            values = (np.cumsum(steps, axis=0, dtype=dtype) + first).astype(dtype)
        elements[:, places] = values.view(np.uint8).reshape(len(elements), 4)
    return elements


def _rotate_right(words: NDArray[np.uint32], by: int) -> NDArray[np.uint32]:
    return words if by == 0 else words >> np.uint32(by) | words << np.uint32(32 - by)
