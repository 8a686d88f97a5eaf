"""Read a level set from an OpenVDB file into a dense grid. numpy only.

A tree of blocks: a root without bounds, nodes of 32^3 and 16^3 entries, and leaves of 8^3 voxels. An entry is a child
or a tile, one value for all of its voxels. Values stand at integer coordinates, which the grid's map takes to world
ones.

Only what current files have is read: version 224 of the format (OpenVDB 4, 2016, to 12 and later), the tree 5-4-3 of
floats, halves or doubles, stored plainly, by zlib or by Blosc. Nothing is guessed: a grid that does not end where its
header says is refused.

Source: OpenVDB (Museth 2013, VDB: High-Resolution Sparse Volumes with Dynamic Topology), file format version 224.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.blosc import unpack_blosc
from meshdeform.assets.other_formats import LEVEL_SET_MAGIC
from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError, AssetTruncatedError

__all__ = ["read_level_set"]

_Floats = NDArray[np.float64]
_Bools = NDArray[np.bool_]

_VERSION = 224
_ZIP, _ACTIVE, _BLOSC = 1, 2, 4
# How the values of a node's inactive entries are stored, where only its active ones are.
_MINUS_BACKGROUND, _ONE, _MASK, _MASK_ONE, _MASK_TWO, _ALL = 1, 2, 3, 4, 5, 6
_MOST_GRIDS = 1000
_MOST_NODES = 512
_MARGIN = 2
_TOO_LARGE = "Resample the level set with larger voxels, or send one with another box."
_TYPES: dict[str, np.dtype[Any]] = {"Tree_float_5_4_3": np.dtype("<f4"), "Tree_double_5_4_3": np.dtype("<f8")}
_HALF = "_HalfFloat"


class _Cursor:
    """Reads numbers and bytes in turn; what is missing is an error."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, size: int) -> bytes:
        found = self.data[self.at : self.at + size]
        if size < 0 or len(found) != size:
            raise AssetTruncatedError("The OpenVDB file is damaged or incomplete.")
        self.at += size
        return found

    def numbers(self, form: str) -> tuple[Any, ...]:
        packed = struct.Struct("<" + form)
        return packed.unpack(self.take(packed.size))

    def number(self, form: str) -> Any:
        return self.numbers(form)[0]

    def text(self) -> str:
        return self.take(self.number("I")).decode("utf-8", "replace")

    def mask(self, bits: int) -> _Bools:
        return np.unpackbits(np.frombuffer(self.take(bits // 8), np.uint8), bitorder="little").astype(np.bool_)

    def metadata(self) -> dict[str, bytes]:
        found = {}
        for _ in range(self.number("I")):
            name, _type = self.text(), self.text()
            found[name] = self.take(self.number("I"))
        return found


@dataclass
class _Grid:
    """A grid of the file, whose tree begins at `tree`, after its metadata and its map."""

    name: str
    kind: str
    shared: bool
    sort: str
    compression: int
    axes: tuple[_Floats, _Floats] | None
    tree: int
    end: int


@dataclass
class _Tree:
    """Tiles and leaves in the order of the file."""

    dtype: np.dtype[Any]
    half: bool
    compression: int
    background: float = 0.0
    tiles: list[tuple[NDArray[np.int64], int, _Floats, _Bools]] = field(default_factory=list)
    origins: list[NDArray[np.int64]] = field(default_factory=list)
    nodes: int = 0


@np.errstate(all="ignore")  # a damaged file may have any number
def read_level_set(data: bytes, most_values: int) -> tuple[_Floats, _Floats, _Floats]:
    """Return the values (X, Y, Z), the place of the first, and the spacing (3,) of the one level set of a file.

    Beyond the band around the surface, values are what the file has there: a constant of the side's sign.

    Raises
    ------
    AssetError
        No level set or several, a map that turns or shears, more than `most_values` in the box around its band, or
        a file that is damaged or of another version.
    """
    cursor = _Cursor(data)
    grid = _chosen(_grids(cursor))
    half = grid.kind.endswith(_HALF)
    cursor.at = grid.tree
    tree = _Tree(_TYPES[grid.kind.removesuffix(_HALF)], half, grid.compression)
    try:
        _read_topology(cursor, tree)
        origins = np.concatenate(tree.origins) if tree.origins else np.zeros((0, 3), np.int64)
        if len(origins) > most_values // 256:
            raise _too_large(len(origins) * 512, most_values)
        masks = np.zeros((len(origins), 512), np.bool_)
        blocks = np.zeros((len(origins), 512))
        for i in range(len(origins)):
            masks[i] = cursor.mask(512)
            blocks[i] = _read_values(cursor, tree, masks[i])
    except (ValueError, zlib.error) as error:
        raise AssetTruncatedError("The OpenVDB file is damaged or incomplete.") from error
    if cursor.at != grid.end:
        raise AssetTruncatedError("The OpenVDB file is damaged or incomplete.", advice="Write it again.")
    low, high = _box(tree, origins, masks)
    shape = high - low
    if np.prod(shape.astype(np.float64)) > most_values:
        raise _too_large("x".join(map(str, shape)), most_values)
    values = np.full(shape, tree.background)
    for places, size, found, _ in tree.tiles:
        near = ((places < high) & (places + size > low)).all(1)
        for place, value in zip(places[near], found[near], strict=True):
            values[_within(place - low, size)] = value
    for place, block in zip(origins - low, blocks.reshape(-1, 8, 8, 8), strict=True):
        skipped = np.maximum(-place, 0)
        if (skipped < 8).all():
            part = values[_within(place, 8)]
            x, y, z = skipped
            part[:] = block[x : x + part.shape[0], y : y + part.shape[1], z : z + part.shape[2]]
    assert grid.axes is not None
    scale, shift = grid.axes
    return values, shift + scale * low, scale


def _too_large(found: object, most: int) -> AssetTooLargeError:
    return AssetTooLargeError(f"The level set has {found} voxels; the limit is {most}.", advice=_TOO_LARGE)


def _grids(cursor: _Cursor) -> list[_Grid]:
    if cursor.take(len(LEVEL_SET_MAGIC)) != LEVEL_SET_MAGIC:
        raise AssetFormatError(
            "The file is not an OpenVDB file.", advice="Send it with the file extension of its own format."
        )
    version = cursor.number("I")
    if version != _VERSION:
        raise AssetFormatError(
            f"The OpenVDB file has version {version} of the format; {_VERSION} is read.",
            advice="Write it again with OpenVDB 4 or later: vdb_tool -read in.vdb -write out.vdb",
        )
    cursor.numbers("II")  # the library's version
    if not cursor.number("B"):
        raise AssetFormatError(
            "The OpenVDB file was written as a stream, without the places of its grids.", advice="Write it as a file."
        )
    cursor.take(36)  # a UUID
    cursor.metadata()
    count = cursor.number("I")
    if count > _MOST_GRIDS:
        raise AssetTruncatedError("The OpenVDB file is damaged or incomplete.")
    found = []
    for _ in range(count):
        name, kind, parent = cursor.text(), cursor.text(), cursor.text()
        begin, _, end = cursor.numbers("qqq")
        cursor.at = max(begin, 0)
        compression = cursor.number("I")
        sort = cursor.metadata().get("class", b"unknown").decode("utf-8", "replace")
        axes = _axes(cursor)
        # A second grid of the same name has a number behind a separator.
        found.append(_Grid(name.partition("\x1e")[0], kind, bool(parent), sort, compression, axes, cursor.at, end))
        cursor.at = max(end, 0)
    return found


def _axes(cursor: _Cursor) -> tuple[_Floats, _Floats] | None:
    """Return the scale and the shift (3,) of a map along the axes; None for any other.

    What follows a map that is not read is not reached: its grid cannot be chosen.
    """
    kind = cursor.text()
    if kind == "AffineMap":
        matrix = np.array(cursor.numbers("16d")).reshape(4, 4)  # rows are the images of the axes, the last the shift
        scale, rest = matrix.diagonal()[:3].copy(), matrix[:3, :3] - np.diag(matrix.diagonal()[:3])
        return (scale, matrix[3, :3]) if np.abs(rest).max() <= 1e-9 * np.abs(scale).max() else None
    if kind == "TranslationMap":
        return np.ones(3), np.array(cursor.numbers("3d"))
    if kind in {"ScaleMap", "UniformScaleMap"}:
        return np.array(cursor.numbers("15d")[:3]), np.zeros(3)
    if kind in {"ScaleTranslateMap", "UniformScaleTranslateMap"}:
        rows = cursor.numbers("18d")
        return np.array(rows[3:6]), np.array(rows[:3])
    return None


def _chosen(grids: list[_Grid]) -> _Grid:
    """Return the level set of the file, or its only grid whose class is unknown."""
    usable = [grid for grid in grids if grid.kind.removesuffix(_HALF) in _TYPES and not grid.shared]
    found = [grid for grid in usable if grid.sort == "level set"] or [g for g in usable if g.sort == "unknown"]
    if not found:
        listed = ", ".join(f"{grid.name or 'unnamed'} ({grid.sort}, {grid.kind})"[:80] for grid in grids[:5])
        raise AssetError(
            f"The OpenVDB file has no level set of numbers, only: {listed or 'nothing'}.",
            advice="A fog volume has no distances: make a level set of it (Blender: Volume to Mesh, Mesh to Volume).",
        )
    if len(found) > 1:
        names = ", ".join((grid.name or "unnamed")[:40] for grid in found[:5])
        raise AssetError(f"The OpenVDB file has {len(found)} level sets: {names}.", advice="Send a file with one.")
    if (axes := found[0].axes) is None or not (np.isfinite(axes).all() and (axes[0] > 0).all()):
        raise AssetError(
            "The level set's map turns, shears, mirrors or bends its grid.",
            advice="Resample it on a grid along the axes, or convert it to a mesh: vdb_tool -read in.vdb -ls2mesh "
            "-write out.ply (its faces look inwards: turn them).",
        )
    return found[0]


def _read_topology(cursor: _Cursor, tree: _Tree) -> None:
    form = "f" if tree.dtype.itemsize == 4 else "d"
    if cursor.number("i") != 1:
        raise AssetTruncatedError("The OpenVDB file is damaged or incomplete.")
    tree.background = cursor.number(form)
    tiles, children = cursor.numbers("II")
    if tiles > _MOST_NODES:
        raise AssetTooLargeError(f"The OpenVDB file has more than {_MOST_NODES} tiles.", advice=_TOO_LARGE)
    for _ in range(tiles):
        *place, value, active = cursor.numbers(f"3i{form}?")
        tree.tiles.append((np.array([place], np.int64), 4096, np.array([value]), np.array([active])))
    for _ in range(children):
        _read_node(cursor, tree, np.array(cursor.numbers("3i"), np.int64), 5)


def _read_node(cursor: _Cursor, tree: _Tree, origin: NDArray[np.int64], bits: int) -> None:
    """Read a node of (2^bits)^3 entries and what is below it, but for the values of its leaves."""
    tree.nodes += 1
    if tree.nodes > _MOST_NODES:
        raise AssetTooLargeError(f"The OpenVDB file has more than {_MOST_NODES} nodes.", advice=_TOO_LARGE)
    size = 128 if bits == 5 else 8
    child, active = cursor.mask(8**bits), cursor.mask(8**bits)
    values = _read_values(cursor, tree, active)
    entries = np.arange(8**bits)
    side = (1 << bits) - 1
    places = origin + size * np.stack([entries >> 2 * bits, (entries >> bits) & side, entries & side], 1)
    tile = ~child & (active | (values != tree.background))
    tree.tiles.append((places[tile], size, values[tile], active[tile]))
    if bits == 4:
        tree.origins.append(places[child])
        cursor.take(64 * int(child.sum()))  # the leaves' masks, which stand before their values again
        return
    for place in places[child]:
        _read_node(cursor, tree, place, 4)


def _read_values(cursor: _Cursor, tree: _Tree, active: _Bools) -> _Floats:
    """Return the value of each entry of a node or a leaf, (N,) float64."""
    sort = cursor.number("b")
    if not 0 <= sort <= _ALL:
        raise ValueError("unknown storage")
    width = tree.dtype.itemsize
    first, second = (-tree.background if sort else tree.background), tree.background
    if sort in (_ONE, _MASK_ONE, _MASK_TWO):
        first = float(np.frombuffer(cursor.take(width), tree.dtype)[0])
    if sort == _MASK_TWO:
        second = float(np.frombuffer(cursor.take(width), tree.dtype)[0])
    chosen = cursor.mask(len(active)) if sort in (_MASK, _MASK_ONE, _MASK_TWO) else None
    whole = sort == _ALL or not tree.compression & _ACTIVE
    stored = np.dtype("<f2") if tree.half else tree.dtype
    count = len(active) if whole else int(active.sum())
    if tree.half and not count:
        found = np.zeros(0)
    else:
        found = np.frombuffer(_unpacked(cursor, tree, count * stored.itemsize), stored).astype(np.float64)
    if whole:
        return found
    values = np.full(len(active), first) if chosen is None else np.where(chosen, second, first)
    values[active] = found
    return values


def _unpacked(cursor: _Cursor, tree: _Tree, size: int) -> bytes:
    if not tree.compression & (_ZIP | _BLOSC):
        return cursor.take(size)
    packed = cursor.number("q")
    if packed <= 0:  # stored, as packing would have made it larger
        if -packed != size:
            raise ValueError("a block of another size")
        return cursor.take(size)
    chunk = cursor.take(packed)
    if tree.compression & _BLOSC:
        return unpack_blosc(chunk, size)
    unpacker = zlib.decompressobj()
    found = unpacker.decompress(chunk, size + 1)
    if len(found) != size or not unpacker.eof:
        raise ValueError("a block of another size")
    return found


def _box(tree: _Tree, origins: NDArray[np.int64], masks: _Bools) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and the last coordinate plus one of the active voxels' box, with a margin around it."""
    filled = masks.any(1)
    cubes, places = masks[filled].reshape(-1, 8, 8, 8), origins[filled]
    lows: list[NDArray[np.int64]] = []
    highs: list[NDArray[np.int64]] = []
    if len(cubes):
        sides = np.stack([np.asarray(cubes.any((2, 3))), cubes.any((1, 3)), cubes.any((1, 2))], 1)  # (leaves, axes, 8)
        lows.append((places + sides.argmax(2)).min(0))
        highs.append((places + 8 - sides[:, :, ::-1].argmax(2)).max(0))
    for places, size, _, active in tree.tiles:
        if active.any():
            lows.append(places[active].min(0))
            highs.append(places[active].max(0) + size)
    if not lows:
        raise AssetError("The level set has no active voxels.", advice="Send one that encloses something.")
    return np.min(lows, 0) - _MARGIN, np.max(highs, 0) + _MARGIN


def _within(place: NDArray[np.int64], size: int) -> tuple[slice, ...]:
    """Return where a cube lies in an array, as far as it does."""
    return tuple(slice(max(int(at), 0), max(int(at) + size, 0)) for at in place)
