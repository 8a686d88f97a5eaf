"""Provide the client for event loops."""

from __future__ import annotations

import contextlib
import json
import math
import os
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, TypeVar, Unpack

import httpx
from pydantic import BaseModel

from meshdeform.api.documents import (
    FoundParts,
    LimitList,
    ModelList,
    SketchGuesses,
    UploadView,
    UsageList,
    UsageMonth,
    WordDetail,
    WordList,
    WordView,
)
from meshdeform.api.jobs import (
    ArtifactList,
    ArtifactView,
    CheckpointList,
    CheckpointView,
    EventView,
    SignedUrl,
)
from meshdeform.api.states import JobState
from meshdeform.client.asynchronous.connection import AsyncConnection, pause, shielded, tell, work
from meshdeform.client.asynchronous.transfers import (
    followed,
    loaded,
    prepared,
    prepared_word,
    saved,
    uploaded,
)
from meshdeform.client.documents import (
    AFTERWARDS,
    GLB,
    PREVIEW,
    REPORT,
    JobList,
    JobView,
    Validation,
    html_of,
    is_same,
    label,
    read,
)
from meshdeform.client.orders import (
    AssetLike,
    Files,
    JobOptions,
    LocalFile,
    Order,
    Output,
    Params,
    UploadProgress,
    checked_key,
    open_source,
    refer,
)
from meshdeform.client.problems import succeeded
from meshdeform.client.requests import (
    Call,
    Endpoint,
    FormFile,
    JobLike,
    artifact_path,
    identity,
    job_path,
    word_path,
)
from meshdeform.client.retries import Patience, Policy, left_s, pace
from meshdeform.errors import (
    AssetNotKeptError,
    ChecksumError,
    JobNotFinishedError,
    MeshdeformError,
    NotFoundError,
    UnavailableError,
)
from meshdeform.requests.choices import PartsAs
from meshdeform.requests.previews import PreviewShapes
from meshdeform.verdicts import read_verdict

M = TypeVar("M", bound=BaseModel)
_FAREWELL_S = 5.0
_HELD_S = 30
_MAKE_S = 300.0
_LEAST_PACE_S, _MOST_PACE_S = 0.05, 30.0


class AsyncClient:
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
    on_upload : callable, optional
        Called with the `UploadProgress` of a file that is uploaded, whenever a piece has arrived.

    Raises
    ------
    MeshdeformError
        Every method raises the class of `meshdeform.errors` for the code in the service's response, or
        `UnavailableError` if there was no response.
    ValueError
        The address, the key or a time is invalid.
    """

    def __init__(
        self,
        base_url: str | None = None,
        *,
        api_key: str | None = None,
        timeout_s: float = 60.0,
        max_retries: int = 4,
        http: httpx.AsyncClient | None = None,
        on_upload: Callable[[UploadProgress], Any] | None = None,
    ) -> None:
        if base_url is None and http is not None:
            base_url = str(http.base_url) or None
        self._endpoint = Endpoint.of(base_url, api_key, timeout_s)
        policy = Policy.of(timeout_s, max_retries)
        self._owned = http is None
        # No limit on connections: each task that follows events keeps one open.
        self._http = http or httpx.AsyncClient(limits=httpx.Limits(max_connections=None))
        self._connection = AsyncConnection(self._http, self._endpoint, policy, on_upload)
        self._kept: set[str] = set()  # SHA-256 of the assets of previews, which the service may still have

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._endpoint.base_url!r})"

    @property
    def base_url(self) -> str:
        """The service's address."""
        return self._endpoint.base_url

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

    async def deform(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        webhook: str | Mapping[str, Any] | None = None,
        filename: str | None = None,
        upload: bool | None = None,
        idempotency_key: str | None = None,
        on_event: Callable[[EventView], Any] | None = None,
        timeout_s: float | None = None,
        cancel_on_interrupt: bool = True,
        **options: Unpack[JobOptions],
    ) -> AsyncResult:
        """Post a job, wait until it has finished, and return its result.

        Parameters
        ----------
        asset, prompt, webhook, filename, upload, idempotency_key, options
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
        order = Order(prompt, webhook=webhook, **options)
        request_files = Files.of(asset, order, filename, upload, idempotency_key)
        job = await self._submit(order, request_files)
        try:
            return AsyncResult(self, await self.wait(job, timeout_s=timeout_s, on_event=on_event))
        except (Exception, GeneratorExit):
            raise
        except BaseException:
            # KeyboardInterrupt, SystemExit, a canceled task.
            if cancel_on_interrupt:
                patience = Patience(self._connection.policy, retries=1, seconds=_FAREWELL_S)
                with shielded(_FAREWELL_S), contextlib.suppress(MeshdeformError):
                    await self._connection.answered(Call("POST", job_path(job, "cancel")), patience)
            raise

    async def submit(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        webhook: str | Mapping[str, Any] | None = None,
        filename: str | None = None,
        upload: bool | None = None,
        idempotency_key: str | None = None,
        **options: Unpack[JobOptions],
    ) -> JobView:
        """Post a job. It is created only once, even if the request is retried.

        Parameters
        ----------
        asset : path, bytes, binary stream, UploadView or mapping
            GLB, OBJ, PLY, STL or ZIP. A mapping names a stored file: `{"job_id": ..., "artifact": "result.glb"}`.
        prompt : str
            What the asset should become.
        webhook : str or mapping, optional
            A URL for messages about this job, or `{"url": ..., "events": ["job.succeeded"]}`.
        filename : str, optional
            The file name to send with bytes or a stream; its extension identifies OBJ, PLY and STL.
        upload : bool, optional
            Whether to upload files in pieces before posting the job; each is sent once within a day, however many jobs
            have it. Default: only files above 1 MiB.
        idempotency_key : str, optional
            Your own key for this request: requests with the same key within a day, also from other processes, create
            only one job.
        **options : JobOptions
            `params`, `target`, `metadata` and the others of `meshdeform.client.orders.JobOptions`.
        """
        order = Order(prompt, webhook=webhook, **options)
        request_files = Files.of(asset, order, filename, upload, idempotency_key)
        return await self._submit(order, request_files)

    async def _submit(self, order: Order, files: Files) -> JobView:
        job, verified = await self._post(JobView, "/v1/jobs", order, files)
        for name, file in verified.items():
            there = job.files.get(name)
            if there is None or there.sha256 != file.sha256:
                with contextlib.suppress(MeshdeformError):
                    await self.cancel(job)
                raise ChecksumError(
                    f"The {name} that arrived differs from the one that was sent; the job {job.id} is canceled.",
                    advice="The file may have changed while it was sent. Post it again.",
                    job_id=job.id,
                )
        return job

    async def _post(self, model: type[M], url: str, order: Order, files: Files) -> tuple[M, dict[str, LocalFile]]:
        """Post an order, and return the document of the response and the local files that were sent."""
        with contextlib.ExitStack() as opened:
            call, verified = await prepared(self._connection, url, order, files, opened)
            return await self._connection.document(model, call), verified

    async def validate(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        filename: str | None = None,
        upload: bool | None = None,
        **options: Unpack[JobOptions],
    ) -> Validation:
        """Check a job without posting it, and return the asset's contents, all parameters and a time estimate.

        Parameters and errors are those of `submit`.
        """
        order = Order(prompt, **options)
        request_files = Files.of(asset, order, filename, upload)
        validation, _ = await self._post(Validation, "/v1/jobs:validate", order, request_files)
        return validation

    async def parts(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        params: Params | None = None,
        glb: PartsAs | str | None = None,
        filename: str | None = None,
        upload: bool | None = None,
    ) -> FoundParts:
        """Read an asset: what it is, and the parts that words can name, each with its triangles and what can be asked.

        `params` correct the noun (`guidance.source_noun`), the front (`guidance.orientation`, in degrees) and the parts
        (`control.parts`). With a prompt that is a change in plain words ("legs longer by 30 %"), only the parts that it
        names, and as `glb` what it makes of the asset, without a job. Parameters and errors are those of `submit`.

        Parameters
        ----------
        glb : PartsAs, optional
            Give the asset back with its parts, as `glb`: as the vertex attribute `_PART`, as `materials` or as `nodes`.

        Raises
        ------
        PartNotFoundError
            The prompt names a part that the asset lacks.
        DependencyError, UnavailableError
            The service cannot find parts, or cannot find them now.
        """
        order = Order(prompt, params)
        url = "/v1/jobs:parts" if glb is None else f"/v1/jobs:parts?glb={PartsAs(glb).value}"
        parts_found, _ = await self._post(FoundParts, url, order, Files.of(asset, order, filename, upload))
        return parts_found

    async def preview(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        seeds: Sequence[int] = (),
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        files: Mapping[str, AssetLike] | None = None,
        filename: str | None = None,
        draft: bool = False,
    ) -> PreviewShapes:
        """Return the shapes that a job would give the asset, within seconds and without one.

        They are the positions of the vertices of `result.glb`, quantised. The file is sent with the first preview, and
        again when the service has forgotten it. Parameters and errors are those of `submit`.

        Parameters
        ----------
        seeds : sequence of int, optional
            Up to 6 seeds, one for each shape. Default: that of the parameters.
        draft : bool
            Whether a draft will do, unmended, which takes about half as long; of a large asset, seconds, not minutes.

        Raises
        ------
        LimitError
            Too many previews are made at the moment.
        DependencyError, UnavailableError
            The service cannot make previews, or it takes too long.
        """
        order = Order(prompt, params, output, target, files, seeds=seeds or None)
        sent = Files.of(asset, order, filename, upload=False)
        made = await self._previewed({"as": "positions", "draft": str(draft).lower()}, order, sent)
        return PreviewShapes.read(made)

    async def preview_glb(
        self,
        asset: AssetLike | None = None,
        prompt: str = "",
        *,
        params: Params | None = None,
        output: Output | None = None,
        target: AssetLike | None = None,
        files: Mapping[str, AssetLike] | None = None,
        filename: str | None = None,
    ) -> bytes:
        """Return the bytes of `result.glb` that a job would make. Parameters and errors are those of `preview`."""
        order = Order(prompt, params, output, target, files)
        return await self._previewed({"as": "glb"}, order, Files.of(asset, order, filename, upload=False))

    async def _previewed(self, query: Mapping[str, str], order: Order, files: Files) -> bytes:
        with contextlib.ExitStack() as opened:
            call, sent = await prepared(self._connection, "/v1/jobs:preview", order, files, opened)
            call = replace(call, query=query, read_timeout_s=_MAKE_S)
            asset = sent.get("asset")
            if asset is not None and asset.sha256 in self._kept:
                others = tuple(each for each in call.files if each.name != "asset")
                document = {**call.document, "asset": {"sha256": asset.sha256, "filename": asset.filename}}
                with contextlib.suppress(AssetNotKeptError):
                    return (await self._connection.answered(replace(call, document=document, files=others))).content
            answer = await self._connection.answered(call)
            if asset is not None:
                self._kept.add(asset.sha256)
            return answer.content

    async def upload(
        self, asset: AssetLike, *, filename: str | None = None, idempotency_key: str | None = None
    ) -> UploadView:
        """Upload a file for use in any number of jobs.

        Raises
        ------
        ValueError
            The service already has the file.
        """
        with contextlib.ExitStack() as opened:
            source = await work(open_source, asset, opened, filename)
            if not isinstance(source, LocalFile):
                raise ValueError("The service already has this file: use the reference.")  # noqa: TRY004
            return await uploaded(self._connection, source, checked_key(idempotency_key) if idempotency_key else "")

    async def retry(
        self, job: JobLike, *, max_run_s: float | None = None, idempotency_key: str | None = None
    ) -> JobView:
        """Retry a job that did not succeed, as a new job that continues from its last checkpoint.

        `max_run_s`: seconds for which the new job may run. Default: as for the old one.
        """
        headers = {"Idempotency-Key": checked_key(idempotency_key)}
        document = None if max_run_s is None else {"max_run_s": max_run_s}
        call = Call("POST", job_path(job, "retry"), headers=headers, document=document)
        return await self._connection.document(JobView, call)

    async def branch(
        self,
        job: JobLike,
        step: int,
        prompt: str = "",
        *,
        idempotency_key: str | None = None,
        **options: Unpack[JobOptions],
    ) -> JobView:
        """Post a job on the same asset that starts from the shape of a checkpoint; see `checkpoints`."""
        order = Order(prompt, **options)
        key, document = checked_key(idempotency_key), order.document()
        for name, file in order.by_field().items():
            with contextlib.ExitStack() as opened:
                source = await work(open_source, file, opened)
                if isinstance(source, LocalFile):
                    # The route takes no form, so that files must be uploaded first.
                    upload = await uploaded(self._connection, source)
                    source = {"upload_id": upload.id}
                refer(document, name, source)
        path = job_path(job, "checkpoints", step, "branch")
        call = Call("POST", path, headers={"Idempotency-Key": key}, document=document)
        return await self._connection.document(JobView, call)

    async def get(self, job: JobLike) -> JobView:
        """Return a job's current state."""
        return await self._connection.document(JobView, Call("GET", job_path(job)))

    def jobs(
        self,
        *,
        state: JobState | str | None = None,
        metadata: Mapping[str, str] | None = None,
        created_after: datetime | None = None,
        search: str = "",
        error: str = "",
        limit: int = 50,
    ) -> AsyncIterator[JobView]:
        """Iterate over the jobs, newest first, requesting pages of `limit`. A naive `created_after` is local time.

        `search` finds jobs whose prompts, file names or values of labels contain all of its words, `error` those that
        failed with an error of this code.
        """
        query: dict[str, str | int] = {"limit": limit}
        query |= {f"metadata[{name}]": text for name, text in (metadata or {}).items()}
        if state is not None:
            query["state"] = str(state)
        if created_after is not None:
            query["created_after"] = created_after.astimezone().isoformat()
        if search:
            query["q"] = search
        if error:
            query["error"] = error
        return self._pages(query)

    async def _pages(self, query: dict[str, str | int]) -> AsyncIterator[JobView]:
        while True:
            page = await self._connection.document(JobList, Call("GET", "/v1/jobs", query=query))
            for job in page.jobs:  # threads: yield from page.jobs
                yield job  # threads:
            if page.next_cursor is None:
                return
            query["cursor"] = page.next_cursor

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
        return followed(self._connection, identity(job), after or 0)

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
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        job_id = identity(job)
        if on_event is not None:
            async with contextlib.aclosing(followed(self._connection, job_id, 0, deadline)) as events:
                async for event in events:
                    await tell(on_event, event)
        if on_event is not None and on_change is None:
            done = await self.get(job_id)
        else:
            done = await self._poll(job_id, deadline, on_change)
        return succeeded(done) if check else done

    async def _poll(self, job_id: str, deadline: float | None, on_change: Callable[[JobView], Any] | None) -> JobView:
        """Poll a job until it has finished; without `on_change`, use long polling."""
        policy = self._connection.policy
        tag, retries = "", None if policy.max_retries else 0
        while True:
            left = math.inf if deadline is None else max(deadline - time.monotonic(), 0.0)
            held_s = 0 if on_change is not None else int(min(_HELD_S, left))
            headers = {"If-None-Match": tag} if tag else {}
            if held_s:
                headers["Prefer"] = f"wait={held_s}"
            call = Call("GET", job_path(job_id), headers=headers, read_timeout_s=policy.timeout_s + held_s)
            started = time.monotonic()
            patience = Patience(policy, retries=retries, seconds=min(policy.reconnect_s, left))
            answer = await self._connection.answered(call, patience)
            if answer.status != 304:
                job = read(JobView, answer.json(), answer.url)
                tag = answer.headers.get("etag", "")
                if on_change is not None:
                    await tell(on_change, job)
                if job.state.terminal:
                    return job
            pause_s = pace(answer, 1.0, _LEAST_PACE_S, _MOST_PACE_S)
            if held_s and time.monotonic() - started >= 0.5 * held_s:
                pause_s = 0.0  # the long poll has already waited
            pause_s = min(pause_s, left_s(deadline, job_id))
            if pause_s:
                await pause(pause_s)

    async def result(self, job: JobLike, *, timeout_s: float | None = None) -> AsyncResult:
        """Wait until a job has succeeded and return its result; errors are those of `wait`."""
        return AsyncResult(self, await self.wait(job, timeout_s=timeout_s))

    async def cancel(self, job: JobLike) -> JobView:
        """Request cancellation of a job."""
        return await self._connection.document(JobView, Call("POST", job_path(job, "cancel")))

    async def delete(self, job: JobLike) -> None:
        """Delete a finished job with its artifacts."""
        await self._connection.answered(Call("DELETE", job_path(job)))

    async def artifacts(self, job: JobLike) -> list[ArtifactView]:
        """Return a job's artifacts, sorted by name."""
        page = await self._connection.document(ArtifactList, Call("GET", job_path(job, "artifacts")))
        return page.artifacts

    async def make(self, job: JobLike, name: str) -> ArtifactView:
        """Add an artifact of `AFTERWARDS` to a job that has succeeded without it; its `warnings` say what is lost.

        Raises
        ------
        AssetError
            It cannot be made of the job's files.
        DependencyError
            The service cannot write the format.
        """
        call = Call("POST", job_path(job, "artifacts", name), read_timeout_s=_MAKE_S)
        return await self._connection.document(ArtifactView, call)

    async def apply(self, job: JobLike, file: str | Path, *, outside: Literal["refuse", "rigid"] = "refuse") -> bytes:
        """Return a file as a GLB that is deformed as the job's asset was: a level of detail, clothes, a prop.

        Parameters
        ----------
        outside : "refuse" or "rigid"
            Of connected pieces that reach out of the box around the job's asset: refuse the file, or carry them along
            in their shape.

        Raises
        ------
        AssetError, ParameterError
            The file cannot be read, or lies elsewhere than the asset.
        """
        path = Path(file)
        call = Call(
            "POST",
            job_path(job, "apply"),
            query={"filename": path.name, "outside": outside},
            headers={"Content-Type": "application/octet-stream"},
            content=path.read_bytes(),
            read_timeout_s=_MAKE_S,
        )
        return (await self._connection.answered(call)).content

    async def checkpoints(self, job: JobLike) -> list[CheckpointView]:
        """Return the checkpoints from which a job can continue, sorted by step."""
        page = await self._connection.document(CheckpointList, Call("GET", job_path(job, "checkpoints")))
        return page.checkpoints

    async def signed_url(self, job: JobLike, name: str) -> SignedUrl:
        """Return a URL of an artifact that needs no API key."""
        return await self._link(job_path(job, "artifacts", name, "url"))

    async def job_link(self, job: JobLike) -> SignedUrl:
        """Return a link to a job's page: whoever has it can watch this job and read its files until it expires."""
        return await self._link(job_path(job, "url"))

    async def _link(self, path: str) -> SignedUrl:
        """Return the link that a service answers with, absolute: services name their own pages by path."""
        answer = await self._connection.answered(Call("POST", path))
        link = read(SignedUrl, answer.json(), answer.url)
        if "://" in link.url:
            return link
        return link.model_copy(update={"url": answer.url.rpartition("/v1/jobs/")[0] + link.url})

    async def limits(self) -> LimitList:
        """Return the service's limits on requests."""
        return await self._connection.document(LimitList, Call("GET", "/v1/limits"))

    async def usage(self) -> list[UsageMonth]:
        """Return what your jobs have used in each month, newest first."""
        return (await self._connection.document(UsageList, Call("GET", "/v1/usage"))).months

    async def models(self) -> ModelList:
        """Return the models that jobs may use."""
        return await self._connection.document(ModelList, Call("GET", "/v1/models"))

    async def add_word(
        self,
        noun: str,
        meshes: Sequence[AssetLike],
        *,
        synonyms: Sequence[str] = (),
        like: str = "",
        front: float | None = None,
        fronts: Mapping[str, float] | None = None,
        licence: str = "",
        replace: bool = False,
    ) -> WordView:
        """Make a word of your own of meshes, which your prompts can name at once.

        Parameters
        ----------
        noun : str
            What they are.
        meshes : sequence of assets
            One or more, or ZIPs of several.
        synonyms : sequence of str
            Other names for it.
        like : str
            A noun of ours as whose parts theirs are read. Default: what the first looks like.
        front : float, optional
            Where all face, in degrees: 0 is +Z, 90 is +X. Default: found with the parts, else +Z.
        fronts : mapping, optional
            Where some face, by the names of their files.
        licence : str
            Of the meshes, in a few words.
        replace : bool
            Take the place of your word of that noun, or of ours, for you.

        Raises
        ------
        AssetError
            A mesh cannot be used; nothing was kept.
        ParameterError
            The noun is taken, the meshes face differently, or there would be too many words.
        DependencyError, UnavailableError
            The service cannot make words, or cannot make them now.
        """
        said: dict[str, Any] = {"noun": noun, "synonyms": list(synonyms), "like": like, "licence": licence}
        said |= {"front": front, "fronts": dict(fronts or {}), "replace": replace}
        with contextlib.ExitStack() as opened:
            call = await prepared_word(self._connection, said, meshes, checked_key(None), opened)
            return (await self._connection.document(WordList, call)).words[0]

    async def import_words(self, file: AssetLike, *, replace: bool = False) -> list[WordView]:
        """Keep the words of a file that `export_word` or the command line wrote, all or none; `replace` as there."""
        with contextlib.ExitStack() as opened:
            source = await work(open_source, file, opened)
            if not isinstance(source, LocalFile):
                raise ValueError("Words are imported of a local file.")  # noqa: TRY004
            form_file = FormFile("word", source.filename, source.file)
            headers = {"Idempotency-Key": checked_key(None)}
            call = Call("POST", "/v1/words", headers=headers, document={"replace": replace}, files=(form_file,))
            return (await self._connection.document(WordList, call)).words

    async def words(self) -> list[WordView]:
        """Return your words, by the alphabet."""
        return (await self._connection.document(WordList, Call("GET", "/v1/words"))).words

    async def word(self, noun: str) -> WordDetail:
        """Return a word of yours with its meshes."""
        return await self._connection.document(WordDetail, Call("GET", word_path(noun)))

    async def export_word(self, noun: str) -> bytes:
        """Return a word's file, for `import_words` of others; several may be joined."""
        return await loaded(self._connection, word_path(noun, "content"))

    async def draw_word(self, noun: str) -> bytes:
        """Return a PNG of a word's meshes, coloured by their parts; of many, some."""
        return (await self._connection.answered(Call("GET", word_path(noun, "picture.png")))).content

    async def delete_word(self, noun: str) -> None:
        """Delete a word. Jobs that have it keep it."""
        await self._connection.answered(Call("DELETE", word_path(noun)))

    async def read(self, job: JobLike, name: str, *, strength: float | None = None, pose: str | None = None) -> bytes:
        """Return an artifact's bytes after verifying their SHA-256.

        Parameters
        ----------
        job : JobView or str
        name : str
        strength : float, optional
            Of `result.glb`: from 0, the source, over 1, the result, to 1.5, in steps of 0.01.
        pose : str, optional
            Of `result.glb` and its other formats: `CLIP@SECONDS`, a moment of an animation, without the rig.
        """
        return await loaded(self._connection, artifact_path(job, name, strength, pose))

    async def download(
        self,
        job: JobLike,
        name: str,
        path: str | os.PathLike[str],
        *,
        strength: float | None = None,
        pose: str | None = None,
    ) -> Path:
        """Save an artifact. The file appears complete, with its SHA-256 verified, or not at all.

        An interrupted download resumes where it stopped. An existing file is replaced. `strength`, `pose`: as for
        `read`.
        """
        return await saved(self._connection, artifact_path(job, name, strength, pose), Path(path))

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
        there = {artifact.name: artifact for artifact in await self.artifacts(job)}
        if not there:
            view = await self.get(job)
            if not view.state.terminal:
                detail = f"The job {view.id} is {view.state}: it has no artifacts yet."
                raise JobNotFinishedError(detail, advice="Wait until it has finished.", job_id=view.id)
            succeeded(view)
        requested = list(there) if names is None else list(names)
        for name in requested:
            if name not in there:
                if name not in AFTERWARDS:
                    present = ", ".join(there) or "none"
                    raise NotFoundError(f"The job {identity(job)} has no artifact {name!r}; it has: {present}.")
                there[name] = await self.make(job, name)
            if not name or Path(name).name != name or name in (".", "..") or "\\" in name:
                raise UnavailableError(f"The artifact's name {name!r} is not a file name.", advice="Check the service.")
        directory = Path(folder)
        await work(lambda: directory.mkdir(parents=True, exist_ok=True))
        for name in requested:
            if not await work(is_same, directory / name, there[name]):
                url = job_path(job, "artifacts", name)
                await saved(self._connection, url, directory / name, there[name].sha256)
        return [directory / name for name in requested]

    async def download_asset(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the asset as it was sent, for a job in any state."""
        return await saved(self._connection, job_path(job, "asset"), Path(path))

    async def download_file(self, job: JobLike, part: str, path: str | os.PathLike[str]) -> Path:
        """Save a file of a job of any kind as it was sent, by the name of its field."""
        return await saved(self._connection, job_path(job, "files", part), Path(path))

    async def download_checkpoint(self, job: JobLike, step: int, path: str | os.PathLike[str]) -> Path:
        """Save the asset with its shape at a checkpoint."""
        return await saved(self._connection, job_path(job, "checkpoints", step, "mesh.glb"), Path(path))

    async def guess_sketch(self, drawing: bytes | str | os.PathLike[str], *, noun: str | None = None) -> SketchGuesses:
        """Guess what a drawing shows: three nouns with their sliders and a mesh each.

        Parameters
        ----------
        drawing : bytes or path
            A PNG, JPEG or WebP.
        noun : str, optional
            What it shows; nothing else is considered.

        Raises
        ------
        DrawingError
            The picture is no line drawing.
        ParameterError
            There is no such noun.
        DependencyError, UnavailableError
            The service cannot read drawings, or cannot read them now.
        """
        data = drawing if isinstance(drawing, bytes) else await work(Path(drawing).read_bytes)
        query = {} if noun is None else {"noun": noun}
        headers = {"Content-Type": "application/octet-stream"}
        call = Call("POST", "/v1/sketches:guess", query=query, headers=headers, content=data)
        return await self._connection.document(SketchGuesses, call)

    async def make_sketch_mesh(self, noun: str, values: Mapping[str, float | str] | None = None) -> bytes:
        """Return the GLB of a shape of a noun; sliders left out have their default.

        Raises
        ------
        ParameterError
            There is no such noun, a name is unknown, or a value is out of range.
        """
        document = {"noun": noun, "values": dict(values or {})}
        answer = await self._connection.answered(Call("POST", "/v1/sketches:mesh", document=document))
        return answer.content


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

    async def verdict(self) -> dict[str, Any] | None:
        """Return what the result is worth by the report, None where it does not say.

        Returns dict: `value`, one of `good`, `doubtful` and `keep_source`, where the asset was better as it was; and
        sentences: its `reasons`, and the `advice` that may help.
        """
        return read_verdict(await self.report())

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
