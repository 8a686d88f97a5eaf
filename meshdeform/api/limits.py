"""What requests may do: the service enforces these limits and shows them, the client keeps to them.

Those of the request document stand beside its fields (`meshdeform.requests.document`), and those of an asset in
`meshdeform.assets.limits`.
"""

from __future__ import annotations

__all__ = ["IDLE_S", "MAX_DOCUMENT_BYTES", "MAX_FILENAME", "MAX_KEY", "MAX_PAGE", "MAX_WAIT_S"]

MAX_DOCUMENT_BYTES = 256 * 1024
"""Largest JSON document, and largest body of a route that takes no files."""

MAX_FILENAME = 200
"""Characters of a file's name; of a longer one the end is kept."""

MAX_KEY = 255
"""Characters of an `Idempotency-Key`."""

MAX_PAGE = 200
"""Entries of one page of a list."""

MAX_WAIT_S = 60
"""Longest `Prefer: wait`, in seconds."""

IDLE_S = 60.0
"""Seconds after which a body that does not come is given up."""
