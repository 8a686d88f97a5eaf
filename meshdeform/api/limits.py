"""Define the limits on requests, which the service enforces and reports and the client respects.

The limits on the request document are defined with its fields (`meshdeform.requests.document`), and those on an asset
in `meshdeform.assets.limits`.
"""

from __future__ import annotations

MAX_DOCUMENT_BYTES = 256 * 1024
"""Largest JSON document, and largest body of a route that takes no files, in bytes."""
MAX_INLINE_BYTES = 32 * 2**20
"""Largest JSON document that holds files as base64, in bytes."""
MAX_FETCH_S = 30.0
"""Longest time to fetch a file from a URL, in seconds."""
FETCH_SOON_S = 5.0
"""Seconds after which a job is accepted whose file is still being fetched."""
MAX_FILENAME = 200
"""Maximum characters of a file name. Only the end of a longer name is kept."""
MAX_KEY = 255
"""Maximum characters of an `Idempotency-Key`."""
MAX_PAGE = 200
"""Maximum entries on one page of a list."""
MAX_SEARCH = 200
"""Maximum characters of a search for jobs."""
MAX_PREVIEWED = 6
"""Most seeds of one preview."""
PREVIEW_S = 60.0
"""Longest time that a preview may take, in seconds."""
MAX_WAIT_S = 60
"""Longest `Prefer: wait`, in seconds."""
IDLE_S = 60.0
"""Seconds without data after which a request's body is abandoned."""
MIN_BODY_RATE = 32 * 1024
"""Bytes per second at which a body must arrive on average, after the first `IDLE_S` seconds."""
