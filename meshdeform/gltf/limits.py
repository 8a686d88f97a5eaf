"""What an asset may cost: limits that are checked on the JSON before anything is allocated. Pure Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["Limits"]


@dataclass(frozen=True)
class Limits:
    """Upper bounds on one asset; the first four are settings of a deployment.

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
        Values in the JSON (Python objects cost up to 100 times their text), and how deep they nest.
    """

    max_bytes: int = 100 * 2**20
    max_json_bytes: int = 16 * 2**20
    max_accessor_elements: int = 20_000_000
    max_triangles: int = 500_000
    max_bare_elements: int = 250_000
    max_json_values: int = 500_000
    max_json_depth: int = 128

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
        )
