"""Show a result in a notebook."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable

from meshdeform.client.documents import JobView
from meshdeform.errors import MeshdeformError

GLB, REPORT, PREVIEW = "result.glb", "report.json", "preview.png"


def shown(preview: Callable[[], bytes]) -> bytes | None:
    """Return a preview; None where it cannot be had, since showing must not fail if service or client is gone."""
    try:
        return preview()
    except (MeshdeformError, RuntimeError):
        return None


def label(job: JobView) -> str:
    """Return a job in a few words."""
    return f"{job.id}: {job.asset.filename}, {job.prompt or job.kind}"


def html_of(job: JobView, png: bytes | None) -> str:
    """Return a job and its preview as HTML."""
    words = html.escape(label(job))
    if png is None:
        return f"<p>{words}</p>"
    shown = base64.b64encode(png).decode()
    return f'<figure><img alt="{words}" src="data:image/png;base64,{shown}"><figcaption>{words}</figcaption></figure>'
