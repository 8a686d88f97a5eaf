"""What somebody says of a word that is to be made of meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["WordOffer"]


@dataclass(frozen=True)
class WordOffer:
    """What a word is to be.

    `noun`, `synonyms` and `like` as `words.read_name` returns them; `like`: the noun of ours as whose parts its are
    read, or empty, where the first mesh tells. `front_deg`: where all meshes face, from +Z toward +X; `fronts`: where
    some do, by the names of their files. `licence`: of the meshes, in a few words.
    """

    noun: str
    synonyms: tuple[str, ...] = ()
    like: str = ""
    front_deg: float | None = None
    fronts: Mapping[str, float] = field(default_factory=dict)
    licence: str = ""

    def front_of(self, name: str) -> float | None:
        """Return where the mesh of a file faces, if that is said."""
        return self.fronts.get(name, self.front_deg)
