"""Where the next page of a list begins, as a word that callers hand back and do not read."""

from __future__ import annotations

import base64
import re

from meshdeform.errors import ParameterError
from meshdeform.record.ids import id_pattern

__all__ = ["decode_cursor", "encode_cursor"]


def encode_cursor(last_id: str) -> str:
    """Return what names the place behind a thing in its list."""
    return base64.urlsafe_b64encode(last_id.encode()).decode().rstrip("=")


def decode_cursor(cursor: str, prefix: str = "job") -> str:
    """Return the id that a cursor names, of the kind that is listed.

    Raises
    ------
    ParameterError
        It is not one of ours.
    """
    try:
        last_id = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode("ascii")
    except ValueError:
        last_id = ""
    if re.fullmatch(id_pattern(prefix), last_id) is None:
        raise ParameterError(
            "The cursor is not one that this service gave.",
            errors=[{"loc": ["query", "cursor"], "msg": "not a cursor of this service", "type": "cursor"}],
        )
    return last_id
