"""What an asset may cost: limits that are checked on the JSON before anything is allocated. Pure Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["CHECK_BASE_BYTES", "CHECK_BYTES_PER_BYTE", "Limits"]

# Address space of a check: what Python, numpy and trimesh map, and a multiple of the file for its arrays.
CHECK_BASE_BYTES = 512 * 2**20
CHECK_BYTES_PER_BYTE = 16


@dataclass(frozen=True)
class Limits:
    """Upper bounds on one asset; those that `from_settings` names are settings of a deployment.

    Attributes
    ----------
    max_bytes : int
        Size of the file, and of what its compressed parts decode to: a compressed asset may not grow larger than
        one that is sent plain.
    max_json_bytes : int
        Size of a GLB's JSON chunk.
    max_accessor_elements : int
        `count` of one accessor.
    max_triangles : int
        Triangles to deform, every instance counted.
    max_bare_elements : int
        `count` of a vertex or index accessor that has no data in the file (its elements are zeros by definition).
    max_json_values, max_json_depth : int
        Values in the JSON (Python objects cost up to 100 times their text), and how deep they nest. They bound how
        many nodes, meshes, materials, images and animations there can be, since each takes two values or more.
    max_primitives : int
        Primitives and their morph targets in the default scene, every instance counted: a few hundred values of
        JSON can show a thousand primitives a thousand times.
    max_chunks : int
        Chunks of a GLB.
    max_memory_bytes : int
        Address space of the process that decodes a file for the first time; a small file gets less.
    max_check_s : float
        Seconds that this may take.
    """

    max_bytes: int = 100 * 2**20
    max_json_bytes: int = 16 * 2**20
    max_accessor_elements: int = 20_000_000
    max_triangles: int = 500_000
    max_bare_elements: int = 250_000
    max_json_values: int = 500_000
    max_json_depth: int = 128
    max_primitives: int = 100_000
    max_chunks: int = 1000
    max_memory_bytes: int = CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * 100 * 2**20
    max_check_s: float = 30.0

    @property
    def max_vertices(self) -> int:
        """Vertices to deform, every instance counted: three per triangle, and as many again a third unreferenced."""
        return 4 * self.max_triangles

    @classmethod
    def from_settings(cls, settings: Settings) -> Self:
        """Return the limits that a deployment's settings name."""
        return cls(
            max_bytes=settings.max_upload_bytes,
            max_json_bytes=settings.max_json_bytes,
            max_accessor_elements=settings.max_accessor_elements,
            max_triangles=settings.max_triangles,
            max_memory_bytes=CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * settings.max_upload_bytes,
        )

    def memory_bytes(self, size: int) -> int:
        """Return the address space in which a file of this many bytes is checked."""
        return min(self.max_memory_bytes, CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * size)
