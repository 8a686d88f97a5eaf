"""Where the next page of a list begins, as a word that callers hand back and do not read."""

from __future__ import annotations

import base64

from meshdeform.errors import ParameterError

__all__ = ["decode_cursor", "encode_cursor"]


def encode_cursor(job_id: str) -> str:
    """Return what names the place behind a job in the list."""
    return base64.urlsafe_b64encode(job_id.encode()).decode().rstrip("=")


def decode_cursor(cursor: str) -> str:
    """Return the job that a cursor names.

    Raises
    ------
    ParameterError
        It is not one of ours.
    """
    try:
        job_id = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode("ascii")
    except ValueError:
        job_id = ""
    if not job_id.startswith("job_"):
        raise ParameterError(
            "The cursor is not one that this service gave.",
            errors=[{"loc": ["query", "cursor"], "msg": "not a cursor of this service", "type": "cursor"}],
        )
    return job_id
