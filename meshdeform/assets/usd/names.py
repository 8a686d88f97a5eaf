"""Turn an asset's names into prim names, which allow only letters, digits and underscores."""

from __future__ import annotations

import re

__all__ = ["Names"]

_INVALID = re.compile(r"[^A-Za-z0-9_]")
_MAX_LENGTH = 120


class Names:
    """Makes names valid, and unique below each parent."""

    def __init__(self) -> None:
        self._next: dict[tuple[str, str], int] = {}
        self._taken: set[tuple[str, str]] = set()

    def make(self, parent: str, wanted: str, otherwise: str) -> str:
        """Return a name for a new child.

        Parameters
        ----------
        parent : str
            Path of the parent.
        wanted : str
            The asset's name. May be empty or contain any character.
        otherwise : str
            A valid name to use if no valid character of `wanted` remains.

        Returns
        -------
        An ASCII identifier: other characters become underscores, a leading digit gets an underscore before it, and a
        duplicate gets a number.
        """
        name = _INVALID.sub("_", wanted)[:_MAX_LENGTH]
        if not name.strip("_"):
            name = otherwise
        if name[0].isdigit():
            name = f"_{name}"
        made, key = name, (parent, name)
        while (parent, made) in self._taken:
            self._next[key] = self._next.get(key, 0) + 1
            made = f"{name}_{self._next[key]}"
        self._taken.add((parent, made))
        return made
