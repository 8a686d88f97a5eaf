"""Read STL: text and binary, with the colours of Magics and VisCAM.

Source: 3D Systems, StereoLithography Interface Specification (1988); Materialise Magics: `COLOR=` in the header, and 15
bits for each facet with bit 15 unset; VisCAM and SolidView: 15 bits in the other order with bit 15 set.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.build import Primitive
from meshdeform.assets.notices import rounded_positions
from meshdeform.assets.other_formats import is_ascii_stl, stl_facets
from meshdeform.errors import AssetError, AssetNotFiniteError, AssetTooLargeError

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SOLID = re.compile(rb"^[ \t]*solid\b[ \t]*([^\r\n]*)", re.IGNORECASE | re.MULTILINE)
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_FLAG = 0x8000


def read_stl(data: bytes, most_solids: int) -> tuple[list[Primitive], tuple[str, ...]]:
    """Read the solids of an STL, with sentences about what became of it.

    Corners are not merged, and normals of facets are those that flat shading gives.

    Facets that a binary file has beyond those that it declares are read, other bytes after them are left out.
    """
    if is_ascii_stl(data):
        return _read_text(data, most_solids)
    declared, count = stl_facets(data)
    notices: list[str] = []
    if count > declared:
        notices.append(f"The STL declares {declared} triangles and has {count}: all were read.")
    elif after := len(data) - 84 - 50 * count:
        notices.append(f"{after} bytes after the triangles of the STL are no triangles, and were left out.")
    facets = np.frombuffer(data, _FACET, count, 84)
    corners = facets["corners"].astype(np.float64)
    solid = _primitive(corners, "geometry_0", _colors(data[:80], facets["attribute"]))
    return [solid], (*notices, *rounded_positions(solid.verts))


def _read_text(data: bytes, most_solids: int) -> tuple[list[Primitive], tuple[str, ...]]:
    """Read a text; commas behind numbers are left out, and those in numbers are decimal points."""
    data, commas = _without_commas(data)
    heads = list(_SOLID.finditer(data))
    if len(heads) > most_solids:
        raise AssetTooLargeError(f"The file has {len(heads)} solids; the limit is {most_solids}.")
    ends = [head.start() for head in heads[1:]] + [len(data)]
    primitives = []
    for number, end in enumerate(ends):
        title, start = (heads[number][1], heads[number].end()) if heads else (b"", 0)
        try:
            corners = np.array(_VERTEX.findall(data, start, end), np.float64).reshape(-1, 3, 3)
        except ValueError as error:
            raise AssetError(
                "The STL file has a facet without three corners, or a number that cannot be read.",
                advice="Export it again, best as .glb.",
            ) from error
        if len(corners):
            name = " ".join(title.decode("utf-8", "replace").split())[:100]
            primitives.append(_primitive(corners, name or f"geometry_{number}", None))
    return primitives, commas


def _without_commas(data: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return a text whose numbers have no commas, and a sentence if they were decimal points."""
    first = _VERTEX.search(data)
    if first is None or b"," not in b"".join(first.groups()):
        return data, ()
    if all(word.endswith(b",") for word in first.groups()[:2]):
        return _VERTEX.sub(lambda line: line[0].replace(b",", b" "), data), ()
    text = _VERTEX.sub(lambda line: line[0].replace(b",", b"."), data)
    return text, ("Numbers of the STL have commas, which were read as decimal points.",)


def _primitive(corners: NDArray[np.float64], name: str, colors: NDArray[np.uint8] | None) -> Primitive:
    if not (np.abs(corners) <= np.finfo(np.float32).max).all():  # NaN compares false
        raise AssetNotFiniteError("The file has vertices that are not finite 32-bit floats.")
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    of_corners = None if colors is None else np.repeat(colors, 3, axis=0)
    return Primitive(corners.reshape(-1, 3), faces, colors=of_corners, name=name)


def _colors(header: bytes, attributes: NDArray[Any]) -> NDArray[np.uint8] | None:
    """Return the sRGB colour (F, 3) of each facet; None if the file has none."""
    values = attributes.astype(np.int64)
    bands = np.stack([values & 31, values >> 5 & 31, values >> 10 & 31], axis=1)
    at = header.find(b"COLOR=")
    if at >= 0 and len(header) >= at + 10:  # Magics: red in the lowest bits; bit 15 stands for the colour of the whole
        whole = np.frombuffer(header, np.uint8, 3, at + 6)
        own = (values & _FLAG) == 0
        if (values == 0).all():
            own[:] = False
        colors = np.where(own[:, None], _bytes(bands), whole)
    else:  # VisCAM: blue in the lowest bits; without bit 15 the facet has no colour
        own = (values & _FLAG) != 0
        if not own.any() or values[~own].any():  # other programs store other numbers here
            return None
        colors = np.where(own[:, None], _bytes(bands[:, ::-1]), 255)
    return None if (colors == 255).all() else colors.astype(np.uint8)


def _bytes(bands: NDArray[np.int64]) -> NDArray[np.int64]:
    return (bands * 255 + 15) // 31
