"""Job ids that sort by the time they were made."""

from __future__ import annotations

import secrets
import threading
import time

__all__ = ["JOB_ID_PATTERN", "id_pattern", "new_id", "new_job_id"]

# Crockford's alphabet: sorts as the number does, and has no letters that look like digits.
_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"


def id_pattern(prefix: str) -> str:
    """Return the regular expression of the ids with a prefix."""
    return rf"^{prefix}_[0-7][0-9a-hjkmnp-tv-z]{{25}}$"


JOB_ID_PATTERN = id_pattern("job")

_lock = threading.Lock()
_last = 0


def new_job_id() -> str:
    """Return the id of a new job."""
    return new_id("job")


def new_id(prefix: str) -> str:
    """Return the prefix, `_` and 26 characters: the 128 bits of a UUIDv7.

    Milliseconds come first, then a counter, then random bits.

    Ids of one process rise strictly, also within a millisecond and when the clock is set back.

    Source: RFC 9562, section 5.7, with method 1 of section 6.2 (a counter of fixed length that begins at random).
    """
    global _last
    with _lock:
        # 48 bits of milliseconds with 12 below them that count up; where they run over, the millisecond moves on.
        _last = max(_last + 1, (time.time_ns() // 1_000_000) << 12 | secrets.randbits(11))
        moment = _last
    number = moment >> 12 << 80 | 0x7 << 76 | (moment & 0xFFF) << 64 | 0b10 << 62 | secrets.randbits(62)
    return f"{prefix}_" + "".join(_ALPHABET[number >> shift & 31] for shift in range(125, -1, -5))
