"""Read typed fields of glTF's JSON; a wrong type or an index out of range raises an `AssetError` naming the field.

An integer written as a float, such as `0.0`, is replaced in the document by the integer.
"""

from __future__ import annotations

from typing import Any

from meshdeform.assets.json_text import Json
from meshdeform.errors import AssetError

__all__ = ["extension", "index", "integer", "member", "numbers", "objects", "text"]


def objects(parent: Json, key: str, where: str = "") -> list[Json]:
    """Return an array of objects, empty if absent."""
    value = parent.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise AssetError(f"{where}{key} must be an array of objects.")
    return value


def member(parent: Json, key: str, where: str) -> Json:
    """Return an object, empty if absent."""
    value = parent.get(key, {})
    if not isinstance(value, dict):
        raise AssetError(f"{where}.{key} must be an object.")
    return value


def extension(parent: Json, name: str, where: str) -> Json | None:
    """Return an extension's object, or None if absent."""
    extensions = member(parent, "extensions", where)
    return member(extensions, name, f"{where}.extensions") if name in extensions else None


def integer(
    parent: Json, key: str, where: str, *, default: int | None = None, minimum: int = 0, maximum: int = 2**53
) -> int:
    """Return an integer within bounds; without a default it is required."""
    value: Any = _integral(parent, key) if key in parent else default
    if not isinstance(value, int) or isinstance(value, bool) or not minimum <= value <= maximum:
        bounds = f"at least {minimum}" if maximum == 2**53 else f"{minimum} to {maximum}"
        raise AssetError(f"{where}.{key} must be an integer, {bounds}.")
    return value


def index(parent: Json, key: str, count: int, where: str) -> int | None:
    """Return an index into an array of `count` elements, or None if absent."""
    if key not in parent:
        return None
    value = _integral(parent, key)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < count:
        raise AssetError(f"{where}.{key} must be an index below {count}.")
    return value


def indices(parent: Json, key: str, count: int, where: str) -> list[int]:
    """Return an array of indices into an array of `count` elements, empty if absent."""
    value = parent.get(key, [])
    if not isinstance(value, list):
        raise AssetError(f"{where}.{key} must be an array of indices.")
    for at, item in enumerate(value):
        checked = index({key: item}, key, count, where)
        if checked is not item:
            value[at] = checked
    return value


def _integral(parent: Json, key: str) -> Any:
    value = parent[key]
    if isinstance(value, float) and value.is_integer():
        value = parent[key] = int(value)
    return value


def numbers(parent: Json, key: str, length: int | None, where: str) -> list[float] | None:
    """Return an array of finite numbers, or None if absent."""
    if key not in parent:
        return None
    value = parent[key]
    good = isinstance(value, list) and (length is None or len(value) == length)
    if not good or not all(
        isinstance(item, int | float) and not isinstance(item, bool) and abs(item) < 1e300 for item in value
    ):
        raise AssetError(f"{where}.{key} must be an array of {length or ''} finite numbers.".replace("  ", " "))
    return [float(item) for item in value]


def text(parent: Json, key: str, where: str) -> str | None:
    """Return a string, or None if absent."""
    value = parent.get(key)
    if value is not None and not isinstance(value, str):
        raise AssetError(f"{where}.{key} must be a string.")
    return value
