"""Drop the data that a new shape made unused, without renumbering anything that the source refers to.

Indices may also stand in extensions that Meshdeform does not know. So the source's accessors and buffer views keep
their numbers: new values take the bytes of the ones they replace, or new entries take the indices of unused ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.codes import COMPONENT_BYTES, FLOAT, MESHOPT_EXTENSIONS, TYPE_COMPONENTS
from meshdeform.assets.compressed import drop_extension
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.usage import Usage, accessor_slots, buffer_ranges, possible_references, view_slots

_WORD = 4  # bytes; offsets keep their alignment


def compact(document: Document, source: Usage, replaced: list[tuple[int, int]]) -> None:
    """Drop the entries that the source used and the document no longer does; those that were never used stay.

    `document`: changed in place. Everything after the source's accessors and views was appended by this package.
    `source`: what the document used when it was read; `replaced`, list of (int, int): accessors of the source, and
    those with their new values.
    """
    root = document.root
    opaque = possible_references(root)
    data = document.buffer_zero()
    moved = _overwrite(root, data, source, replaced, opaque)
    for holder, key in accessor_slots(root):
        holder[key] = moved.get(holder[key], holder[key])
    _fill(root["accessors"], source.accessors - opaque, source.accessor_count, list(accessor_slots(root)))
    _fill(root["bufferViews"], source.views - opaque, source.view_count, list(view_slots(root)))
    for name in MESHOPT_EXTENSIONS:
        if not any(name in view.get("extensions", {}) for view in root["bufferViews"]):
            drop_extension(root, name)
    document.use_buffer_zero(_cut(root, data, source))


def _overwrite(
    root: Json, data: bytearray, source: Usage, replaced: list[tuple[int, int]], opaque: set[int]
) -> dict[int, int]:
    """Write new values over the old ones where nothing else uses the bytes; return the old accessor of each new one."""
    used = {holder[key] for holder, key in accessor_slots(root)} | opaque
    replaced_accessors = {old for old, _ in replaced if old in source.accessors and old not in used}
    held = np.zeros(len(data), bool)
    for start, end in _held_ranges(root, opaque):
        held[start:end] = True
    for i, accessor in enumerate(root["accessors"]):
        if i not in replaced_accessors:
            _rows(root, held, accessor)[...] = True
    moved: dict[int, int] = {}
    for old, new in replaced:
        before, after = root["accessors"][old], root["accessors"][new]
        if old not in replaced_accessors or not _same_layout(root, before, after) or _rows(root, held, before).any():
            continue
        values = np.frombuffer(data, np.uint8)
        _rows(root, values, before)[...] = _rows(root, values, after)
        before |= {key: after[key] for key in ("min", "max") if key in after}
        _rows(root, held, before)[...] = True
        replaced_accessors.remove(old)
        moved[new] = old
    return moved


def _held_ranges(root: Json, opaque: set[int]) -> Iterator[tuple[int, int]]:
    """Yield the stretches of buffer 0 that something other than an accessor's own elements uses."""
    views = root["bufferViews"]
    whole = {holder[key] for holder, key in view_slots(root) if "componentType" not in holder or "type" not in holder}
    whole |= opaque
    whole |= {i for i, view in enumerate(views) if view.get("extensions")}
    chosen = {id(views[i]) for i in whole if 0 <= i < len(views)}
    known = {id(view) for view in views}
    for holder, start, end in buffer_ranges(root):
        if id(holder) in chosen or id(holder) not in known:
            yield start, end


def _same_layout(root: Json, before: Json, after: Json) -> bool:
    plain = "sparse" not in before and before["componentType"] == FLOAT and "bufferView" in before
    return (
        plain
        and (before["type"], before["count"]) == (after["type"], after["count"])
        and root["bufferViews"][before["bufferView"]]["buffer"] == 0
    )


def _rows(root: Json, data: NDArray[Any], accessor: Json) -> NDArray[Any]:
    """Return the bytes of an accessor's elements (count, bytes) as a view of buffer 0; empty if they are elsewhere."""
    size = COMPONENT_BYTES[accessor["componentType"]] * TYPE_COMPONENTS[accessor["type"]]
    view: Json = root["bufferViews"][accessor["bufferView"]] if "bufferView" in accessor else {"buffer": None}
    if view["buffer"] != 0:
        return data[:0]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    shape, strides = (accessor["count"], size), (view.get("byteStride", size), 1)
    return np.lib.stride_tricks.as_strided(data[start:], shape, strides)


def _fill(items: list[Json], used_before: frozenset[int], count: int, slots: list[tuple[Json, str]]) -> None:
    """Move appended entries that are used to the indices of unused ones, and drop the other appended entries."""
    used = {holder[key] for holder, key in slots}
    free = [i for i in range(count) if i in used_before and i not in used]
    appended = [i for i in range(count, len(items)) if i in used]
    free = free[: len(appended)]
    free += range(count, count + len(appended) - len(free))
    number = dict(zip(appended, free, strict=True))
    sources = [items[i] for i in appended]
    del items[count:]
    for index, item in zip(free, sources, strict=True):
        items[index : index + 1] = [item]
    for holder, key in slots:
        holder[key] = number.get(holder[key], holder[key])


def _cut(root: Json, data: bytearray, source: Usage) -> bytes:
    """Return buffer 0 without the words that only dropped views covered, and shift the offsets of the others."""
    dropped = np.zeros(len(data) + -len(data) % _WORD, bool)
    for start, end in (*source.ranges, (source.end, len(dropped))):
        dropped[start:end] = True
    views = list(buffer_ranges(root))
    for _, start, end in views:
        dropped[start:end] = False
    words = dropped.reshape(-1, _WORD).all(axis=1)
    before = np.concatenate([[0], np.cumsum(words)]) * _WORD  # bytes dropped before each word
    for holder, start, _ in views:
        if before[start // _WORD]:
            holder["byteOffset"] = start - int(before[start // _WORD])
    padded = np.frombuffer(data + b"\0" * (-len(data) % _WORD), np.uint8)
    return padded.reshape(-1, _WORD)[~words].tobytes()
