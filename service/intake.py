"""Take a job in: check everything, store the files, record the job, tell the workers, in this order."""

from __future__ import annotations

import logging

from pydantic import ValidationError

from meshdeform.config import MAX_PROMPT_LENGTH, JobRequest
from meshdeform.errors import PromptError, RequestError, UnavailableError
from meshdeform.gltf import Limits, check_asset_subprocess
from meshdeform.jobs.models import Job, StoredFile
from meshdeform.kinds import check_request
from service.deps import Parts
from service.errors import parameter_error
from service.multipart import ReceivedFile, ReceivedForm

__all__ = ["take_in"]

_log = logging.getLogger(__name__)
_CHECK_TIMEOUT_S = 30.0
_CONTENT_TYPE = "application/octet-stream"


def take_in(parts: Parts, form: ReceivedForm) -> Job:
    """Accept a job for good, or refuse it and leave nothing behind.

    Parameters
    ----------
    parts : Parts
    form : ReceivedForm
        Its files may be gone when this returns.

    Raises
    ------
    AssetError, RequestError, ModelError
        What is wrong with the asset or the request.
    UnavailableError
        The record or the store does not answer. Redis may be away: workers are told when it is back.
    """
    request = _parse(form.document)
    check_request(request, parts.settings, has_target=form.target is not None)
    uploads = [file for file in (form.asset, form.target) if file is not None]
    for upload in uploads:
        check_asset_subprocess(
            upload.path, upload.filename, Limits.from_settings(parts.settings), timeout_s=_CHECK_TIMEOUT_S
        )
    job = _store(parts, request, uploads)
    try:
        parts.queue.enqueue(job.id)
    except UnavailableError as error:
        # The job is on the record, so it is accepted: the reconciler tells the workers once Redis is back.
        _log.warning("job %s: the workers are not told yet: %s", job.id, error)
    return job


def _store(parts: Parts, request: JobRequest, uploads: list[ReceivedFile]) -> Job:
    files = [
        StoredFile(key=f"assets/{upload.sha256}", filename=upload.filename, size=upload.size, sha256=upload.sha256)
        for upload in uploads
    ]
    paths = {file.key: upload.path for file, upload in zip(files, uploads, strict=True)}
    pinned: list[str] = []
    try:
        for key, path in paths.items():
            parts.record.files.pin(key)
            pinned.append(key)
            # The same bytes are stored once. The pin came first, so they stay.
            if not parts.store.exists(key):
                parts.store.put(key, path, _CONTENT_TYPE)
        return parts.record.create(request, *files)
    except BaseException:
        parts.record.files.unpin(pinned)
        raise


def _parse(document: bytes) -> JobRequest:
    try:
        return JobRequest.model_validate_json(document)
    except ValidationError as error:
        findings = error.errors(include_url=False, include_input=False, include_context=False)
        if findings[0]["type"] == "json_invalid":
            reason = findings[0]["msg"].removeprefix("Invalid JSON: ")
            raise RequestError(f"The part `request` is no JSON document: {reason}.") from error
        if any(finding["loc"] == ("prompt",) and finding["type"] == "string_too_long" for finding in findings):
            raise PromptError(f"The prompt is longer than {MAX_PROMPT_LENGTH} characters.") from error
        raise parameter_error(findings) from error
