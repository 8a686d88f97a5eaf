"""Provide the client for event loops. `scripts/sync_client.py` makes `sync.py`, the one for threads, of this file."""

from __future__ import annotations

import json
import os
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx

from meshdeform.api.states import JobState
from meshdeform.client import downloads, events, lessons, reading, running, sketching, submitting
from meshdeform.client.commands import Emit
from meshdeform.client.connections import Service, address
from meshdeform.client.documents import (
    ArtifactView,
    CheckpointView,
    EventView,
    FoundOrientation,
    JobView,
    Limits,
    ModelList,
    SignedUrl,
    UploadView,
    Validation,
)
from meshdeform.client.drivers import AsyncDriver
from meshdeform.client.lessons import Meshes
from meshdeform.client.paths import JobLike, artifact_path, job_path
from meshdeform.client.result import GLB, PREVIEW, REPORT, html_of, label
from meshdeform.client.sketching import Drawing, SketchGuesses
from meshdeform.client.sources import AssetLike
from meshdeform.client.submitting import Files, Order, Output, Params
from meshdeform.requests.document import JobKind

__all__ = ["AsyncClient", "AsyncResult"]


class AsyncConnection(Service):
    """Connections to a service for event loops. Parameters and errors are those of `AsyncClient`."""

    def __init__(
        self,
        base_url: str | None = None,
        *,
        api_key: str | None = None,
        timeout_s: float = 60.0,
        max_retries: int = 4,
        http: httpx.AsyncClient | None = None,
    ) -> None:
        super().__init__(address(base_url, http), api_key, timeout_s, max_retries)
        self._owned = http is None
        # No limit on connections: each task that follows events keeps one open.
        self._http = http or httpx.AsyncClient(limits=httpx.Limits(max_connections=None))
        self._driver = AsyncDriver(self._http, self._endpoint)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close the connections."""
        if self._owned:
            await self._http.aclose()


class AsyncClient(AsyncConnection):
    """A client of one service. An async context manager; safe to share between tasks of an event loop.

    Callbacks may be functions or coroutine functions.

    Parameters
    ----------
    base_url : str, optional
        For example `https://meshdeform.example`, optionally with a path. Default: `MESHDEFORM_URL`, else
        `http://127.0.0.1:8765`.
    api_key : str, optional
        Default: `MESHDEFORM_API_KEY`, else none. An empty key means none.
    timeout_s : float
        Seconds to wait for data of a response, and for which to retry a failed request.
    max_retries : int
        How often to retry a request that got no response, or 408, 429, 502, 503 or 504. 0: never.
    http : httpx.AsyncClient, optional
        Used instead of a new one (for proxies, certificates, tests), and not closed.

    Raises
    ------
    MeshdeformError
        Every method raises the class of `meshdeform.errors` for the code in the service's response, or
        `UnavailableError` if there was no response.
    ValueError
        The address, the key or a time is invalid.
    """

    async def deform(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        files: Mapping[str, AssetLike] | None = None,
        metadata: Mapping[str, str] | None = None,
        priority: int | None = None,
        deadline_s: float | None = None,
        retention_s: float | None = None,
        kind: JobKind | str | None = None,
        filename: str | None = None,
        upload: bool | None = None,
        idempotency_key: str | None = None,
        on_event: Callable[[EventView], Any] | None = None,
        timeout_s: float | None = None,
        cancel_on_interrupt: bool = True,
    ) -> AsyncResult:
        """Post a job, wait until it has finished, and return its result.

        Parameters
        ----------
        asset, prompt, params, output, target, files, metadata, priority, deadline_s, retention_s, kind
            As for `submit`.
        filename, upload, idempotency_key
            As for `submit`.
        on_event : callable, optional
            Called with every event as it happens.
        timeout_s : float, optional
            Default: no limit.
        cancel_on_interrupt : bool
            Cancel the job if this task is canceled.

        Raises
        ------
        WaitTimeoutError
            The job has not finished in time. It continues: the error's `extra["job_id"]` has its id.
        MeshdeformError
            The request was refused, or the job failed.
        """
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        sent = Files.of(asset, target, files, filename, upload, idempotency_key)
        job = await self._driver.run(
            running.deformed(order, sent, self._policy, on_event, timeout_s, cancel=cancel_on_interrupt)
        )
        return AsyncResult(self, job)

    async def submit(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        files: Mapping[str, AssetLike] | None = None,
        metadata: Mapping[str, str] | None = None,
        priority: int | None = None,
        deadline_s: float | None = None,
        retention_s: float | None = None,
        kind: JobKind | str | None = None,
        filename: str | None = None,
        upload: bool | None = None,
        idempotency_key: str | None = None,
    ) -> JobView:
        """Post a job. It is created only once, even if the request is retried.

        Parameters
        ----------
        asset : path, bytes, binary stream, UploadView or mapping
            GLB, OBJ, PLY, STL or ZIP. A mapping names a stored file: `{"job_id": ..., "artifact": "result.glb"}`.
        prompt : str
            What the asset should become.
        params : DeformParams or mapping, optional
            For example `{"preset": "preview", "seed": 7}`.
        output : OutputOptions or mapping, optional
        target : like `asset`, optional
            A second mesh, for `params` with `{"guidance": "target"}`.
        files : mapping of str to files like `asset`, optional
            Other files by the names of their parts, such as `sketch`: a drawing; `limits().kinds` lists them.
        metadata : mapping, optional
            Your own labels.
        priority : int, optional
            Jobs with higher priority run first.
        deadline_s, retention_s : float, optional
            Seconds until the job expires unless finished, and seconds from its end until it is deleted.
        kind : str, optional
            What the job does.
        filename : str, optional
            The file name to send with bytes or a stream; its extension identifies OBJ, PLY and STL.
        upload : bool, optional
            Whether to upload files in pieces before posting the job. Default: only files above 16 MiB.
        idempotency_key : str, optional
            Your own key for this request: requests with the same key within a day, also from other processes, create
            only one job.
        """
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        sent = Files.of(asset, target, files, filename, upload, idempotency_key)
        return await self._driver.run(submitting.submitted(order, sent, self._policy))

    async def validate(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        files: Mapping[str, AssetLike] | None = None,
        metadata: Mapping[str, str] | None = None,
        priority: int | None = None,
        deadline_s: float | None = None,
        retention_s: float | None = None,
        kind: JobKind | str | None = None,
        filename: str | None = None,
        upload: bool | None = None,
    ) -> Validation:
        """Check a job without posting it, and return the asset's contents, all parameters and a time estimate.

        Parameters and errors are those of `submit`.
        """
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        sent = Files.of(asset, target, files, filename, upload, None)
        return await self._driver.run(submitting.validated(order, sent, self._policy))

    async def orient(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        filename: str | None = None,
        upload: bool | None = None,
    ) -> FoundOrientation:
        """Find the side of an asset that a job would make the front, without posting it.

        Parameters and errors are those of `submit`. It takes seconds, and needs `params` with `orientation` = `auto`
        and the builtin model, which are the defaults of every preset but `paper`.

        Raises
        ------
        ParameterError
            The job would not search its front.
        DependencyError, UnavailableError
            The service cannot search it, or cannot search it now.
        """
        sent = Files.of(asset, None, None, filename, upload, None)
        return await self._driver.run(submitting.oriented(Order(prompt, params, output), sent, self._policy))

    async def teach(
        self,
        noun: str,
        meshes: Meshes,
        *,
        params: Mapping[str, Any] | None = None,
        metadata: Mapping[str, str] | None = None,
        idempotency_key: str | None = None,
    ) -> JobView:
        """Post a job of kind `prior_teach`; once it has succeeded, `job:ID` is the model of prompts with the noun.

        Parameters
        ----------
        noun : str
            What the meshes show: "a gnome".
        meshes : like `asset` of `submit`, or a sequence of paths
            One mesh, a ZIP, or a folder or several files, which are packed. Subfolders are named by attributes.
        params : mapping, optional
            More parameters, such as `{"synonyms": ["dwarf"], "steps": 600}`.
        metadata, idempotency_key
            As for `submit`.

        Raises
        ------
        ValueError
            There is no mesh, or two of them have one name.
        """
        lesson = lessons.taught(noun, meshes, params or {}, metadata, idempotency_key, self._policy)
        return await self._driver.run(lesson)

    async def upload(
        self, asset: AssetLike, *, filename: str | None = None, idempotency_key: str | None = None
    ) -> UploadView:
        """Upload a file for use in any number of jobs."""
        return await self._driver.run(submitting.sent_ahead(asset, filename, idempotency_key, self._policy))

    async def retry(self, job: JobLike, *, idempotency_key: str | None = None) -> JobView:
        """Retry a job that did not succeed, as a new job that continues from its last checkpoint."""
        return await self._driver.run(submitting.retried(job, idempotency_key, self._policy))

    async def branch(
        self,
        job: JobLike,
        step: int,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        files: Mapping[str, AssetLike] | None = None,
        metadata: Mapping[str, str] | None = None,
        priority: int | None = None,
        deadline_s: float | None = None,
        retention_s: float | None = None,
        kind: JobKind | str | None = None,
        idempotency_key: str | None = None,
    ) -> JobView:
        """Post a job on the same asset that starts from the shape of a checkpoint; see `checkpoints`."""
        parts = submitting.parts_of(files, target=target)
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        return await self._driver.run(submitting.branched(job, step, order, parts, idempotency_key, self._policy))

    async def get(self, job: JobLike) -> JobView:
        """Return a job's current state."""
        return await self._driver.run(reading.got(job, self._policy))

    def jobs(
        self,
        *,
        state: JobState | str | None = None,
        metadata: Mapping[str, str] | None = None,
        created_after: datetime | None = None,
        search: str = "",
        limit: int = 50,
    ) -> AsyncIterator[JobView]:
        """Iterate over the jobs, newest first, requesting pages of `limit`. A naive `created_after` is local time.

        `search` finds jobs whose prompts, file names or values of labels contain all of its words.
        """
        query = reading.listing(state, metadata or {}, created_after, search, limit)
        return self._driver.iterate(reading.listed(query, self._policy))

    def watch(self, job: JobLike, *, after: int | None = None) -> AsyncIterator[EventView]:
        """Iterate over a job's events until the last one: each once and in order, reconnecting as needed.

        Parameters
        ----------
        job : JobView or str
        after : int, optional
            `seq` of the last event that you have. Default: start with the first event.

        Raises
        ------
        UnavailableError
            The service does not answer for longer than five times `timeout_s`. Shorter outages are bridged.
        """
        return self._driver.iterate(events.followed(reading.identity(job), after or 0, self._policy, Emit))

    async def wait(
        self,
        job: JobLike,
        *,
        timeout_s: float | None = None,
        on_change: Callable[[JobView], Any] | None = None,
        on_event: Callable[[EventView], Any] | None = None,
        check: bool = True,
    ) -> JobView:
        """Wait until a job has finished. An unchanged job costs a 304; the service sets the polling interval.

        Parameters
        ----------
        job : JobView or str
        timeout_s : float, optional
            Default: no limit.
        on_change : callable, optional
            Called with the job whenever it has changed.
        on_event : callable, optional
            Called with every event as it happens, from the first one.
        check : bool
            Raise unless the job succeeded.

        Raises
        ------
        WaitTimeoutError
            The job has not finished in time. It continues. Also a `TimeoutError`.
        MeshdeformError
            With `check`: the job's error, or `ConflictError` if it was canceled or has expired.
        """
        return await self._driver.run(
            reading.waited(job, self._policy, timeout_s=timeout_s, on_change=on_change, on_event=on_event, check=check)
        )

    async def result(self, job: JobLike, *, timeout_s: float | None = None) -> AsyncResult:
        """Wait until a job has succeeded and return its result; errors are those of `wait`."""
        return AsyncResult(self, await self.wait(job, timeout_s=timeout_s))

    async def cancel(self, job: JobLike) -> JobView:
        """Request cancellation of a job."""
        return await self._driver.run(reading.canceled(job, self._policy))

    async def delete(self, job: JobLike) -> None:
        """Delete a finished job with its artifacts."""
        await self._driver.run(reading.deleted(job, self._policy))

    async def artifacts(self, job: JobLike) -> list[ArtifactView]:
        """Return a job's artifacts, sorted by name."""
        return await self._driver.run(reading.artifacts(job, self._policy))

    async def make(self, job: JobLike, name: str) -> ArtifactView:
        """Add `morph.glb` or `result.stl` to a job that has succeeded without it.

        Raises
        ------
        AssetError
            It cannot be made of the job's files.
        DependencyError
            The service cannot write the format.
        """
        return await self._driver.run(reading.made(job, name, self._policy))

    async def checkpoints(self, job: JobLike) -> list[CheckpointView]:
        """Return the checkpoints from which a job can continue, sorted by step."""
        return await self._driver.run(reading.checkpoints(job, self._policy))

    async def signed_url(self, job: JobLike, name: str) -> SignedUrl:
        """Return a URL of an artifact that needs no API key."""
        return await self._driver.run(reading.signed_url(job, name, self._policy))

    async def job_link(self, job: JobLike) -> SignedUrl:
        """Return a link to a job's page: whoever has it can watch this job and read its files until it expires."""
        return await self._driver.run(reading.job_link(job, self._policy))

    async def limits(self) -> Limits:
        """Return the service's limits on requests."""
        return await self._driver.run(reading.limits(self._policy))

    async def models(self) -> ModelList:
        """Return the models that jobs may use."""
        return await self._driver.run(reading.models(self._policy))

    async def read(self, job: JobLike, name: str, *, strength: float | None = None) -> bytes:
        """Return an artifact's bytes after verifying their SHA-256.

        Parameters
        ----------
        job : JobView or str
        name : str
        strength : float, optional
            Of `result.glb`: from 0, the source, over 1, the result, to 1.5, in steps of 0.01.
        """
        return await self._driver.run(downloads.loaded(artifact_path(job, name, strength), self._policy))

    async def download(
        self, job: JobLike, name: str, path: str | os.PathLike[str], *, strength: float | None = None
    ) -> Path:
        """Save an artifact. The file appears complete, with its SHA-256 verified, or not at all.

        An interrupted download resumes where it stopped. An existing file is replaced. `strength` as for `read`.
        """
        url = artifact_path(job, name, strength)
        return await self._driver.run(downloads.saved(url, Path(path), self._policy))

    async def fetch(
        self, job: JobLike, folder: str | os.PathLike[str], names: Sequence[str] | None = None
    ) -> list[Path]:
        """Save a job's artifacts to a folder, created if missing. Identical existing files are not downloaded again.

        Parameters
        ----------
        job : JobView or str
        folder : path
        names : sequence of str, optional
            The artifacts to save. Default: all.

        Raises
        ------
        JobNotFinishedError
            The job has not finished.
        NotFoundError
            The job has no artifact with such a name.
        MeshdeformError
            The job failed: its error; `ConflictError` if it was canceled or has expired.
        """
        return await self._driver.run(downloads.fetched(job, Path(folder), names, self._policy))

    async def download_asset(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the asset as it was sent, for a job in any state."""
        return await self._driver.run(downloads.saved(job_path(job, "asset"), Path(path), self._policy))

    async def download_file(self, job: JobLike, part: str, path: str | os.PathLike[str]) -> Path:
        """Save a file of a job of any kind as it was sent, by the name of its part."""
        return await self._driver.run(downloads.saved(job_path(job, "files", part), Path(path), self._policy))

    async def download_target(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the second mesh of `target` guidance as it was sent."""
        return await self._driver.run(downloads.saved(job_path(job, "target"), Path(path), self._policy))

    async def download_checkpoint(self, job: JobLike, step: int, path: str | os.PathLike[str]) -> Path:
        """Save the asset with its shape at a checkpoint."""
        return await self._driver.run(
            downloads.saved(job_path(job, "checkpoints", step, "mesh.glb"), Path(path), self._policy)
        )

    async def guess_sketch(self, drawing: Drawing, *, family: str | None = None) -> SketchGuesses:
        """Guess what a drawing shows: three families with their parameters and a mesh each.

        Parameters
        ----------
        drawing : bytes or path
            A PNG, JPEG or WebP.
        family : str, optional
            What it shows; no other family is considered.

        Raises
        ------
        DrawingError
            The picture is no line drawing.
        ParameterError
            There is no such family.
        DependencyError, UnavailableError
            The service cannot read drawings, or cannot read them now.
        """
        return await self._driver.run(sketching.guessed(drawing, family, self._policy))

    async def make_sketch_mesh(self, family: str, values: Mapping[str, float | str] | None = None) -> bytes:
        """Return the GLB of a shape of a family; parameters left out have their default.

        Raises
        ------
        ParameterError
            There is no such family, a name is unknown, or a value is out of range.
        """
        return await self._driver.run(sketching.shaped(family, values, self._policy))


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
        return f"<{type(self).__name__} of {label(self.job)}>"

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
        return self._kept.get(PREVIEW)  # threads: return shown(self.preview)

    def _repr_html_(self) -> str:
        return html_of(self.job, self._repr_png_())
