"""Read Wavefront OBJ; its material libraries are read by `mtl_reader`.

Lines are found, and numbers parsed, for one keyword at a time with numpy, since files have millions of lines.

Source: Wavefront, Object files (.obj); vertex colours after the position, from 0 to 1 as MeshLab and Blender write
them, or from 0 to 255.
"""

from __future__ import annotations

import posixpath
import re
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.archive import Archive
from meshdeform.assets.build import Primitive
from meshdeform.assets.mtl_reader import Libraries, MtlMaterial
from meshdeform.assets.other_formats import plain_text
from meshdeform.assets.polygons import cut_polygons
from meshdeform.errors import AssetError, AssetNotFiniteError, AssetTooLargeError

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_BLANKS = bytes.maketrans(b"\t\v\f\r", b"   \n")
_INDENT = re.compile(rb"\n +")
_CONTINUED = re.compile(rb"^(?! *#)(?:[^\n]*\\\n)+[^\n]*", re.MULTILINE)
_COMMENT = re.compile(rb"(?<= )#[^\n]*")
_NUMBER = re.compile(rb"[-+]?(\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?|[-+]?(inf|infinity|nan)", re.IGNORECASE)
_CORNER = re.compile(rb"[-+]?\d+(/([-+]?\d+)?){0,2}")
_UNREAD = (b"p", b"l", b"curv", b"curv2", b"surf", b"vp")
"""Keywords of points, lines, curves and free-form surfaces."""
_NOT_SMOOTH = ("off", "0", "")
_ELEMENTS = {b"v": ("vertex", 3, 6), b"vt": ("texture coordinate", 1, 2), b"vn": ("normal", 3, 3)}
"""Content of a keyword, and the least and the largest count of its numbers."""


def read_obj(data: bytes, archive: Archive, most_primitives: int) -> tuple[list[Primitive], tuple[str, ...]]:
    """Read an OBJ: white space and line ends of any kind, relative indices, polygons.

    `archive`: holds its material libraries and their textures; `most_primitives`: how many it may have. Returns a
    primitive for each object, group and material, the last one first; and sentences about what became of the file.
    Vertices of a primitive differ in their index of the position, the texture coordinates or the normal. Where only
    some corners have texture coordinates, the others have (0, 0) of the file. Normals are given if all corners have
    them, or smoothing groups. Colours of vertices replace the colour of a material, and a texture that was found
    replaces both.
    """
    lines = _Lines(data)
    tables = {key: _table(lines, key) for key in _ELEMENTS}
    if not (np.abs(tables[b"v"][:, :3]) <= np.finfo(np.float32).max).all():  # NaN compares false
        raise AssetNotFiniteError("The file has vertices that are not finite 32-bit floats.")
    colors = tables[b"v"][:, 3:]
    if not (colors > 1.0).any():  # else they are bytes
        colors *= 255.0
    faces, sizes, corners = _faces(lines)
    if not len(faces):
        return [], ()
    _smooth(lines, tables, faces, sizes, corners)
    cut = cut_polygons(tables[b"v"][corners[:, 0] - 1, :3], sizes)
    groups, states = _groups(lines, faces)
    if len(states) > most_primitives:
        raise AssetTooLargeError(f"The file has {len(states)} primitives; the limit is {most_primitives}.")
    looks, notices = _read_materials(lines, archive)
    if unread := [keyword.decode() for keyword in _UNREAD if len(lines.of(keyword))]:
        notices.append(f"Only faces are read; lines of the OBJ were left out: {', '.join(unread)}.")
    if tables[b"v"].shape[1] == 6 and any(look.texture for look in looks.values()):
        notices.append(
            "The file has textures and colours of vertices: where there is a texture, colours were left out."
        )
    some = np.unique(corners[:, 2] > 0).size > 1
    notices += ["Only some faces have normals. Parts with others have none: viewers show them flat."] * some
    titles: dict[str, None] = {}
    primitives = []
    members = groups[cut.polygons]
    order = np.argsort(members, kind="stable")
    for rows, (*names, material) in zip(
        np.split(order, np.flatnonzero(np.diff(members[order])) + 1), states, strict=True
    ):
        title = _title([*names, material if len(looks) > 1 else ""], titles)
        primitive = _primitive(tables, corners[cut.triangles[rows]], title, looks.get(material), material)
        primitives.append(replace(primitive, polygons=cut.runs(rows)))
    return primitives, (*cut.notices(), *notices)


def linked_libraries(data: bytes) -> list[str]:
    """Return the names that the material libraries of an OBJ may have: a line may list several, or one with spaces."""
    return _Lines(data).libraries()


class _Lines:
    """The lines of an OBJ by their keyword. They have the numbers that an editor shows: line 0 is empty."""

    def __init__(self, data: bytes) -> None:
        text = plain_text(data).replace(b"\r\n", b"\n").translate(_BLANKS)
        text = b"\n%s\n" % text
        if b"\\\n" in text:
            text = _CONTINUED.sub(lambda m: m[0].replace(b"\\\n", b" ") + b"\n" * m[0].count(b"\\\n"), text)
        if b"\n " in text:
            text = _INDENT.sub(b"\n", text)
        self._text = text
        self._bytes = np.frombuffer(text, np.uint8)
        self._begin: _Index = np.concatenate([[0], np.flatnonzero(self._bytes == ord("\n")) + 1])
        self._initial = self._bytes[self._begin[:-1]]

    def of(self, keyword: bytes) -> _Index:
        """Return the numbers (L,) of the lines with a keyword."""
        numbers = np.flatnonzero(self._initial == keyword[0])
        for offset, letter in enumerate(keyword[1:], start=1):
            numbers = numbers[self._bytes[self._begin[numbers] + offset] == letter]
        ended: NDArray[np.bool_] = self._bytes[self._begin[numbers] + len(keyword)] <= ord(" ")
        return numbers[ended]

    def value(self, keyword: bytes, number: int) -> str:
        """Return the rest of a line after its keyword."""
        line = self._text[self._begin[number] + len(keyword) : self._begin[number + 1]]
        return line.decode("utf-8", "replace").strip()

    def libraries(self) -> list[str]:
        """Return the file names that `mtllib` lines may mean."""
        values = [self.value(b"mtllib", number) for number in self.of(b"mtllib").tolist()]
        names = (name.replace("\\", "/") for value in values for name in (value, *value.split()))
        return list(dict.fromkeys(map(posixpath.normpath, names)))

    def words(self, keyword: bytes) -> tuple[bytes, _Index, _Index]:
        """Return the text after a keyword of all its lines, where its words begin, and how many a line has (L,)."""
        numbers = self.of(keyword)
        if not len(numbers):
            return b"", np.zeros(0, np.int64), np.zeros(0, np.int64)
        first, last = numbers[0], numbers[-1] + 1
        chosen = np.zeros(last - first, bool)
        chosen[numbers - first] = True
        length = np.diff(self._begin[first : last + 1])
        text = self._bytes[self._begin[first] : self._begin[last]]
        text = text.copy() if chosen.all() else text[np.repeat(chosen, length)]
        begin = np.cumsum(length[chosen]) - length[chosen]
        for offset in range(len(keyword)):
            text[begin + offset] = ord(" ")
        if (text == ord("#")).any():
            text = np.frombuffer(_COMMENT.sub(b"", text.tobytes()), np.uint8)
        inside = text > ord(" ")
        starts = np.flatnonzero(inside[1:] & ~inside[:-1]) + 1  # the text begins with the blank of a keyword
        counts = np.diff(np.searchsorted(starts, np.flatnonzero(text == ord("\n"))), prepend=0)
        return text.tobytes(), starts, counts

    def unreadable(self, keyword: bytes, pattern: re.Pattern[bytes]) -> AssetError:
        """Return an error about the first word after a keyword that does not fit a pattern."""
        for number, line in zip(self.of(keyword).tolist(), self.words(keyword)[0].split(b"\n"), strict=False):
            for word in line.split():
                if not pattern.fullmatch(word):
                    return _wrong(number, f"{word[:40].decode('utf-8', 'replace')!r} cannot be read")
        return AssetError(f"The {keyword.decode()!r} lines of the OBJ file cannot be read.")


def _wrong(number: int, what: str) -> AssetError:
    return AssetError(f"Line {number} of the OBJ file: {what}.", advice="Export it again, best as .glb.")


def _parse(text: bytes, kind: type[np.generic], count: int) -> NDArray[Any] | None:
    """Return the numbers of a text, or None if they are not `count` numbers."""
    if not count:
        return np.zeros(0, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy warns, and stops, where there is no number
        try:
            values = np.fromstring(text, kind, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    return values if len(values) == count else None


def _table(lines: _Lines, keyword: bytes) -> _Floats:
    """Return the numbers of all lines with a keyword (L, K); of a vertex (L, 3), or (L, 6) with NaN for no colour."""
    what, least, most = _ELEMENTS[keyword]
    text, _, counts = lines.words(keyword)
    values = _parse(text, np.float64, int(counts.sum()))
    if values is None:
        raise lines.unreadable(keyword, _NUMBER)
    for at in np.flatnonzero(counts < least)[:1].tolist():
        raise _wrong(lines.of(keyword)[at], f"a {what} has at least {least} numbers, not {counts[at]}")
    if keyword == b"v" and counts.max(initial=0) < most:
        most = least
    table = np.full((len(counts), most), np.nan if keyword == b"v" else 0.0)
    starts = np.cumsum(counts) - counts
    for column in range(most):
        has = np.flatnonzero(counts > column)
        table[has, column] = values[starts[has] + column]
    return table


def _faces(lines: _Lines) -> tuple[_Index, _Index, _Index]:
    """Return the lines (P,) of faces, how many corners each has, and those (C, 3): v, vt, vn from 1, or 0 for none."""
    text, starts, sizes = lines.words(b"f")
    numbers = lines.of(b"f")
    slashes = np.zeros(len(starts), np.int64)
    if b"/" in text:
        slashes = np.add.reduceat(np.frombuffer(text, np.uint8) == ord("/"), starts, dtype=np.int64)
        for missing, zero in ((b"//", b"/0/"), (b"/ ", b"/0 "), (b"/\n", b"/0\n"), (b"/", b" ")):
            text = text.replace(missing, zero)
    values = _parse(text, np.int64, len(starts) + int(slashes.sum()))
    if values is None or slashes.max(initial=0) > 2:
        raise lines.unreadable(b"f", _CORNER)
    corners = np.zeros((len(starts), 3), np.int64)
    begin = np.cumsum(slashes + 1) - (slashes + 1)
    for column in range(3):
        has = np.flatnonzero(slashes >= column)
        corners[has, column] = values[begin[has] + column]
    for column, (keyword, (what, *_)) in enumerate(_ELEMENTS.items()):
        listed, listed_numbers = lines.of(keyword), corners[:, column].copy()
        if column and not len(listed):  # some exporters number what they leave out
            corners[:, column] = 0
            continue
        if (listed_numbers < 0).any():
            before = np.repeat(np.searchsorted(listed, numbers), sizes)
            corners[:, column] = np.where(listed_numbers < 0, listed_numbers + before + 1, listed_numbers)
        wrong = (corners[:, column] > len(listed)) | ((corners[:, column] < 1) & ((listed_numbers < 0) | (column == 0)))
        for at in np.flatnonzero(wrong)[:1].tolist():
            line = numbers[np.searchsorted(np.cumsum(sizes), at, side="right")]
            raise _wrong(line, f"a face uses {what} {listed_numbers[at]}; the file has {len(listed)}")
    kept = sizes >= 3
    return numbers[kept], sizes[kept], corners[np.repeat(kept, sizes)]


def _smooth(lines: _Lines, tables: dict[bytes, _Floats], faces: _Index, sizes: _Index, corners: _Index) -> None:
    """Give corners without normals those of their smoothing groups, in place; a file without `s` has none.

    In a group, a vertex has the mean of its faces' normals by their area; outside of all, a face has its own.
    """
    numbers = lines.of(b"s")
    rows = np.searchsorted(numbers, faces)
    values = [lines.value(b"s", number).lower() for number in numbers.tolist()]
    named = {name: k for k, name in enumerate(dict.fromkeys(values))}
    groups = np.array([-1, *(-1 if name in _NOT_SMOOTH else named[name] for name in values)])[rows]
    bare = np.repeat(np.logical_or.reduceat(corners[:, 2] == 0, np.cumsum(sizes) - sizes), sizes)
    if not len(numbers) or not bare.any():
        return
    polygons = np.repeat(np.arange(len(faces)), sizes)
    group = groups[polygons]
    keys = np.column_stack([np.where(group < 0, 0, corners[:, 0]), np.where(group < 0, polygons, group), group < 0])
    first, kinds = _distinct(keys)
    normals = np.zeros((len(first), 3))
    crosses = _area_vectors(tables[b"v"][corners[:, 0] - 1, :3], sizes)
    np.add.at(normals, kinds, crosses[polygons])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0.0, normals / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
    corners[bare, 2] = len(tables[b"vn"]) + 1 + kinds[bare]
    tables[b"vn"] = np.concatenate([tables[b"vn"], normals])


def _area_vectors(positions: _Floats, sizes: _Index) -> _Floats:
    """Return twice the area vector (P, 3) of polygons whose corners (C, 3) follow each other."""
    starts = np.cumsum(sizes) - sizes
    following = np.arange(1, len(positions) + 1)
    following[starts + sizes - 1] = starts
    arms = positions - np.repeat(positions[starts], sizes, axis=0)
    return np.asarray(np.add.reduceat(np.cross(arms, arms[following]), starts))


def _groups(lines: _Lines, faces: _Index) -> tuple[_Index, list[tuple[str, ...]]]:
    """Return the group (P,) of each face, the last one first, and the object, group and material of each group."""
    states, columns = [], []
    for keyword in (b"o", b"g", b"usemtl"):
        numbers = lines.of(keyword)
        rows, column = np.unique(np.searchsorted(numbers, faces), return_inverse=True)
        values = [lines.value(keyword, numbers[row - 1]) if row else "" for row in rows.tolist()]
        names = {name: number for number, name in enumerate(dict.fromkeys(values))}
        states.append(list(names))
        columns.append(np.array([names[value] for value in values], np.int64)[column])
    distinct = np.stack(columns, axis=1)
    first, groups = _distinct(distinct)
    order = np.argsort(first)[::-1]
    named = [tuple(names[row] for names, row in zip(states, rows, strict=True)) for rows in distinct[first[order]]]
    return np.argsort(order)[groups], named


def _distinct(rows: _Index) -> tuple[_Index, _Index]:
    """Return the first of each kind of rows (N, K) of small integers, in ascending order, and the kind (N,) of each."""
    key = rows[:, 0]
    for column in rows.T[1:]:
        size = int(column.max(initial=0)) + 1
        if int(key.max(initial=0)) >= 2**62 // size:
            key = np.unique(key, return_inverse=True)[1]
        key = key * size + column
    _, first, kinds = np.unique(key, return_index=True, return_inverse=True)
    return first, kinds


def _title(names: list[str], titles: dict[str, None]) -> str:
    title = start = "_".join(filter(None, names)) or "geometry"
    number = 0
    while title in titles:
        number += 1
        title = f"{start}_{number}"
    titles[title] = None
    return title


def _primitive(
    tables: dict[bytes, _Floats], corners: _Index, title: str, look: MtlMaterial | None, material: str
) -> Primitive:
    """Return a primitive of triangles (T, 3, 3) of v, vt, vn from 1."""
    rows = corners.reshape(-1, 3)
    kept = [True, bool(rows[:, 1].any()), bool(rows[:, 2].all())]
    first, index = _distinct(rows[:, kept])
    v, vt, vn = rows[first].T - 1
    look, material = (look, material) if look else (MtlMaterial(), "")
    colors = None
    if tables[b"v"].shape[1] == 6 and not look.texture:
        values = tables[b"v"][v, 3:]
        if not np.isnan(values).all():
            values = np.where(np.isnan(values).any(axis=1, keepdims=True), 255.0, values)
            colors = np.column_stack([np.clip(values, 0.0, 255.0).round(), np.full(len(v), 255.0)])
            colors = colors.astype(np.uint8)
    base_color = look.shown_color
    if colors is not None and base_color is not None:
        base_color = (1.0, 1.0, 1.0, base_color[3])
    # OBJ counts v upwards, glTF downwards.
    texcoords = np.where(vt[:, None] < 0, 0.0, tables[b"vt"][vt]) * [1.0, -1.0] + [0.0, 1.0] if kept[1] else None
    return Primitive(
        tables[b"v"][v, :3],
        index.reshape(-1, 3),
        normals=tables[b"vn"][vn] if kept[2] else None,
        uvs=texcoords,
        colors=colors,
        name=title,
        material=material,
        base_color=base_color,
        metallic=look.metallic,
        roughness=look.roughness,
        texture=look.texture,
        normal_map=look.normal_map,
        emission=look.shown_emission,
        emission_texture=look.emission_texture,
    )


def _read_materials(lines: _Lines, archive: Archive) -> tuple[dict[str, MtlMaterial], list[str]]:
    """Return the materials that an OBJ uses, as its libraries in the archive describe them, and notices."""
    used = (lines.value(b"usemtl", number) for number in lines.of(b"usemtl").tolist())
    looks = {name: MtlMaterial() for name in used if name}
    reader = Libraries(archive, looks)
    for number in lines.of(b"mtllib").tolist():
        reader.read_line(lines.value(b"mtllib", number))
    return looks, reader.notices()
