"""Job ids that sort by the time they were made."""

from __future__ import annotations

import secrets
import threading
import time

__all__ = ["JOB_ID_PATTERN", "new_job_id"]

# Crockford's alphabet: sorts as the number does, and has no letters that look like digits.
_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
JOB_ID_PATTERN = r"^job_[0-7][0-9a-hjkmnp-tv-z]{25}$"

_lock = threading.Lock()
_last = 0


def new_job_id() -> str:
    """Return `job_` and 26 characters: the 128 bits of a UUIDv7, milliseconds first, then random.

    Ids of one process rise strictly, also within a millisecond and when the clock is set back.

    Source: RFC 9562, section 5.7, with method 2 of section 6.2 (the random part is counted up).
    """
    global _last
    version, variant = 0x7 << 76, 0b10 << 62
    number = (time.time_ns() // 1_000_000) << 80 | version | secrets.randbits(12) << 64 | variant | secrets.randbits(62)
    with _lock:
        if number >> 64 <= _last >> 64:
            # Count up above the variant bits, so that they and the random tail stay what they must be.
            number = ((_last >> 64) + 1) << 64 | number & (2**64 - 1)
        _last = number
    return "job_" + "".join(_ALPHABET[number >> shift & 31] for shift in range(125, -1, -5))
