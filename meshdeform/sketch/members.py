"""Make members of a procedural family as files. Importing this needs numpy alone."""

from __future__ import annotations

from collections.abc import Mapping

from meshdeform.assets import Primitive, build_glb
from meshdeform.sketch.families import family_of

__all__ = ["member_glb"]


def member_glb(family: str, values: Mapping[str, object]) -> bytes:
    """Return a member of a family as a GLB, with one node for each of its closed solids.

    Parameters
    ----------
    values : mapping
        Parameters by name; those left out have their default.

    Raises
    ------
    ParameterError
        A name is unknown, or a value is out of range.
    """
    solids = family_of(family).solids(values)
    parts = [Primitive(s.verts, s.faces, name=name, material=family) for name, s in solids.items()]
    return build_glb(parts)
