"""The client for event loops."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx

from meshdeform.client import downloads, events
from meshdeform.client import reading as looking
from meshdeform.client import running as deforming
from meshdeform.client import submitting as creating
from meshdeform.client.commands import Emit
from meshdeform.client.documents import (
    ArtifactView,
    CheckpointView,
    EventView,
    JobView,
    Limits,
    ModelList,
    SignedUrl,
    UploadView,
    Validation,
)
from meshdeform.client.drivers import AsyncDriver
from meshdeform.client.paths import JobLike, job_path
from meshdeform.client.requests import Endpoint
from meshdeform.client.result import AsyncResult
from meshdeform.client.retries import Policy
from meshdeform.client.sources import AssetLike
from meshdeform.client.submitting import Files, Order
from meshdeform.record.models import JobState
from meshdeform.requests.document import DeformParams, JobKind, OutputOptions

__all__ = ["AsyncClient"]

Params = DeformParams | Mapping[str, Any]
Output = OutputOptions | Mapping[str, Any]


class AsyncClient:
    """One service. An async context manager; safe to share between tasks of an event loop.

    Callbacks may be functions or coroutine functions.

    Parameters
    ----------
    base_url : str, optional
        For example `https://meshdeform.example`; a path in it is kept. Default: `MESHDEFORM_URL`, else
        `http://127.0.0.1:8765`.
    api_key : str, optional
        Default: `MESHDEFORM_API_KEY`, else none. An empty one: none.
    timeout_s : float
        Seconds that one answer may be silent, and for which a request that failed is sent again.
    max_retries : int
        How often a request is sent again that got no answer, 408, 429, 502, 503 or 504. 0: never.
    http : httpx.AsyncClient, optional
        Used instead of an own one (proxies, certificates, tests), and left open.

    Raises
    ------
    MeshdeformError
        Every method raises the class of `meshdeform.errors` whose code the service answered; `UnavailableError` where
        it did not answer.
    ValueError
        The address, the key or a time cannot be right.
    """

    def __init__(
        self,
        base_url: str | None = None,
        *,
        api_key: str | None = None,
        timeout_s: float = 60.0,
        max_retries: int = 4,
        http: httpx.AsyncClient | None = None,
    ) -> None:
        if base_url is None and http is not None:
            base_url = str(http.base_url) or None
        self._endpoint = Endpoint.of(base_url, api_key, timeout_s)
        self._policy = Policy.of(timeout_s, max_retries)
        self._owned = http is None
        # As many connections as there are tasks: a stream of events keeps one.
        self._http = http or httpx.AsyncClient(limits=httpx.Limits(max_connections=None))
        self._driver = AsyncDriver(self._http, self._endpoint)

    def __repr__(self) -> str:
        return f"AsyncClient({self._endpoint.base_url!r})"

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    @property
    def base_url(self) -> str:
        """The service's address."""
        return self._endpoint.base_url

    async def aclose(self) -> None:
        """Close the connections."""
        if self._owned:
            await self._http.aclose()

    async def deform(
        self,
        asset: AssetLike,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
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
        """Post a job, wait until it is over, and return its result.

        Parameters
        ----------
        asset, prompt, params, output, target, metadata, priority, deadline_s, retention_s, kind
            As for `submit`.
        filename, upload, idempotency_key
            Likewise.
        on_event : callable, optional
            Gets every event as it happens.
        timeout_s : float, optional
            No limit unless given.
        cancel_on_interrupt : bool
            Ask for the job to be canceled where this task is: nobody would wait for it any more.

        Raises
        ------
        WaitTimeoutError
            It is not over in time. It goes on: the error's `extra["job_id"]` says which.
        MeshdeformError
            What was wrong with the request, or what the job failed with.
        """
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        files = Files.of(asset, target, filename, upload, idempotency_key)
        job = await self._driver.run(
            deforming.deformed(order, files, self._policy, on_event, timeout_s, cancel=cancel_on_interrupt)
        )
        return AsyncResult(self, job)

    async def submit(
        self,
        asset: AssetLike,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        metadata: Mapping[str, str] | None = None,
        priority: int | None = None,
        deadline_s: float | None = None,
        retention_s: float | None = None,
        kind: JobKind | str | None = None,
        filename: str | None = None,
        upload: bool | None = None,
        idempotency_key: str | None = None,
    ) -> JobView:
        """Post a job. It is made once, however often the request had to be sent.

        Parameters
        ----------
        asset : path, bytes, binary stream, UploadView or mapping
            GLB, OBJ, PLY or STL. A mapping names what the service has: `{"job_id": ..., "artifact": "result.glb"}`.
        prompt : str
            What it shall become.
        params : DeformParams or mapping, optional
            For example `{"preset": "preview", "seed": 7}`.
        output : OutputOptions or mapping, optional
        target : like `asset`, optional
            A second mesh, where `params` says `{"guidance": "target"}`.
        metadata : mapping, optional
            Your own labels.
        priority : int, optional
            The greater, the sooner.
        deadline_s, retention_s : float, optional
            Seconds after which it expires unless it is over; and after its end, after which it is deleted.
        kind : str, optional
            What the job does.
        filename : str, optional
            The name to send with bytes or a stream; its ending tells OBJ, PLY and STL apart.
        upload : bool, optional
            Whether files are sent ahead, in pieces. Default: those above 16 MiB are.
        idempotency_key : str, optional
            A name of this request of your own: the same within a day is done once, also by different processes.
        """
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        files = Files.of(asset, target, filename, upload, idempotency_key)
        return await self._driver.run(creating.submitted(order, files, self._policy))

    async def validate(
        self,
        asset: AssetLike,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        metadata: Mapping[str, str] | None = None,
        priority: int | None = None,
        deadline_s: float | None = None,
        retention_s: float | None = None,
        kind: JobKind | str | None = None,
        filename: str | None = None,
        upload: bool | None = None,
    ) -> Validation:
        """Check a job without posting it: what the asset holds, every parameter, how long it would take.

        Parameters and errors are those of `submit`.
        """
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        files = Files.of(asset, target, filename, upload, None)
        return await self._driver.run(creating.validated(order, files, self._policy))

    async def upload(
        self, asset: AssetLike, *, filename: str | None = None, idempotency_key: str | None = None
    ) -> UploadView:
        """Send a file ahead of its jobs; any number of them may name it."""
        return await self._driver.run(creating.sent_ahead(asset, filename, idempotency_key, self._policy))

    async def retry(self, job: JobLike, *, idempotency_key: str | None = None) -> JobView:
        """Try a job again that did not succeed: a new job that goes on from its last checkpoint."""
        return await self._driver.run(creating.retried(job, idempotency_key, self._policy))

    async def branch(
        self,
        job: JobLike,
        step: int,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        metadata: Mapping[str, str] | None = None,
        priority: int | None = None,
        deadline_s: float | None = None,
        retention_s: float | None = None,
        kind: JobKind | str | None = None,
        idempotency_key: str | None = None,
    ) -> JobView:
        """Post a job on the same asset that begins with the shape of a checkpoint; see `checkpoints`."""
        order = Order(prompt, params, output, metadata, priority, deadline_s, retention_s, kind)
        return await self._driver.run(creating.branched(job, step, order, target, idempotency_key, self._policy))

    async def get(self, job: JobLike) -> JobView:
        """Look at a job."""
        return await self._driver.run(looking.got(job, self._policy))

    def jobs(
        self, *, state: JobState | str | None = None, metadata: Mapping[str, str] | None = None, limit: int = 50
    ) -> AsyncIterator[JobView]:
        """Go through the jobs, newest first, a page of `limit` at a time."""
        return self._driver.iterate(looking.listed(state, dict(metadata or {}), limit, self._policy))

    def watch(self, job: JobLike, *, after: int | None = None) -> AsyncIterator[EventView]:
        """Follow a job: every event once and in order, over any number of connections, until the one that ends it.

        Parameters
        ----------
        job : JobView or str
        after : int, optional
            `seq` of the last event that you have. Default: from the first one on.

        Raises
        ------
        UnavailableError
            The service does not answer for longer than five times `timeout_s`; shorter absences do not show.
        """
        return self._driver.iterate(events.followed(looking.identity(job), after or 0, self._policy, Emit))

    async def wait(
        self,
        job: JobLike,
        *,
        timeout_s: float | None = None,
        on_change: Callable[[JobView], Any] | None = None,
        on_event: Callable[[EventView], Any] | None = None,
        check: bool = True,
    ) -> JobView:
        """Wait until a job is over. An unchanged job costs a 304; the pace is the service's own.

        Parameters
        ----------
        job : JobView or str
        timeout_s : float, optional
            No limit unless given.
        on_change : callable, optional
            Gets the job whenever it has changed.
        on_event : callable, optional
            Gets every event as it happens, from the first one on.
        check : bool
            Raise unless it succeeded.

        Raises
        ------
        WaitTimeoutError
            It is not over in time. It goes on. A `TimeoutError`, too.
        MeshdeformError
            With `check`: what the job failed with, or `ConflictError` where it was canceled or has expired.
        """
        return await self._driver.run(
            looking.waited(job, self._policy, timeout_s=timeout_s, on_change=on_change, on_event=on_event, check=check)
        )

    async def result(self, job: JobLike, *, timeout_s: float | None = None) -> AsyncResult:
        """Wait until a job has succeeded, and return its result; errors are those of `wait`."""
        return AsyncResult(self, await self.wait(job, timeout_s=timeout_s))

    async def cancel(self, job: JobLike) -> JobView:
        """Ask for a job to be canceled."""
        return await self._driver.run(looking.canceled(job, self._policy))

    async def delete(self, job: JobLike) -> None:
        """Delete a job that is over, with its artifacts."""
        await self._driver.run(looking.deleted(job, self._policy))

    async def artifacts(self, job: JobLike) -> list[ArtifactView]:
        """Return a job's artifacts, by name."""
        return await self._driver.run(looking.artifacts(job, self._policy))

    async def checkpoints(self, job: JobLike) -> list[CheckpointView]:
        """Return where a job can go on from, by step."""
        return await self._driver.run(looking.checkpoints(job, self._policy))

    async def signed_url(self, job: JobLike, name: str) -> SignedUrl:
        """Return a URL of an artifact that needs no API key."""
        return await self._driver.run(looking.signed_url(job, name, self._policy))

    async def limits(self) -> Limits:
        """Return everything that a caller controls, with its limit."""
        return await self._driver.run(looking.limits(self._policy))

    async def models(self) -> ModelList:
        """Return the models that jobs may name."""
        return await self._driver.run(looking.models(self._policy))

    async def read(self, job: JobLike, name: str) -> bytes:
        """Return an artifact's bytes, their SHA-256 compared."""
        return await self._driver.run(downloads.loaded(job_path(job, "artifacts", name), self._policy))

    async def download(self, job: JobLike, name: str, path: str | os.PathLike[str]) -> Path:
        """Save an artifact. The file appears whole, with its SHA-256 compared, or not at all.

        A download that breaks off goes on where it stopped. A file that is there is replaced.
        """
        return await self._driver.run(downloads.saved(job_path(job, "artifacts", name), Path(path), self._policy))

    async def fetch(
        self, job: JobLike, folder: str | os.PathLike[str], names: Sequence[str] | None = None
    ) -> list[Path]:
        """Save a job's artifacts into a folder, which is made. A file that is there and the same is not sent again.

        Parameters
        ----------
        job : JobView or str
        folder : path
        names : sequence of str, optional
            Which of them. Default: all.

        Raises
        ------
        NotFoundError
            The job has no artifact of such a name.
        """
        return await self._driver.run(downloads.fetched(job, Path(folder), names, self._policy))

    async def download_asset(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the asset as it was sent; the job may be in any state."""
        return await self._driver.run(downloads.saved(job_path(job, "asset"), Path(path), self._policy))

    async def download_target(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the second mesh of `target` guidance as it was sent."""
        return await self._driver.run(downloads.saved(job_path(job, "target"), Path(path), self._policy))

    async def download_checkpoint(self, job: JobLike, step: int, path: str | os.PathLike[str]) -> Path:
        """Save the asset with its shape at a checkpoint."""
        return await self._driver.run(
            downloads.saved(job_path(job, "checkpoints", step, "mesh.glb"), Path(path), self._policy)
        )
