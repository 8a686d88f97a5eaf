"""Evaluate conditional and partial requests: entity tags and byte ranges.

Source: RFC 9110, sections 8.8.3, 13.1 and 14.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from meshdeform.errors import RangeError

__all__ = ["ByteRange", "matches", "requested_range"]

_ONE_RANGE = re.compile(r"\s*bytes\s*=\s*([0-9]{0,18})\s*-\s*([0-9]{0,18})\s*", re.IGNORECASE)
_TAG = re.compile(r'(?:W/)?"[^"]*"')


@dataclass(frozen=True)
class ByteRange:
    """Bytes [start, end)."""

    start: int
    end: int


def matches(header: str | None, tag: str) -> bool:
    """Return whether `If-None-Match` contains the tag, by weak comparison."""
    if header is None:
        return False
    if header.strip() == "*":
        return True
    return tag.removeprefix("W/") in {found.removeprefix("W/") for found in _TAG.findall(header)}


def requested_range(header: str | None, if_range: str | None, tag: str, size: int) -> ByteRange | None:
    """Return the requested range, or None for the whole file.

    An invalid header, several ranges, and a range of another version (`If-Range`) select the whole file, as the RFC
    says.

    Raises
    ------
    RangeError
        The range begins past the end.
    """
    if header is None or (if_range is not None and if_range.strip() != tag):
        return None
    match = _ONE_RANGE.fullmatch(header)
    if match is None or match.groups() == ("", ""):
        return None
    first, last = match.groups()
    if first == "":
        start, end = max(0, size - int(last)), size
    else:
        start, end = int(first), min(size, int(last) + 1) if last else size
        if last and int(last) < start:
            return None
    if start >= size:
        raise RangeError(f"The file has {size} bytes.", size=size)
    return ByteRange(start, end)
