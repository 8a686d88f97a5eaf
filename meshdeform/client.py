"""A client of the HTTP API. Needs nothing but the base install: no torch, no web framework.

>>> client = Client("http://127.0.0.1:8765")                          # doctest: +SKIP
>>> job = client.submit("examples/sphere.glb", "a mushroom")          # doctest: +SKIP
>>> client.wait(job.id)                                               # doctest: +SKIP
>>> client.download(job.id, "result.glb", "mushroom.glb")             # doctest: +SKIP
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import httpx

from meshdeform.config import DeformParams, OutputOptions
from meshdeform.errors import ConflictError, MeshdeformError, UnavailableError
from meshdeform.jobs.models import JobState
from meshdeform.jobs.views import ArtifactList, ArtifactView, JobList, JobView

__all__ = ["Client"]

_PROBLEM_MEMBERS = frozenset({"type", "title", "status", "detail", "code", "advice", "instance"})
_MIN_POLL_S, _MAX_POLL_S = 0.05, 30.0


class Client:
    """One service. A context manager; safe to share between threads.

    Parameters
    ----------
    base_url : str
        For example `http://127.0.0.1:8765`.
    timeout_s : float
        How long one answer may take.
    http : httpx.Client, optional
        Used instead of an own one, and left open.

    Raises
    ------
    MeshdeformError
        Every method raises the class of `meshdeform.errors` whose code the service answered;
        `UnavailableError` where it did not answer.
    """

    def __init__(self, base_url: str, *, timeout_s: float = 60.0, http: httpx.Client | None = None) -> None:
        self._owned = http is None
        self._http = http or httpx.Client(base_url=base_url, timeout=timeout_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        if self._owned:
            self._http.close()

    def submit(
        self,
        asset: str | os.PathLike[str],
        prompt: str = "",
        *,
        params: DeformParams | Mapping[str, Any] | None = None,
        output: OutputOptions | Mapping[str, Any] | None = None,
        metadata: Mapping[str, str] | None = None,
        target: str | os.PathLike[str] | None = None,
    ) -> JobView:
        """Post a job.

        Parameters
        ----------
        asset : path
            GLB, OBJ, PLY or STL.
        prompt : str
            What it shall become.
        params : DeformParams or mapping, optional
            For example `{"preset": "preview", "seed": 7}`.
        output : OutputOptions or mapping, optional
        metadata : mapping, optional
            Your own labels.
        target : path, optional
            A second mesh, where `params` says `{"guidance": "target"}`.
        """
        document = {
            "prompt": prompt,
            "params": params if params is not None else {},
            "output": output if output is not None else {},
            "metadata": dict(metadata or {}),
        }
        text = _as_json(document)
        with contextlib.ExitStack() as files:
            parts: dict[str, tuple[str | None, IO[bytes] | str, str]] = {
                "request": (None, text, "application/json"),
                "asset": _file_part(Path(asset), files),
            }
            if target is not None:
                parts["target"] = _file_part(Path(target), files)
            return JobView.model_validate(self._call("POST", "/v1/jobs", files=parts).json())

    def get(self, job_id: str) -> JobView:
        """Look at a job."""
        return JobView.model_validate(self._call("GET", f"/v1/jobs/{job_id}").json())

    def jobs(self, *, state: JobState | str | None = None, limit: int = 50) -> Iterator[JobView]:
        """Go through the jobs, newest first, a page of `limit` at a time."""
        query: dict[str, str | int] = {"limit": limit}
        if state is not None:
            query["state"] = JobState(state).value
        while True:
            page = JobList.model_validate(self._call("GET", "/v1/jobs", params=query).json())
            yield from page.jobs
            if page.next_cursor is None:
                return
            query["cursor"] = page.next_cursor

    def wait(
        self,
        job_id: str,
        *,
        timeout_s: float | None = None,
        on_change: Callable[[JobView], None] | None = None,
        check: bool = True,
    ) -> JobView:
        """Wait until a job is over. An unchanged job costs a 304; the pace is the service's own.

        Parameters
        ----------
        job_id : str
        timeout_s : float, optional
            No limit unless given.
        on_change : callable, optional
            Gets the job whenever it has changed.
        check : bool
            Raise unless it succeeded.

        Raises
        ------
        TimeoutError
            It is not over in time. It goes on.
        MeshdeformError
            With `check`: what the job failed with, or `ConflictError` where it was canceled.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        job: JobView | None = None
        tag = ""
        while True:
            answer = self._call("GET", f"/v1/jobs/{job_id}", headers={"If-None-Match": tag} if tag else {})
            if answer.status_code != httpx.codes.NOT_MODIFIED:
                job, tag = JobView.model_validate(answer.json()), answer.headers.get("ETag", "")
                if on_change is not None:
                    on_change(job)
                if job.state.terminal:
                    return _succeeded(job) if check else job
            pause = _retry_after(answer)
            if deadline is not None:
                left = deadline - time.monotonic()
                if left <= 0:
                    raise TimeoutError(f"The job {job_id} is not over after {timeout_s:g} s.")
                pause = min(pause, left)
            time.sleep(pause)

    def cancel(self, job_id: str) -> JobView:
        """Ask for a job to be canceled."""
        return JobView.model_validate(self._call("POST", f"/v1/jobs/{job_id}/cancel").json())

    def delete(self, job_id: str) -> None:
        """Delete a job that is over, with its artifacts."""
        self._call("DELETE", f"/v1/jobs/{job_id}")

    def artifacts(self, job_id: str) -> list[ArtifactView]:
        """Return a job's artifacts, by name."""
        answer = self._call("GET", f"/v1/jobs/{job_id}/artifacts")
        return list(ArtifactList.model_validate(answer.json()).artifacts)

    def download(self, job_id: str, name: str, path: str | os.PathLike[str], *, tries: int = 3) -> Path:
        """Save an artifact. The file appears whole, with its SHA-256 compared, or not at all.

        Parameters
        ----------
        job_id, name : str
        path : path
            The file to write; replaced if it is there.
        tries : int
            A download that breaks off goes on where it stopped, so many times in all.
        """
        path = Path(path)
        aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")
        try:
            with aside.open("x+b") as file:
                self._receive(f"/v1/jobs/{job_id}/artifacts/{name}", file, tries)
                file.flush()
                os.fsync(file.fileno())
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)
        return path

    def _receive(self, url: str, file: IO[bytes], tries: int) -> None:
        tag = ""
        for left in reversed(range(tries)):
            start = file.tell()
            headers = {"Accept-Encoding": "identity"}
            if start:
                headers |= {"Range": f"bytes={start}-", "If-Range": tag}
            try:
                with self._http.stream("GET", url, headers=headers) as answer:
                    if answer.is_error:
                        answer.read()
                        raise _error(answer)
                    if start and answer.status_code != httpx.codes.PARTIAL_CONTENT:
                        file.seek(0)
                        file.truncate()
                    tag = answer.headers.get("ETag", "")
                    for part in answer.iter_raw():
                        file.write(part)
                break
            except httpx.TransportError as error:
                if not left or not tag:
                    raise _unreachable(error) from error
        file.seek(0)
        digest = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
        if tag and digest != tag.strip('"'):
            raise UnavailableError("What was received is not what the service says it sent.", advice="Try again.")

    def _call(self, method: str, url: str, **options: Any) -> httpx.Response:
        try:
            answer = self._http.request(method, url, **options)
        except httpx.TransportError as error:
            raise _unreachable(error) from error
        if answer.is_error:
            raise _error(answer)
        return answer


def _file_part(path: Path, files: contextlib.ExitStack) -> tuple[str, IO[bytes], str]:
    return path.name, files.enter_context(path.open("rb")), "application/octet-stream"


def _as_json(document: Mapping[str, Any]) -> str:
    def written(value: Any) -> Any:
        if isinstance(value, DeformParams | OutputOptions):
            return value.model_dump(mode="json", exclude_unset=True)
        if isinstance(value, Mapping):
            return dict(value)
        raise TypeError(f"{type(value).__name__} is no JSON value")

    # Not checked here: the service knows what it takes, and says so in full.
    return json.dumps(document, default=written)


def _retry_after(answer: httpx.Response) -> float:
    try:
        wanted = float(answer.headers.get("Retry-After", "1"))
    except ValueError:
        wanted = 1.0
    return min(max(wanted, _MIN_POLL_S), _MAX_POLL_S)


def _succeeded(job: JobView) -> JobView:
    if job.state is JobState.SUCCEEDED:
        return job
    if job.error is not None:
        raise _by_code(job.error.code)(job.error.detail, advice=job.error.advice, job_id=job.id)
    raise ConflictError(f"The job {job.id} is {job.state}.", advice="Post it again.", job_id=job.id)


def _by_code(code: str) -> type[MeshdeformError]:
    todo: list[type[MeshdeformError]] = [MeshdeformError]
    while todo:
        kind = todo.pop()
        if kind.code == code:
            return kind
        todo += kind.__subclasses__()
    return MeshdeformError


def _error(answer: httpx.Response) -> MeshdeformError:
    """Return the error that a problem document tells of; of something else, for example a proxy, what can be said."""
    try:
        problem = answer.json()
        kind, detail, advice = _by_code(problem["code"]), str(problem["detail"]), str(problem["advice"])
    except (ValueError, KeyError, TypeError):
        kind = UnavailableError if answer.status_code >= 500 else MeshdeformError
        return kind(f"{answer.request.url} answered {answer.status_code}.", advice="Check the service's address.")
    return kind(detail, advice=advice, **{key: value for key, value in problem.items() if key not in _PROBLEM_MEMBERS})


def _unreachable(error: httpx.TransportError) -> UnavailableError:
    return UnavailableError(
        f"The service does not answer ({type(error).__name__}).", advice="Check its address, and that it runs."
    )
