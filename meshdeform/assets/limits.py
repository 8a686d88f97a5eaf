"""Define the limits on an asset, which are checked on its JSON before anything is allocated. Pure Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from meshdeform.errors import AssetTooLargeError

if TYPE_CHECKING:
    from meshdeform.settings import Settings

# Address space of a check: what Python, numpy and trimesh map, plus a multiple of the file's size for its arrays.
CHECK_BASE_BYTES = 512 * 2**20
CHECK_BYTES_PER_BYTE = 16


@dataclass(frozen=True)
class Limits:
    """Upper bounds on one asset. `from_settings` sets those that a deployment can configure."""

    max_bytes: int = 100 * 2**20
    """Size of the file, and of its compressed data after decoding: a compressed asset may not become larger than an
    uncompressed one."""
    max_json_bytes: int = 16 * 2**20  # size of a GLB's JSON chunk
    max_accessor_elements: int = 20_000_000  # `count` of one accessor
    max_triangles: int = 1_000_000  # triangles to deform, over all instances
    max_bare_elements: int = 250_000
    """`count` of a vertex or index accessor that has no data in the file (its elements are zeros by definition)."""
    # Values in the JSON (Python objects cost up to 100 times their text) and their nesting depth. They also bound the
    # number of nodes, meshes, materials, images and animations, since each takes at least two values.
    max_json_values: int = 500_000
    max_json_depth: int = 128
    max_primitives: int = 50_000
    """Primitives and their morph targets in the default scene, over all instances: a few hundred values of JSON can
    describe a thousand instances of a thousand primitives."""
    max_chunks: int = 1000  # number of chunks in a GLB
    max_archive_files: int = 1000  # entries of a ZIP; together they may unpack to `max_bytes`
    max_memory_bytes: int = CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * 100 * 2**20
    """Address space of the process that first decodes a file. Small files get less."""
    max_check_s: float = 60.0  # seconds that this first decoding may take

    @property
    def max_vertices(self) -> int:
        """Vertices to deform, over all instances: four per triangle, to allow for some that no triangle uses."""
        return 4 * self.max_triangles

    def check_bytes(self, size: int, has: str = "The file has") -> None:
        """Raise AssetTooLargeError for more than `max_bytes`; `has` says what has them."""
        if size > self.max_bytes:
            raise AssetTooLargeError.more_than(self.max_bytes, has)

    @classmethod
    def from_settings(cls, settings: Settings) -> Self:
        """Return the limits given by a deployment's settings."""
        return cls(
            max_bytes=settings.max_upload_bytes,
            max_json_bytes=settings.max_json_bytes,
            max_accessor_elements=settings.max_accessor_elements,
            max_triangles=settings.max_triangles,
            max_memory_bytes=CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * settings.max_upload_bytes,
        )

    @classmethod
    def unlimited(cls) -> Self:
        """Return limits for our own output, which may be larger than an input that passed the real ones."""
        return cls(
            max_bytes=2**40,
            max_json_bytes=2**40,
            max_accessor_elements=2**40,
            max_triangles=2**40,
            max_bare_elements=2**40,
            max_json_values=2**40,
            max_primitives=2**40,
        )

    def memory_bytes(self, size: int) -> int:
        """Return the address space, in bytes, for checking a file of `size` bytes."""
        return min(self.max_memory_bytes, CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * size)
