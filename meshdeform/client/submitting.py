"""Make jobs: each request carries a key of its own, so that it can be sent again and is done once."""

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
from meshdeform.client.documents import JobView, UploadView, Validation, read
from meshdeform.client.paths import JobLike, job_path
from meshdeform.client.reading import canceled
from meshdeform.client.retries import Policy, answered
from meshdeform.client.sources import AssetLike, LocalFile, open_source
from meshdeform.client.uploads import uploaded
from meshdeform.errors import ChecksumError, MeshdeformError, NotFoundError
from meshdeform.requests.document import DeformParams, OutputOptions

__all__ = ["Files", "Order", "branched", "checked_key", "retried", "sent_ahead", "submitted", "validated"]


@dataclass(frozen=True)
class Order:
    """What a job is to do; members that are None are left to the service. See `Client.submit`."""

    prompt: str = ""
    params: DeformParams | Mapping[str, Any] | None = None
    output: OutputOptions | Mapping[str, Any] | None = None
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
            It cannot be written as JSON: something else than texts, numbers, lists and mappings; or no finite number.
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
        told = {name: value for name, value in members.items() if value is not None}
        # Not checked here: the service knows what it takes, and says so in full.
        document: dict[str, Any] = json.loads(json.dumps(told, default=_plain, allow_nan=False))
        return document


@dataclass(frozen=True)
class Files:
    """The files of a job, and how they go. See `Client.submit`."""

    asset: AssetLike
    target: AssetLike | None = None
    filename: str | None = None
    upload: bool | None = None
    key: str = ""

    @classmethod
    def of(
        cls, asset: AssetLike, target: AssetLike | None, filename: str | None, upload: bool | None, key: str | None
    ) -> Files:
        """Return them with a key, a new one unless one is given.

        Raises
        ------
        ValueError
            The key is none that a header can carry.
        """
        return cls(asset, target, filename, upload, checked_key(key))


def checked_key(key: str | None) -> str:
    """Return a key for a request: a new one unless one is given.

    Raises
    ------
    ValueError
        It is empty, longer than 255 characters, or not of visible ASCII characters.
    """
    if key is None:
        return uuid.uuid4().hex
    if not re.fullmatch(r"[\x21-\x7e]{1,255}", key):
        raise ValueError("An idempotency key has 1 to 255 visible ASCII characters.")
    return key


def submitted(order: Order, files: Files, policy: Policy) -> Operation[JobView]:
    """Post a job; see `Client.submit`."""
    with contextlib.ExitStack() as opened:
        call, sent = yield from _prepared("/v1/jobs", order, files, policy, opened)
        answer = yield from answered(call, policy)
        job = read(JobView, answer.json(), answer.url)
    arrived = {"asset": job.asset, "target": job.target}
    for name, file in sent.items():
        there = arrived[name]
        if there is None or there.sha256 != file.sha256:
            with contextlib.suppress(MeshdeformError):
                yield from canceled(job, policy)
            raise ChecksumError(
                f"The {name} that arrived is not the one that was sent; the job {job.id} is canceled.",
                advice="Was the file written to meanwhile? Post it again.",
                job_id=job.id,
            )
    return job


def validated(order: Order, files: Files, policy: Policy) -> Operation[Validation]:
    """Check a job without posting it; see `Client.validate`."""
    with contextlib.ExitStack() as opened:
        call, _ = yield from _prepared("/v1/jobs:validate", order, files, policy, opened)
        answer = yield from answered(call, policy)
        return read(Validation, answer.json(), answer.url)


def retried(job: JobLike, key: str | None, policy: Policy) -> Operation[JobView]:
    """Try a job again; see `Client.retry`."""
    call = Call("POST", job_path(job, "retry"), headers={"Idempotency-Key": checked_key(key)})
    answer = yield from answered(call, policy)
    return read(JobView, answer.json(), answer.url)


def branched(
    job: JobLike, step: int, order: Order, target: AssetLike | None, key: str | None, policy: Policy
) -> Operation[JobView]:
    """Go another way from a checkpoint; see `Client.branch`."""
    key = checked_key(key)
    document = order.document()
    if target is not None:
        with contextlib.ExitStack() as opened:
            source = yield Work(partial(open_source, target, opened))
            # A branch takes no form: what it needs besides is sent ahead.
            document["target"] = yield from _ahead(source, f"{key}/target", policy)
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
        The service has it by now.
    """
    with contextlib.ExitStack() as opened:
        source: LocalFile | dict[str, str] = yield Work(partial(open_source, asset, opened, filename))
        if isinstance(source, dict):
            raise ValueError("The service has this file by now: name it as it is.")  # noqa: TRY004 - the type is right
        return (yield from uploaded(source, checked_key(key), policy))


def _prepared(
    url: str, order: Order, files: Files, policy: Policy, opened: contextlib.ExitStack
) -> Operation[tuple[Call, dict[str, LocalFile]]]:
    """Return the request, and the files of this side that belong to it."""
    document = order.document()
    sent: dict[str, LocalFile] = {}
    parts: list[Part] = []
    for name, asset in (("asset", files.asset), ("target", files.target)):
        if asset is None:
            continue
        filename = files.filename if name == "asset" else None
        source: LocalFile | dict[str, str] = yield Work(partial(open_source, asset, opened, filename))
        if isinstance(source, LocalFile):
            sent[name] = source
            if not (yield from _goes_ahead(source, files.upload, f"{files.key}/{name}", document, name, policy)):
                parts.append(Part(name, source.filename, source.file))
        else:
            document[name] = source
    headers = {"Idempotency-Key": files.key} if url == "/v1/jobs" else {}
    return Call("POST", url, headers=headers, document=document, parts=tuple(parts)), sent


def _goes_ahead(
    source: LocalFile, wanted: bool | None, key: str, document: dict[str, Any], name: str, policy: Policy
) -> Operation[bool]:
    """Whether a file was sent ahead of its job; the document then names it."""
    if not (source.size > policy.upload_above if wanted is None else wanted) or not source.size:
        return False
    try:
        document[name] = yield from _ahead(source, key, policy)
    except NotFoundError:
        if wanted:
            raise
        return False  # a service without uploads
    return True


def _ahead(source: LocalFile | dict[str, str], key: str, policy: Policy) -> Operation[dict[str, str]]:
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
    raise TypeError(f"{type(value).__name__} is no JSON value")
