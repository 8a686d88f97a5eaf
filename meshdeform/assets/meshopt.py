"""Decode EXT_meshopt_compression and KHR_meshopt_compression in numpy: three bitstreams, and filters.

`assets/compressed.py` finds what is compressed.

Attributes (mode 0, versions 0 and 1): the bytes at one position of all elements are stored together, as differences
from the previous element, in groups of 16 with 1, 2, 4 or 8 bits each; a value of all ones means that a whole byte
follows the group. One pass in Python finds the offset of each group, which depends on the data; all other steps process
all groups at once. Modes 1 and 2 are triangle lists and other index sequences.

Filters expand unit vectors, quaternions, floats and colours from fewer bits; the specification allows one unit in the
last place. Results equal those of meshoptimizer's SIMD code, which viewers and browsers run: the same order of sums,
and halves rounded to even. Only its 8-bit octahedral filter for x86 differs: its reciprocal root is approximate, and
depends on the processor. Ours rounds all inputs exactly.

Source: EXT_meshopt_compression and KHR_meshopt_compression, appendices A (modes 0, 1 and 2) and B (filters 1 to 4).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

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
_MASK = 0xFFFFFFFF
_TABLE_BYTES = 16
_RESERVED_BYTES = 4


def _sentinel_counts(bits: int) -> bytes:
    """Return, for each byte value, how many of its `bits`-wide fields are all ones."""
    ones = (1 << bits) - 1
    return bytes(sum(byte >> shift & ones == ones for shift in range(0, 8, bits)) for byte in range(256))


_SENTINELS = {bits: _sentinel_counts(bits) for bits in (1, 2, 4)}


def decode_attributes(data: bytes, count: int, stride: int) -> Bytes:
    """Decode an attribute stream.

    `data`: the whole stream, header and tail included. `count` and `stride`: number of elements and bytes of each; the
    stride is a multiple of four, at most 256. Returns (count, stride) uint8.
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
    for bits, rows in groups.items():
        _place_groups(stream, end, deltas.reshape(-1), bits, rows)
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
        for byte in range(stride):
            start = byte * row + first
            bits_of = _BITS_V0
            if version:
                _require(len(control) == stride // 4)
                mode = control[byte // 4] >> byte % 4 * 2 & 3
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
        columns = slice(4 * channel, 4 * channel + 4)
        dtype = {0: "<u1", 1: "<u2", 2: "<u4"}.get(int(mode) & 15)
        if dtype is None or (mode >> 4 and mode & 15 != 2):
            raise AssetError(f"A meshopt attribute stream has the unknown channel mode {mode}.")
        words = np.ascontiguousarray(deltas[columns].T).view(dtype)
        first = np.ascontiguousarray(baseline[columns]).view(dtype)
        if mode & 15 == 2:
            by = int(mode) >> 4
            words = words >> np.uint32(by) | words << np.uint32(32 - by) if by else words
            values = np.bitwise_xor.accumulate(np.vstack([first, words]), axis=0)[1:]
        else:
            steps = words >> 1 ^ (0 - (words & 1)).astype(dtype)  # zigzag
            values = (np.cumsum(steps, axis=0, dtype=dtype) + first).astype(dtype)
        elements[:, columns] = values.view(np.uint8).reshape(len(elements), 4)
    return elements


def decode_indices(data: bytes, count: int) -> NDArray[np.uint32]:
    """Decode an index sequence, (count,) uint32. Each index is a difference from one of two running baselines."""
    if len(data) < 1 + count + _RESERVED_BYTES or data[0] != 0xD1:
        raise AssetError("A meshopt index stream is too short, or does not start with its header.")
    stream = np.frombuffer(data, np.uint8, len(data) - 1 - _RESERVED_BYTES, 1)
    ends = np.flatnonzero(stream < 0x80) + 1
    starts = np.concatenate([[0], ends[:-1]])
    lengths = ends - starts
    if len(ends) != count or ends[-1] != len(stream) or lengths.max() > 5:
        raise AssetError("A meshopt index stream has the wrong number of indices.")
    values = np.zeros(count, np.uint64)
    for byte in range(5):
        there = lengths > byte
        values[there] |= (stream[starts[there] + byte] & 0x7F).astype(np.uint64) << np.uint64(7 * byte)
    words = values.astype(np.uint32)
    steps = words >> 2 ^ (0 - (words >> 1 & 1)).astype(np.uint32)  # zigzag
    indices = np.empty(count, np.uint32)
    for baseline in (0, 1):
        chosen = words & 1 == baseline
        indices[chosen] = np.cumsum(steps[chosen], dtype=np.uint32)
    return indices


def decode_triangles(data: bytes, count: int) -> NDArray[np.uint32]:
    """Decode a triangle list, (count,) uint32; count is a multiple of three."""
    triangles = count // 3
    if len(data) < 1 + triangles + _TABLE_BYTES or data[0] != 0xE1:
        raise AssetError("A meshopt triangle stream is too short, or does not start with its header.")
    decoder = _TriangleDecoder(data[1 + triangles : -_TABLE_BYTES], data[-_TABLE_BYTES:])
    try:
        corners = decoder.run(data[1 : 1 + triangles])
    except IndexError:
        raise AssetError("A meshopt triangle stream ends too early.") from None
    if decoder.at != len(decoder.extra) or min(corners, default=0) < 0:
        raise AssetError("A meshopt triangle stream is not valid.")
    return np.array(corners, np.uint32)


class _TriangleDecoder:
    """The state of a triangle stream: the next vertex, and the last 16 edges and vertices."""

    # The FIFOs are ring buffers. Unwritten entries are -1; using one makes the stream invalid.

    def __init__(self, extra: bytes, table: bytes) -> None:
        self.extra = extra
        self.table = table
        self.at = 0
        self.next = 0
        self.last = 0
        self.edges: list[tuple[int, int]] = [(-1, -1)] * 16
        self.edge_end = 0
        self.vertices = [-1] * 16
        self.vertex_end = 0

    def run(self, codes: bytes) -> list[int]:
        corners: list[int] = []
        for code in codes:
            high, low = code >> 4, code & 15
            if high < 15:
                a, b = self.edges[(self.edge_end - 1 - high) & 15]
                c = self._third(low)
            else:
                a, b, c = self._free_triangle(low)
                self._push_edge(b, a)
            self._push_edge(c, b)
            self._push_edge(a, c)
            corners += (a, b, c)
        return corners

    def _third(self, low: int) -> int:
        """Return the third vertex of a triangle on a recent edge."""
        if 0 < low < 13:
            return self.vertices[(self.vertex_end - 1 - low) & 15]
        if low == 0:
            vertex = self._take_next()
        elif low == 15:
            vertex = self._read_index()
        else:
            vertex = self.last = (self.last + (1 if low == 14 else -1)) & _MASK
        self._push_vertex(vertex)
        return vertex

    def _free_triangle(self, low: int) -> tuple[int, int, int]:
        """Return a triangle that shares no recent edge."""
        explicit = low >= 14
        if explicit:
            pair = self.extra[self.at]
            self.at += 1
            if pair == 0:
                self.next = 0
        else:
            pair = self.table[low]
        a = self._read_index() if low == 15 else self._take_next()
        # Look up both before pushing any of the three: the codes refer to the FIFO before this triangle.
        b, b_is_new = self._corner(pair >> 4)
        c, c_is_new = self._corner(pair & 15)
        self._push_vertex(a)
        if b_is_new:
            self._push_vertex(b)
        if c_is_new:
            self._push_vertex(c)
        return a, b, c

    def _corner(self, code: int) -> tuple[int, bool]:
        if code == 0:
            return self._take_next(), True
        if code == 15:
            return self._read_index(), True
        return self.vertices[(self.vertex_end - code) & 15], False

    def _take_next(self) -> int:
        vertex = self.next
        self.next = (vertex + 1) & _MASK
        return vertex

    def _read_index(self) -> int:
        value = 0
        for shift in range(0, 35, 7):
            byte = self.extra[self.at]
            self.at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                break
        else:
            raise IndexError
        value &= _MASK
        self.last = (self.last + (value >> 1 ^ -(value & 1))) & _MASK
        return self.last

    def _push_edge(self, a: int, b: int) -> None:
        self.edges[self.edge_end] = (a, b)
        self.edge_end = (self.edge_end + 1) & 15

    def _push_vertex(self, vertex: int) -> None:
        self.vertices[self.vertex_end] = vertex
        self.vertex_end = (self.vertex_end + 1) & 15


def apply_filter(name: str, elements: Bytes) -> Bytes:
    """Return the filtered elements, in the shape of the input.

    `name`: `NONE`, `OCTAHEDRAL`, `QUATERNION`, `EXPONENTIAL` or `COLOR`; the stride has been checked to fit.
    `elements`, (N, stride) uint8: the decoded attribute stream.
    """
    if name == "NONE":
        return elements
    elements = np.ascontiguousarray(elements)
    # Values that the specification leaves undefined (a scale of zero) must not reject a file that never uses them.
    with np.errstate(all="ignore"):
        filtered = _FILTERS[name](elements)
    return np.ascontiguousarray(filtered).view(np.uint8).reshape(elements.shape)


def _rounded(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Round to the nearest integer, halves to even."""
    return np.nan_to_num(np.rint(values)).astype(np.int32)


def _octahedral(elements: Bytes) -> NDArray[Any]:
    packed = elements.view("<i1" if elements.shape[1] == 4 else "<i2")
    x, y, one = packed[:, :3].T.astype(np.float32)
    z = one - (np.abs(x) + np.abs(y))
    fold = np.minimum(z, np.float32(0.0))
    x, y = x - np.copysign(fold, x), y - np.copysign(fold, y)
    scale = np.float32(np.iinfo(packed.dtype).max) / np.sqrt(x * x + (y * y + z * z))
    unpacked = packed.copy()
    unpacked[:, :3] = _rounded(np.stack([x, y, z], axis=1) * scale[:, None]).astype(packed.dtype)
    return unpacked


def _quaternion(elements: Bytes) -> NDArray[Any]:
    packed = elements.view("<i2")
    scale = (np.float32(1.0) / np.sqrt(np.float32(2.0))) / (packed[:, 3] | 3).astype(np.float32)
    x, y, z = packed[:, :3].T.astype(np.float32) * scale
    largest = np.sqrt(np.maximum(np.float32(1.0) - (x * x + (y * y + z * z)), np.float32(0.0)))
    values = _rounded(np.stack([largest, x, y, z], axis=1) * np.float32(32767.0)).astype("<i2")
    unpacked = np.empty_like(packed)
    columns = ((packed[:, 3] & 3)[:, None] + np.arange(4)) % 4
    np.put_along_axis(unpacked, columns, values, axis=1)
    return unpacked


def _exponential(elements: Bytes) -> NDArray[Any]:
    packed = elements.view("<i4")
    mantissa, exponent = (packed << 8) >> 8, packed >> 24
    return np.asarray(np.ldexp(mantissa.astype(np.float32), exponent), "<f4")


def _color(elements: Bytes) -> NDArray[Any]:
    unsigned, signed = ("<u1", "<i1") if elements.shape[1] == 4 else ("<u2", "<i2")
    luma = elements.view(unsigned)[:, 0].astype(np.int32)
    alpha = elements.view(unsigned)[:, 3].astype(np.int32)
    orange, green = elements.view(signed)[:, 1:3].T.astype(np.int32)
    # The highest set bit of alpha gives the number of bits per component.
    bits = np.frexp(alpha.astype(np.float64))[1]
    full = (np.int32(1) << bits) - 1
    alpha = alpha & full >> 1
    alpha = alpha << 1 | alpha & 1
    rgba = np.stack([luma + orange - green, luma + green, luma - orange - green, alpha], axis=1)
    largest = np.iinfo(unsigned).max
    scaled = _rounded((rgba * (np.float32(largest) / full.astype(np.float32))[:, None]).astype(np.float32))
    return np.clip(scaled, 0, largest).astype(unsigned)


_FILTERS = {"OCTAHEDRAL": _octahedral, "QUATERNION": _quaternion, "EXPONENTIAL": _exponential, "COLOR": _color}
