"""Read PLY: text and binary, with polygons, normals, colours of vertices or faces, textures and texture coordinates.

Source: G. Turk, The PLY Polygon File Format (1994); the properties and comments that MeshLab, Blender and programs for
photogrammetry write: `texcoord` lists of faces, `texnumber`, `comment TextureFile NAME`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.archive import Archive, not_found, not_readable
from meshdeform.assets.build import Picture, Primitive
from meshdeform.assets.materials import portable_picture
from meshdeform.assets.notices import rounded_positions
from meshdeform.assets.polygons import Triangulation, cut_polygons
from meshdeform.errors import AssetError, AssetFormatError, AssetNotFiniteError, AssetTruncatedError

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_Bytes = NDArray[np.uint8]

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_MAX_HEADER = 64 * 1024
_TEXTURE = re.compile(r"texture_?file:?\s+(.+)", re.IGNORECASE)
_COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texcoord_u", "texcoord_v"))
_COLOR = ("red", "green", "blue", "alpha")
_INDICES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class PlyElement:
    """The rows of an element."""

    count: int
    columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    """dict of str to (N,) array: its numbers by property, in the type that the header declares."""
    lists: dict[str, tuple[_Index, NDArray[Any]]] = field(default_factory=dict)
    """dict of str to pair of (N,) int64 and (M,) array: the lengths of a property's lists, and their items one after
    the other."""


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    length: str = ""
    """Type of a list's length; empty for a number."""


@dataclass(frozen=True)
class _Header:
    order: str
    comments: list[str]
    elements: list[tuple[str, int, list[_Property]]]
    end: int


def read_ply(data: bytes, archive: Archive) -> tuple[list[Primitive], tuple[str, ...]]:
    """Read the mesh of a PLY.

    `archive`: holds its textures. Returns a primitive, or one for each texture; and sentences about what became of the
    file. Vertices are those of the file, split only where faces have colours or texture coordinates of their own.
    """
    header = _header(data)
    notices: list[str] = []
    elements = _elements(data, header, notices)
    vertex, face = elements.get("vertex", PlyElement(0)), elements.get("face", PlyElement(0))
    if not face.count and "tristrips" in elements:
        face = _of_strips(elements["tristrips"])
    name = next((name for name in _INDICES if name in face.lists), None)
    if name is None:
        return [], ()
    if missing := [axis for axis in "xyz" if axis not in vertex.columns]:
        raise AssetError(f"The vertices of the PLY file have no {missing[0]!r}.", advice="Export it again.")
    positions = np.stack([vertex.columns[axis].astype(np.float64) for axis in "xyz"], axis=1)
    if not (np.abs(positions) <= np.finfo(np.float32).max).all():  # NaN compares false
        raise AssetNotFiniteError("The file has vertices that are not finite 32-bit floats.")
    sizes, corners = face.lists[name][0], face.lists[name][1].astype(np.int64)
    if corners.min(initial=0) < 0 or corners.max(initial=-1) >= len(positions):
        raise AssetError(f"A face uses a vertex that the file does not have; it has {len(positions)}.")
    polygon = np.flatnonzero(sizes >= 3)
    of_polygon = np.repeat(sizes >= 3, sizes)
    cut = cut_polygons(positions[corners[of_polygon]], sizes[polygon])
    faces, triangles = polygon[cut.polygons], np.flatnonzero(of_polygon)[cut.triangles]
    notices += [*cut.notices(), *_left_out(header, vertex)]
    if header.order and vertex.columns["x"].itemsize == 4:
        notices += rounded_positions(positions)
    reader = _Mesh(vertex, face, positions, sizes, corners, _textures(header, archive, notices), notices)
    return list(reader.primitives(faces, triangles, cut)), tuple(notices)


def _left_out(header: _Header, vertex: PlyElement) -> list[str]:
    """Return a sentence about elements and properties that are not read."""
    uvs = next((names for names in _COORDINATES if all(name in vertex.columns for name in names)), ())
    read = {
        "vertex": {*"xyz", "nx", "ny", "nz", *_COLOR, *uvs},
        "face": {*_INDICES, "texcoord", "texnumber", *_COLOR},
        "tristrips": {*_INDICES},
    }
    names = []
    for name, count, properties in header.elements:
        if name not in read:
            names += [name] if count else []
        else:
            names += [f"{name} {each.name}" for each in properties if each.name not in read[name]]
    if not names:
        return []
    listed = ", ".join(name[:40] for name in names[:6]) + (" ..." if len(names) > 6 else "")
    return [f"The PLY file has more than a mesh with colours and textures; left out: {listed}."]


def linked_pictures(data: bytes) -> list[str]:
    """Return the names of the textures of a PLY; none for a file that is no PLY."""
    try:
        comments = _header(data).comments
    except AssetError:
        return []
    return [match[1].strip() for comment in comments if (match := _TEXTURE.match(comment))]


def _textures(header: _Header, archive: Archive, notices: list[str]) -> list[bytes]:
    """Return the encoded textures that the file names; empty ones for those that are not there."""
    names = [match[1].strip() for comment in header.comments if (match := _TEXTURE.match(comment))]
    pictures = [archive.find(name) or b"" for name in names]
    if missing := [name for name, picture in zip(names, pictures, strict=True) if not picture]:
        notices.append(not_found("Textures", missing))
    portable = [portable_picture(picture) if picture else b"" for picture in pictures]
    rows = zip(names, pictures, portable, strict=True)
    if broken := [name for name, picture, readable in rows if picture and not readable]:
        notices.append(not_readable(broken))
    return portable


class _Mesh:
    """The corners of a PLY's faces with what belongs to them."""

    def __init__(
        self,
        vertex: PlyElement,
        face: PlyElement,
        positions: _Floats,
        sizes: _Index,
        corners: _Index,
        textures: list[bytes],
        notices: list[str],
    ) -> None:
        self._vertex, self._face, self._textures = vertex, face, textures
        self._positions, self._corners = positions, corners
        self._normals = None
        if all(name in vertex.columns for name in ("nx", "ny", "nz")):
            self._normals = np.stack([vertex.columns[name].astype(np.float64) for name in ("nx", "ny", "nz")], axis=1)
        self._uvs, self._own_uvs = self._texture_coordinates(sizes, notices)
        colors, of_faces = _colors(vertex.columns), _colors(face.columns)
        pictured = self._uvs is not None and any(textures)
        if pictured and (colors is not None or of_faces is not None):
            notices.append("The file has a texture and colours: the colours were left out.")
            colors = of_faces = None
        if colors is not None and of_faces is not None:
            notices.append("The file has colours of vertices and of faces: those of faces were left out.")
            of_faces = None
        self._colors, self._face_colors = colors, of_faces

    def primitives(self, faces: _Index, triangles: _Index, cut: Triangulation) -> Iterator[Primitive]:
        """Yield the primitives of triangles (T, 3) of corners, in faces (T,)."""
        number = np.zeros(len(faces), np.int64)
        if len(self._textures) > 1 and "texnumber" in self._face.columns:
            number = self._face.columns["texnumber"].astype(np.int64)[faces]
        for texture in np.unique(number).tolist():
            some = np.flatnonzero(number == texture)
            picture = self._textures[texture] if 0 <= texture < len(self._textures) else b""
            yield replace(self._primitive(faces[some], triangles[some], picture, texture), polygons=cut.runs(some))

    def _primitive(self, faces: _Index, triangles: _Index, picture: bytes, texture: int) -> Primitive:
        corners = triangles.reshape(-1)
        vertices, rows = self._corners[corners], np.arange(len(corners))
        own = [vertices.astype(np.float64)]
        if self._own_uvs and self._uvs is not None:
            own += list(self._uvs[corners].T)
        if self._face_colors is not None:
            own += list(self._face_colors[np.repeat(faces, 3)].T)
        if len(own) > 1:
            _, rows, index = np.unique(np.stack(own, axis=1), axis=0, return_index=True, return_inverse=True)
            vertices, index = vertices[rows], index.reshape(-1, 3)
        else:  # as in the file, with those that no face uses
            vertices, index = np.arange(len(self._positions)), vertices.reshape(-1, 3)
        uvs = self._uvs
        if uvs is not None:
            uvs = (uvs[corners[rows]] if self._own_uvs else uvs[vertices]) * [1.0, -1.0] + [0.0, 1.0]
        colors = None if self._colors is None else self._colors[vertices]
        if self._face_colors is not None:
            colors = self._face_colors[np.repeat(faces, 3)[rows]]
        return Primitive(
            self._positions[vertices],
            index,
            normals=None if self._normals is None else self._normals[vertices],
            uvs=uvs,
            colors=colors,
            name=f"geometry_{texture}",
            material=f"texture_{texture}" if picture else "",
            texture=Picture(picture) if picture else None,
        )

    def _texture_coordinates(self, sizes: _Index, notices: list[str]) -> tuple[_Floats | None, bool]:
        """Return texture coordinates (K, 2), v upwards, and whether they are those of corners, not of vertices."""
        if (listed := self._face.lists.get("texcoord")) is not None:
            if (listed[0] == 2 * sizes).all():
                return listed[1].astype(np.float64).reshape(-1, 2), True
            notices.append("Some faces have no texture coordinates, or too many: all were left out.")
        for names in _COORDINATES:
            if all(name in self._vertex.columns for name in names):
                return np.stack([self._vertex.columns[name].astype(np.float64) for name in names], axis=1), False
        return None, False


def _colors(columns: Mapping[str, NDArray[Any]]) -> NDArray[Any] | None:
    """Return sRGB colours (N, 4) of bytes; numbers that are no bytes are taken as 0 .. 1."""
    if not all(name in columns for name in _COLOR[:3]):
        return None
    bands = []
    for name in _COLOR:
        band = columns.get(name, np.full(len(columns["red"]), 255, np.uint8))
        if band.dtype.kind == "f":
            band = np.clip(np.nan_to_num(band.astype(np.float64)) * 255.0, 0.0, 255.0).round()
        elif band.dtype.itemsize > 1:
            band = band.astype(np.float64) * (255.0 / np.iinfo(band.dtype).max)
        bands.append(band.astype(np.uint8))
    return np.stack(bands, axis=1)


def read_elements(data: bytes) -> dict[str, PlyElement]:
    """Return the elements of a PLY by name."""
    return _elements(data, _header(data), [])


def _of_strips(strips: PlyElement) -> PlyElement:
    """Return the triangles of strips of vertices, which -1 ends; every second one is turned, and flat ones are none."""
    name = next((name for name in _INDICES if name in strips.lists), None)
    if name is None:
        return PlyElement(0)
    sizes, items = strips.lists[name]
    corners = np.insert(items.astype(np.int64), np.cumsum(sizes)[:-1], -1)
    number, ended = np.arange(len(corners)), corners < 0
    start = np.maximum.accumulate(np.where(ended, number + 1, 0))
    first = np.flatnonzero(~(ended[:-2] | ended[1:-1] | ended[2:]))
    triangles = np.stack([corners[first + k] for k in range(3)], axis=1)
    turned = (first - start[first]) % 2 == 1
    triangles[turned] = triangles[turned][:, [1, 0, 2]]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    return PlyElement(len(triangles), lists={name: (np.full(len(triangles), 3), triangles.reshape(-1))})


def _header(data: bytes) -> _Header:
    head = data[:_MAX_HEADER]
    match = re.search(rb"(?:^|[\r\n])[ \t]*end_header[ \t]*(\r\n|\n|\r)", head)
    if not head.startswith(b"ply") or match is None:
        raise AssetTruncatedError("The PLY file has no end_header.")
    order, comments, elements = None, list[str](), list[tuple[str, int, list[_Property]]]()
    for line in head[: match.start()].decode("utf-8", "replace").splitlines()[1:]:
        keyword, _, rest = line.strip().partition(" ")
        words = rest.split()
        try:
            if keyword == "format":
                order = _ORDERS[words[0]]
            elif keyword in {"comment", "obj_info"}:
                comments.append(rest.strip())
            elif keyword == "element":
                elements.append((words[0], int(words[1]), []))
            elif keyword == "property" and words[0] == "list":
                elements[-1][2].append(_Property(words[3], _TYPES[words[2]], _TYPES[words[1]]))
            elif keyword == "property":
                elements[-1][2].append(_Property(words[1], _TYPES[words[0]]))
        except (IndexError, KeyError, ValueError) as error:
            raise AssetFormatError(f"A line of the PLY header cannot be read: {line.strip()[:80]!r}.") from error
    if order is None:
        raise AssetFormatError("The PLY header has no format.")
    left = len(data) - match.end()
    for name, count, properties in elements:  # each number takes a byte at least, so that no header asks for memory
        if count < 0 or count * len(properties) > left:
            raise _truncated(name)
    return _Header(order, comments, [each for each in elements if each[2]], match.end())


def _elements(data: bytes, header: _Header, notices: list[str]) -> dict[str, PlyElement]:
    return dict(_binary(data, header)) if header.order else _text(data, header, notices)


def _truncated(name: str) -> AssetTruncatedError:
    return AssetTruncatedError(f"The PLY file ends before the last {name!r}, or has a number that cannot be read.")


def _text(data: bytes, header: _Header, notices: list[str]) -> dict[str, PlyElement]:
    """Read a text as one sequence of numbers; where that does not end with the file, line by line."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy warns, and stops, where there is no number
        try:
            values = np.fromstring(data[header.end :], np.float64, sep=" ")
        except (DeprecationWarning, ValueError) as error:
            raise AssetError("The PLY file has a number that cannot be read.", advice="Export it again.") from error
    elements, fault = None, None
    try:
        elements, end = _in_sequence(values, header)
        if end == len(values):
            return elements
    except AssetTruncatedError as error:
        fault = error
    by_line = _by_line(data[header.end :], values, header)
    if by_line is None and fault is not None:
        raise fault
    notices.append("The PLY file has more numbers than its header declares; what they might be was left out.")
    return by_line or elements or {}


def _in_sequence(values: _Floats, header: _Header) -> tuple[dict[str, PlyElement], int]:
    """Return the elements, and where the last one ends."""
    elements, at = {}, 0
    for name, count, properties in header.elements:
        starts, end = _starts(values, at, name, count, properties)
        elements[name], _ = _rows(values, starts, np.full(count, len(values)), name, properties)
        at = end
    return elements, at


def _by_line(body: bytes, values: _Floats, header: _Header) -> dict[str, PlyElement] | None:
    """Return elements whose rows are lines; None if they are not. Numbers after a list that was not declared so go."""
    letters = np.frombuffer(body, np.uint8)
    inside = letters > ord(" ")
    first = inside & ~np.concatenate([[False], inside[:-1]])
    line = np.cumsum(letters == ord("\n"))[first]
    lengths = np.bincount(line) if len(line) == len(values) else np.zeros(0, np.int64)
    lengths = lengths[lengths > 0]
    if len(lengths) < sum(count for _, count, _ in header.elements):
        return None
    ends = np.cumsum(lengths)
    elements, row = {}, 0
    for name, count, properties in header.elements:
        own = ends[row : row + count]
        try:
            element, read = _rows(values, own - lengths[row : row + count], own, name, properties)
        except AssetTruncatedError:
            return None
        doubtful = bool(element.lists) and bool((read != own).any())
        elements[name] = replace(element, columns={}) if doubtful else element
        row += count
    return elements


def _typed(values: _Floats, kind: str) -> NDArray[Any]:
    """Return numbers of a text in the type that they are declared in; floats stay as precise as they were written."""
    if kind.startswith("f"):
        return values
    limits = np.iinfo(kind)
    return np.clip(np.nan_to_num(values), limits.min, limits.max).astype(kind)


def _starts(values: _Floats, at: int, name: str, count: int, properties: list[_Property]) -> tuple[_Index, int]:
    """Return where each row of an element begins, and where the last one ends."""
    first = _row_lengths(values, at, properties) if count else []
    length = sum(first)
    starts, end = at + length * np.arange(count), at + count * length
    regular, offset = end <= len(values), 0
    for each, size in zip(properties, first, strict=False):
        regular = regular and (not each.length or bool((values[starts + offset] == size - 1).all()))
        offset += size
    return (starts, end) if regular else _walk(values, at, name, count, properties)


def _rows(
    values: _Floats, starts: _Index, ends: _Index, name: str, properties: list[_Property]
) -> tuple[PlyElement, _Index]:
    """Read rows that begin at `starts` and do not pass `ends`, one property of all of them at once; and say how far."""
    element, at = PlyElement(len(starts)), starts
    for each in properties:
        if (at >= ends).any():
            raise _truncated(name)
        if not each.length:
            element.columns[each.name] = _typed(values[at], each.type)
            at = at + 1
            continue
        lengths_given = values[at]
        if not ((lengths_given >= 0) & (lengths_given <= ends - at - 1)).all():
            raise _truncated(name)
        sizes = lengths_given.astype(np.int64)
        flat = np.repeat(at + 1 - (np.cumsum(sizes) - sizes), sizes) + np.arange(int(sizes.sum()))
        element.lists[each.name] = sizes, _typed(values[flat], each.type)
        at = at + 1 + sizes
    return element, at


def _row_lengths(values: _Floats, at: int, properties: list[_Property]) -> list[int]:
    """Return how many numbers each property takes in the row that begins here."""
    lengths = []
    for each in properties:
        size = 1
        if each.length and at < len(values) and 0 <= values[at] < len(values):
            size += int(values[at])
        lengths.append(size)
        at += size
    return lengths


def _walk(values: _Floats, at: int, name: str, count: int, properties: list[_Property]) -> tuple[_Index, int]:
    """Return where each row begins, and where the last one ends."""
    starts = np.empty(count, np.int64)
    for row in range(count):
        starts[row] = at
        for each in properties:
            if at >= len(values):
                raise _truncated(name)
            if each.length:
                size = values[at]
                if not 0 <= size <= len(values) - at - 1:
                    raise _truncated(name)
                at += int(size)
            at += 1
    if at > len(values):
        raise _truncated(name)
    return starts, at


def _binary(data: bytes, header: _Header) -> Iterator[tuple[str, PlyElement]]:
    at, whole = header.end, np.frombuffer(data, np.uint8)
    for name, count, properties in header.elements:
        lengths = _lengths_of_first(data, at, header.order, properties) if count else [0] * len(properties)
        row = np.dtype(
            [
                (f"p{k}", [("n", header.order + each.length), ("x", header.order + each.type, (size,))])
                if each.length
                else (f"p{k}", header.order + each.type)
                for k, (each, size) in enumerate(zip(properties, lengths, strict=True))
            ]
        )
        end = at + count * row.itemsize
        if end <= len(data):
            rows = np.frombuffer(data, row, count, at)
            lists = [(k, size) for k, (each, size) in enumerate(zip(properties, lengths, strict=True)) if each.length]
            if all((rows[f"p{k}"]["n"] == size).all() for k, size in lists):
                element = PlyElement(count)
                for k, (each, size) in enumerate(zip(properties, lengths, strict=True)):
                    column = rows[f"p{k}"]
                    if each.length:
                        element.lists[each.name] = np.full(count, size, np.int64), _native(column["x"]).reshape(-1)
                    else:
                        element.columns[each.name] = _native(column)
                yield name, element
                at = end
                continue
        if not any(each.length for each in properties):
            raise _truncated(name)
        element, at = _ragged_binary(whole, at, header.order, name, count, properties)
        yield name, element


def _native(values: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(values.astype(values.dtype.newbyteorder("=")))


def _lengths_of_first(data: bytes, at: int, order: str, properties: list[_Property]) -> list[int]:
    """Return the lengths of the lists in the first row; 0 for a number, or where the file ends."""
    lengths = []
    for each in properties:
        size, kind = 0, np.dtype(order + (each.length or each.type))
        if each.length and at + kind.itemsize <= len(data):
            size = int(np.frombuffer(data, kind, 1, at)[0])
            size = size if 0 <= size <= len(data) else 0
        at += kind.itemsize + size * np.dtype(each.type).itemsize
        lengths.append(size)
    return lengths


def _ragged_binary(
    whole: _Bytes, at: int, order: str, name: str, count: int, properties: list[_Property]
) -> tuple[PlyElement, int]:
    """Read rows with lists of several lengths: find where each begins, then read each property of all rows at once."""
    steps = [
        (bool(each.length), np.dtype(order + (each.length or each.type)), np.dtype(order + each.type).itemsize)
        for each in properties
    ]
    offsets = np.empty((len(properties), count), np.int64)
    sizes = np.ones((len(properties), count), np.int64)
    data, total = whole.tobytes(), len(whole)
    signed = [kind.kind == "i" for _, kind, _ in steps]
    byteorder: Literal["little", "big"] = "big" if order == ">" else "little"
    for row in range(count):
        for k, (listed, kind, width) in enumerate(steps):
            if at + kind.itemsize > total:
                raise _truncated(name)
            if listed:
                size = int.from_bytes(data[at : at + kind.itemsize], byteorder, signed=signed[k])
                if size < 0 or at + kind.itemsize + size * width > total:
                    raise _truncated(name)
                sizes[k, row] = size
                at += kind.itemsize
                offsets[k, row] = at
                at += size * width
            else:
                offsets[k, row] = at
                at += width
    element = PlyElement(count)
    for k, each in enumerate(properties):
        kind = np.dtype(order + each.type)
        begin = np.repeat(offsets[k] - kind.itemsize * (np.cumsum(sizes[k]) - sizes[k]), sizes[k])
        begin += kind.itemsize * np.arange(int(sizes[k].sum()))
        flat = _native(whole[begin[:, None] + np.arange(kind.itemsize)].reshape(-1).view(kind))
        if each.length:
            element.lists[each.name] = sizes[k], flat
        else:
            element.columns[each.name] = flat
    return element, at
