"""Ids that sort by creation time, and cursors, which contain the last id of a page of a list."""

from __future__ import annotations

import base64
import re
import secrets
import threading
import time
from datetime import datetime

from meshdeform.errors import ParameterError

# Crockford's alphabet preserves the order of numbers and has no letters that look like digits.
_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
_lock = threading.Lock()
_last = 0


def id_pattern(prefix: str) -> str:
    """Return the regular expression of ids with a prefix."""
    return rf"^{prefix}_[0-7][0-9a-hjkmnp-tv-z]{{25}}$"


JOB_ID_PATTERN = id_pattern("job")


def new_job_id() -> str:
    """Return an id for a new job."""
    return new_id("job")


def new_id(prefix: str) -> str:
    """Return the prefix, `_` and 26 characters: the 128 bits of a UUIDv7 (milliseconds, counter, random bits).

    Ids of one process increase strictly, even within a millisecond or when the clock is set back.

    Source: RFC 9562, section 5.7, with method 1 of section 6.2 (a counter of fixed length with a random start).
    """
    global _last
    with _lock:
        # 48 bits of milliseconds above a counter of 12 bits; on overflow, the counter increments the milliseconds.
        _last = max(_last + 1, (time.time_ns() // 1_000_000) << 12 | secrets.randbits(11))
        moment = _last
    return _written(prefix, moment >> 12 << 80 | 0x7 << 76 | (moment & 0xFFF) << 64 | 0b10 << 62 | secrets.randbits(62))


def least_id(prefix: str, moment: datetime) -> str:
    """Return a lower bound of the ids that are made at an instant or later."""
    milliseconds = min(max(int(moment.timestamp() * 1000), 0), 2**48 - 1)
    return _written(prefix, milliseconds << 80)


def _written(prefix: str, number: int) -> str:
    return f"{prefix}_" + "".join(_ALPHABET[number >> shift & 31] for shift in range(125, -1, -5))


def encode_cursor(last_id: str) -> str:
    """Return the cursor of the page that follows an id."""
    return base64.urlsafe_b64encode(last_id.encode()).decode().rstrip("=")


def decode_cursor(cursor: str, prefix: str = "job") -> str:
    """Return the id in a cursor of a list of ids with a prefix.

    Raises ParameterError: the cursor was not made by `encode_cursor`.
    """
    try:
        last_id = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode("ascii")
    except ValueError:
        last_id = ""
    if re.fullmatch(id_pattern(prefix), last_id) is None:
        raise ParameterError(
            "The cursor does not come from this service.",
            errors=[{"loc": ["query", "cursor"], "msg": "not a cursor of this service", "type": "cursor"}],
        )
    return last_id
