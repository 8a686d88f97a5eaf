"""Decode modes 1 and 2 of meshopt's bitstreams: triangle lists and other index sequences.

Source: EXT_meshopt_compression and KHR_meshopt_compression, appendix A, "Mode 1: triangles", "Mode 2: indices".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetError

_MASK = 0xFFFFFFFF
_TABLE_BYTES = 16
_RESERVED_BYTES = 4


def decode_indices(data: bytes, count: int) -> NDArray[np.uint32]:
    """Decode an index sequence, (count,) uint32. Each index is a difference from one of two running baselines.

    Raises
    ------
    AssetError
        The stream is not valid.
    """
    if len(data) < 1 + count + _RESERVED_BYTES or data[0] != 0xD1:
        raise AssetError("A meshopt index stream is too short, or does not start with its header.")
    stream = np.frombuffer(data, np.uint8, len(data) - 1 - _RESERVED_BYTES, 1)
    ends = np.flatnonzero(stream < 0x80) + 1
    starts = np.concatenate([[0], ends[:-1]])
    lengths = ends - starts
    if len(ends) != count or ends[-1] != len(stream) or lengths.max() > 5:
        raise AssetError("A meshopt index stream has the wrong number of indices.")
    values = np.zeros(count, np.uint64)
    for place in range(5):
        there = lengths > place
        values[there] |= (stream[starts[there] + place] & 0x7F).astype(np.uint64) << np.uint64(7 * place)
    words = values.astype(np.uint32)
    steps = words >> 2 ^ (0 - (words >> 1 & 1)).astype(np.uint32)  # zigzag
    indices = np.empty(count, np.uint32)
    for baseline in (0, 1):
        chosen = words & 1 == baseline
        indices[chosen] = np.cumsum(steps[chosen], dtype=np.uint32)
    return indices


def decode_triangles(data: bytes, count: int) -> NDArray[np.uint32]:
    """Decode a triangle list, (count,) uint32; count is a multiple of three.

    Raises
    ------
    AssetError
        The stream is not valid.
    """
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
    """The state of a triangle stream: the next vertex, and the last 16 edges and vertices.

    The FIFOs are ring buffers. Unwritten entries are -1; using one makes the stream invalid.
    """

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
