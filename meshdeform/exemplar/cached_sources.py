"""Keep what all fits of one asset need, for the next prompt or seed: in this process, bounded by bytes."""

from __future__ import annotations

import hashlib
from functools import cached_property

from meshdeform.exemplar.choosing import Compared
from meshdeform.exemplar.faults import Faults
from meshdeform.exemplar.fitting import SourceFit
from meshdeform.exemplar.shapes import Shape
from meshdeform.support.recent import Recent

__all__ = ["CachedSource", "cached_source"]

_MOST, _MOST_BYTES = 16, 256 * 2**20
_BYTES_PER_BYTE, _BYTES_OF_MEMBERS = 12, 8 * 2**20
"""What a source takes: by the bytes of its vertices and faces, and for the members that were drawn beside it."""
_recent: Recent[CachedSource] = Recent(_MOST, _MOST_BYTES)


class CachedSource:
    """A source, and what its fits have in common; each is made when it is first asked for.

    `source`: a surface in the frame of its fits; `key`: of all its arrays.
    """

    def __init__(self, source: Shape, key: bytes) -> None:
        self.source, self.key = source, key

    @cached_property
    def faults(self) -> Faults:
        """The check for faults of shapes that the source takes."""
        return Faults(self.source.verts, self.source.faces)

    @cached_property
    def fit(self) -> SourceFit:
        """The fit of the source to goals."""
        return SourceFit(self.source)

    @cached_property
    def compared(self) -> Compared:
        """What it is compared with members by."""
        return Compared(self.source)


def cached_source(source: Shape) -> CachedSource:
    """Return a source with what was computed for it in this process."""
    content = hashlib.blake2b(source.noun.encode())
    for array in (source.verts, source.faces, source.labels):
        content.update(f"{array.shape} {array.dtype}".encode())
        content.update(array.tobytes())
    key = content.digest()
    cached = _recent.get(key)
    if cached is None:
        cached = CachedSource(source, key)
        size = source.verts.nbytes + source.faces.nbytes
        _recent.put(key, cached, _BYTES_PER_BYTE * size + _BYTES_OF_MEMBERS)
    return cached
