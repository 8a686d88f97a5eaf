"""Read what nothing has checked, such as extensions and animations: what is of a wrong type counts as absent."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeGuard

from meshdeform.assets.container import Json, clone

__all__ = ["animated", "channels_of", "follow_pointers", "is_index", "member_of", "objects_in", "pointer_of"]

_POINTER = re.compile(r"/(\w+)/(\d{1,9})/(.+)", re.ASCII)


def member_of(parent: Any, *keys: str) -> Json:
    """Return the object at the end of a path of members; an empty one if there is none."""
    for key in keys:
        parent = parent.get(key) if isinstance(parent, dict) else None
    return parent if isinstance(parent, dict) else {}


def objects_in(items: Any) -> list[Json]:
    """Return the objects of an array."""
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def is_index(value: Any, count: int) -> TypeGuard[int]:
    """Return whether a value is an index into an array of `count` elements."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < count


def channels_of(root: Json) -> Iterator[tuple[Json, list[Any], Json]]:
    """Yield each channel of the animations, the list that it is in, and its animation."""
    for animation in objects_in(root.get("animations")):
        channels = animation.get("channels")
        for channel in objects_in(channels):
            yield channel, channels, animation  # type: ignore[misc]


def pointer_of(channel: Json) -> Json:
    """Return the object of KHR_animation_pointer in a channel; an empty one if it has none."""
    return member_of(channel, "target", "extensions", "KHR_animation_pointer")


def animated(channel: Json) -> tuple[str, int, str]:
    """Return the array, the index and the property of what a channel acts on, such as `nodes`, 3 and `translation`.

    An empty array and -1 if it acts on nothing that is known.
    """
    target = member_of(channel, "target")
    node, path = target.get("node"), str(target.get("path"))
    if path == "pointer":
        match = _POINTER.fullmatch(str(pointer_of(channel).get("pointer")))
        return (match[1], int(match[2]), match[3]) if match else ("", -1, "")
    return ("nodes", node, path) if isinstance(node, int) and not isinstance(node, bool) else ("", -1, "")


def follow_pointers(
    root: Json, array: str, copies: Mapping[int, Sequence[int]], *, only: str = "", instead: bool = False
) -> None:
    """Let what KHR_animation_pointer animates of an object act on its copies too, or on them instead of it.

    `array`: name of a top-level array; `only`: the one property of the objects that the copies have.
    """
    for channel, channels, _ in list(channels_of(root)):
        match = _POINTER.fullmatch(str(pointer_of(channel).get("pointer")))
        if match is None or match[1] != array or (only and match[3] != only):
            continue
        numbers = list(copies.get(int(match[2]), ()))
        if numbers and instead:
            pointer_of(channel)["pointer"] = f"/{array}/{numbers.pop(0)}/{match[3]}"
        for number in numbers:
            channels.append(clone(channel))
            pointer_of(channels[-1])["pointer"] = f"/{array}/{number}/{match[3]}"
