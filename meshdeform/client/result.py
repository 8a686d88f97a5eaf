"""Give access to a job's artifacts, to save, read and show them."""

from __future__ import annotations

import base64
import html
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.client.documents import ArtifactView, JobView
from meshdeform.errors import MeshdeformError

if TYPE_CHECKING:
    from meshdeform.client.asynchronous import AsyncClient
    from meshdeform.client.sync import Client

__all__ = ["AsyncResult", "Result"]

GLB, REPORT, PREVIEW = "result.glb", "report.json", "preview.png"


class Result:
    """A job that has succeeded, and its artifacts, each downloaded on first use and cached.

    A notebook shows its preview, with the asset before and after.

    Parameters
    ----------
    client : Client
        Must be open to download more artifacts.
    job : JobView
    """

    def __init__(self, client: Client, job: JobView) -> None:
        self._client, self.job = client, job
        self._kept: dict[str, bytes] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {_label(self.job)}>"

    @property
    def id(self) -> str:
        """The job's id."""
        return self.job.id

    def artifacts(self) -> list[ArtifactView]:
        """Return the job's artifacts."""
        return self._client.artifacts(self.job)

    def read(self, name: str) -> bytes:
        """Return an artifact's bytes after verifying their SHA-256."""
        if name not in self._kept:
            self._kept[name] = self._client.read(self.job, name)
        return self._kept[name]

    def glb(self) -> bytes:
        """Return the asset with its new shape."""
        return self.read(GLB)

    def report(self) -> dict[str, Any]:
        """Return the report: parameters, seed, hashes, losses, times, and the mesh's quality before and after."""
        return dict(json.loads(self.read(REPORT)))

    def preview(self) -> bytes:
        """Return a PNG of the asset before and after."""
        return self.read(PREVIEW)

    def save(self, folder: str | os.PathLike[str], names: Sequence[str] | None = None) -> list[Path]:
        """Save all artifacts, or those with the given names, to a folder; see `Client.fetch`."""
        return self._client.fetch(self.job, folder, names)

    def _repr_png_(self) -> bytes | None:
        try:
            return self.preview()
        except (MeshdeformError, RuntimeError):
            # Showing must not fail if the service or the client is gone: then show only the text.
            return None

    def _repr_html_(self) -> str:
        return _html(self.job, self._repr_png_())


class AsyncResult:
    """A job that has succeeded, and its artifacts, each downloaded on first use and cached.

    A notebook shows its preview only after `await result.preview()`, since showing cannot await it.

    Parameters
    ----------
    client : AsyncClient
        Must be open to download more artifacts.
    job : JobView
    """

    def __init__(self, client: AsyncClient, job: JobView) -> None:
        self._client, self.job = client, job
        self._kept: dict[str, bytes] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {_label(self.job)}>"

    @property
    def id(self) -> str:
        """The job's id."""
        return self.job.id

    async def artifacts(self) -> list[ArtifactView]:
        """Return the job's artifacts."""
        return await self._client.artifacts(self.job)

    async def read(self, name: str) -> bytes:
        """Return an artifact's bytes after verifying their SHA-256."""
        if name not in self._kept:
            self._kept[name] = await self._client.read(self.job, name)
        return self._kept[name]

    async def glb(self) -> bytes:
        """Return the asset with its new shape."""
        return await self.read(GLB)

    async def report(self) -> dict[str, Any]:
        """Return the report: parameters, seed, hashes, losses, times, and the mesh's quality before and after."""
        return dict(json.loads(await self.read(REPORT)))

    async def preview(self) -> bytes:
        """Return a PNG of the asset before and after."""
        return await self.read(PREVIEW)

    async def save(self, folder: str | os.PathLike[str], names: Sequence[str] | None = None) -> list[Path]:
        """Save all artifacts, or those with the given names, to a folder; see `AsyncClient.fetch`."""
        return await self._client.fetch(self.job, folder, names)

    def _repr_png_(self) -> bytes | None:
        return self._kept.get(PREVIEW)

    def _repr_html_(self) -> str:
        return _html(self.job, self._repr_png_())


def _label(job: JobView) -> str:
    return f"{job.id}: {job.asset.filename}, {job.prompt or job.kind}"


def _html(job: JobView, png: bytes | None) -> str:
    words = html.escape(_label(job))
    if png is None:
        return f"<p>{words}</p>"
    shown = base64.b64encode(png).decode()
    return f'<figure><img alt="{words}" src="data:image/png;base64,{shown}"><figcaption>{words}</figcaption></figure>'
