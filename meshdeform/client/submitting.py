"""Create jobs. Each request has its own idempotency key, so that a retry does not create a second job."""

from __future__ import annotations

import contextlib
import json
import os
import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from pydantic import BaseModel

from meshdeform.client.commands import Call, Operation, Part, Work
from meshdeform.client.documents import FoundOrientation, JobView, UploadView, Validation, read
from meshdeform.client.paths import JobLike, job_path
from meshdeform.client.reading import canceled
from meshdeform.client.retries import Policy, answered
from meshdeform.client.sources import AssetLike, LocalFile, open_source
from meshdeform.client.uploads import uploaded
from meshdeform.errors import ChecksumError, MeshdeformError, NotFoundError
from meshdeform.requests.document import DeformParams, OutputOptions

__all__ = [
    "Files",
    "Order",
    "Output",
    "Params",
    "branched",
    "checked_key",
    "oriented",
    "parts_of",
    "retried",
    "sent_ahead",
    "submitted",
    "validated",
]

Params = DeformParams | Mapping[str, Any]
Output = OutputOptions | Mapping[str, Any]


@dataclass(frozen=True)
class Order:
    """The description of a job; for members that are None the service chooses. See `Client.submit`."""

    prompt: str = ""
    params: Params | None = None
    output: Output | None = None
    metadata: Mapping[str, str] | None = None
    priority: int | None = None
    deadline_s: float | None = None
    retention_s: float | None = None
    kind: str | None = None

    def document(self) -> dict[str, Any]:
        """Return the JSON document.

        Raises
        ------
        TypeError, ValueError
            It cannot be written as JSON: a value of another type, or a number that is not finite.
        """
        members = {
            "kind": self.kind,
            "prompt": self.prompt,
            "params": self.params,
            "output": self.output,
            "metadata": self.metadata,
            "priority": self.priority,
            "deadline_s": self.deadline_s,
            "retention_s": self.retention_s,
        }
        given = {name: value for name, value in members.items() if value is not None}
        # Not validated here: the service validates and reports all errors.
        document: dict[str, Any] = json.loads(json.dumps(given, default=_plain, allow_nan=False))
        return document


@dataclass(frozen=True)
class Files:
    """The files of a job, and how to send them. See `Client.submit`."""

    parts: Mapping[str, AssetLike]
    filename: str | None = None
    upload: bool | None = None
    key: str = ""

    @classmethod
    def of(
        cls,
        asset: AssetLike | None,
        target: AssetLike | None,
        files: Mapping[str, AssetLike] | None,
        filename: str | None,
        upload: bool | None,
        key: str | None,
    ) -> Files:
        """Return the files by part with the given key, or a new one.

        Raises
        ------
        ValueError
            The key is not valid in a header, or a file is given twice.
        """
        return cls(parts_of(files, asset=asset, target=target), filename, upload, checked_key(key))


def parts_of(files: Mapping[str, AssetLike] | None, **named: AssetLike | None) -> dict[str, AssetLike]:
    """Return the files by part, those with arguments of their own first.

    Raises
    ------
    ValueError
        A file is given twice.
    """
    parts = {name: file for name, file in named.items() if file is not None}
    if twice := sorted(parts.keys() & (files or {}).keys()):
        raise ValueError(f"Give {', '.join(twice)} once, as an argument or in `files`.")
    return {**parts, **(files or {})}


def checked_key(key: str | None) -> str:
    """Return the given key for a request, or a new one.

    Raises
    ------
    ValueError
        The key is empty, longer than 255 characters, or has other than visible ASCII characters.
    """
    if key is None:
        return uuid.uuid4().hex
    if not re.fullmatch(r"[\x21-\x7e]{1,255}", key):
        raise ValueError("An idempotency key must have 1 to 255 visible ASCII characters.")
    return key


def submitted(order: Order, files: Files, policy: Policy) -> Operation[JobView]:
    """Post a job; see `Client.submit`."""
    with contextlib.ExitStack() as opened:
        call, sent = yield from _prepared("/v1/jobs", order, files, policy, opened)
        answer = yield from answered(call, policy)
        job = read(JobView, answer.json(), answer.url)
    for name, file in sent.items():
        there = job.files.get(name)
        if there is None or there.sha256 != file.sha256:
            with contextlib.suppress(MeshdeformError):
                yield from canceled(job, policy)
            raise ChecksumError(
                f"The {name} that arrived differs from the one that was sent; the job {job.id} is canceled.",
                advice="The file may have changed while it was sent. Post it again.",
                job_id=job.id,
            )
    return job


def validated(order: Order, files: Files, policy: Policy) -> Operation[Validation]:
    """Check a job without posting it; see `Client.validate`."""
    with contextlib.ExitStack() as opened:
        call, _ = yield from _prepared("/v1/jobs:validate", order, files, policy, opened)
        answer = yield from answered(call, policy)
        return read(Validation, answer.json(), answer.url)


def oriented(order: Order, files: Files, policy: Policy) -> Operation[FoundOrientation]:
    """Find the front that a job would have; see `Client.orient`."""
    with contextlib.ExitStack() as opened:
        call, _ = yield from _prepared("/v1/jobs:orient", order, files, policy, opened)
        answer = yield from answered(call, policy)
        return read(FoundOrientation, answer.json(), answer.url)


def retried(job: JobLike, key: str | None, policy: Policy) -> Operation[JobView]:
    """Retry a job; see `Client.retry`."""
    call = Call("POST", job_path(job, "retry"), headers={"Idempotency-Key": checked_key(key)})
    answer = yield from answered(call, policy)
    return read(JobView, answer.json(), answer.url)


def branched(
    job: JobLike, step: int, order: Order, files: Mapping[str, AssetLike], key: str | None, policy: Policy
) -> Operation[JobView]:
    """Branch a job from a checkpoint; see `Client.branch`."""
    key = checked_key(key)
    document = order.document()
    for name, file in files.items():
        with contextlib.ExitStack() as opened:
            source = yield Work(partial(open_source, file, opened))
            # The route takes no form, so that files must be uploaded first.
            _refer(document, name, (yield from _reference(source, f"{key}/{name}", policy)))
    call = Call(
        "POST", job_path(job, "checkpoints", step, "branch"), headers={"Idempotency-Key": key}, document=document
    )
    answer = yield from answered(call, policy)
    return read(JobView, answer.json(), answer.url)


def sent_ahead(asset: AssetLike, filename: str | None, key: str | None, policy: Policy) -> Operation[UploadView]:
    """Upload a file; see `Client.upload`.

    Raises
    ------
    ValueError
        The service already has the file.
    """
    with contextlib.ExitStack() as opened:
        source: LocalFile | dict[str, str] = yield Work(partial(open_source, asset, opened, filename))
        if isinstance(source, dict):
            raise ValueError("The service already has this file: use the reference.")  # noqa: TRY004 - type is right
        return (yield from uploaded(source, checked_key(key), policy))


def _prepared(
    url: str, order: Order, files: Files, policy: Policy, opened: contextlib.ExitStack
) -> Operation[tuple[Call, dict[str, LocalFile]]]:
    """Return the request and its local files."""
    document = order.document()
    sent: dict[str, LocalFile] = {}
    parts: list[Part] = []
    for name, file in files.parts.items():
        filename = files.filename if name == "asset" or len(files.parts) == 1 else None
        source: LocalFile | dict[str, str] = yield Work(partial(open_source, file, opened, filename))
        if isinstance(source, LocalFile):
            sent[name] = source
            if not (yield from _uploaded_ahead(source, files.upload, f"{files.key}/{name}", document, name, policy)):
                parts.append(Part(name, source.filename, source.file))
        else:
            _refer(document, name, source)
    headers = {"Idempotency-Key": files.key} if url == "/v1/jobs" else {}
    return Call("POST", url, headers=headers, document=document, parts=tuple(parts)), sent


def _uploaded_ahead(
    source: LocalFile, wanted: bool | None, key: str, document: dict[str, Any], name: str, policy: Policy
) -> Operation[bool]:
    """Upload a file before its job if needed, refer to it in the document, and return whether it was uploaded."""
    if not (source.size > policy.upload_above if wanted is None else wanted) or not source.size:
        return False
    try:
        reference = yield from _reference(source, key, policy)
    except NotFoundError:
        if wanted:
            raise
        return False  # the service has no uploads
    _refer(document, name, reference)
    return True


def _refer(document: dict[str, Any], name: str, reference: Mapping[str, str]) -> None:
    """Name a stored file in a document; those of `text_deform` in the way that older services understand, too."""
    if name in ("asset", "target"):
        document[name] = reference
    else:
        document.setdefault("files", {})[name] = reference


def _reference(source: LocalFile | dict[str, str], key: str, policy: Policy) -> Operation[dict[str, str]]:
    if not isinstance(source, LocalFile):
        return source
    upload = yield from uploaded(source, key, policy)
    return {"upload_id": upload.id}


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")
