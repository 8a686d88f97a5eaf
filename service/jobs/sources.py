"""Where a job's files come from: with the request, from an upload, or from another job. All end up as files on disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from meshdeform.errors import AssetTooLargeError, ConflictError, NotFoundError, ParameterError, RequestError
from service.http.multipart import ReceivedFile, ReceivedForm
from service.jobs.documents import FileReference, JobDocument
from service.state import Parts

__all__ = ["Submission", "fetch", "submission"]

_ADVICE = "Send the file as the part `asset`, or name an upload or an artifact in the document's `asset`."


class Submission:
    """What a request asks for, and the files that came with it.

    Parameters
    ----------
    document : JobDocument
    files : dict of str to ReceivedFile
        By the part's name.
    """

    def __init__(self, document: JobDocument, files: dict[str, ReceivedFile]) -> None:
        self.document, self.request = document, document.request()
        self._files = files

    @property
    def has_target(self) -> bool:
        """Whether there is a second mesh."""
        return "target" in self._files or self.document.target is not None

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of each file that came along."""
        return {name: file.sha256 for name, file in self._files.items()}

    def files(self, parts: Parts, owner_id: str, folder: Path) -> dict[str, ReceivedFile]:
        """Return the asset and the target, fetched into the folder where they did not come along.

        Raises
        ------
        ParameterError, ConflictError
            A reference names nothing of this owner's, or nothing that is finished.
        """
        found = {}
        for name, reference in (("asset", self.document.asset), ("target", self.document.target)):
            if reference is not None:
                found[name] = fetch(parts, owner_id, reference, name, folder)
            elif name in self._files:
                found[name] = self._files[name]
        return found


def submission(document: JobDocument, form: ReceivedForm | None = None) -> Submission:
    """Bring a document and its files together: exactly one asset, at most one target.

    Raises
    ------
    RequestError, ParameterError
        There is no asset, or two of something.
    """
    sent = {"asset": form.asset, "target": form.target} if form else {}
    files = {name: file for name, file in sent.items() if file is not None}
    for name in files:
        if getattr(document, name) is not None:
            raise _parameter(
                [name], f"`{name}` is sent as a part and named in the document.", "Leave one of the two out."
            )
    if "asset" not in files and document.asset is None:
        if form is not None:
            raise RequestError("The part `asset` is missing.", advice=_ADVICE)
        raise _parameter(["asset"], "`asset` is missing.", _ADVICE)
    return Submission(document, files)


def fetch(parts: Parts, owner_id: str, reference: FileReference, name: str, folder: Path) -> ReceivedFile:
    """Copy what a reference names into the folder.

    Parameters
    ----------
    parts : Parts
    owner_id : str
        Whose uploads and jobs may be named.
    reference : FileReference
    name : str
        The member that holds the reference; also the file's name in the folder.
    folder : Path
    """
    path = folder / name
    if reference.upload_id is not None:
        with _named([name, "upload_id"], f"There is no upload {reference.upload_id}."):
            upload = parts.record.uploads.get(reference.upload_id, owner=owner_id)
            if upload.key is None or upload.sha256 is None:
                raise ConflictError(
                    f"The upload {upload.id} is not complete.",
                    advice=f"Send the rest of it, then POST /v1/uploads/{upload.id}/complete.",
                )
            parts.store.fetch(upload.key, path, sha256=upload.sha256)
        return ReceivedFile(path, upload.filename, upload.size, upload.sha256)
    assert reference.job_id is not None
    with _named([name, "job_id"], f"There is no job {reference.job_id}."):
        job = parts.record.get(reference.job_id, owner=owner_id)
        artifacts = {artifact.name: artifact for artifact in parts.record.artifacts(job.id, owner=owner_id)}
    if reference.artifact not in artifacts:
        if not job.state.terminal:
            raise ConflictError(f"The job {job.id} is {job.state}.", advice="Wait until it has succeeded.")
        names = ", ".join(artifacts) or "none"
        raise _parameter([name, "artifact"], f"The {job.state} job {job.id} has no such artifact.", f"It has: {names}.")
    artifact = artifacts[reference.artifact]
    if artifact.size > parts.settings.max_upload_bytes:
        raise AssetTooLargeError(
            f"The artifact has {artifact.size} bytes; the limit is {parts.settings.max_upload_bytes} "
            "(MESHDEFORM_MAX_UPLOAD_BYTES)."
        )
    with _named([name, "job_id"], f"There is no job {reference.job_id}."):
        parts.store.fetch(artifact.key, path, sha256=artifact.sha256)
    return ReceivedFile(path, artifact.name, artifact.size, artifact.sha256)


@contextmanager
def _named(place: list[str], detail: str) -> Iterator[None]:
    """A thing that a document names is a parameter of the request, not what the request's path asks for."""
    try:
        yield
    except NotFoundError as error:
        raise _parameter(place, detail, "Check the id; what was deleted or has expired is gone.") from error


def _parameter(place: list[str], detail: str, advice: str) -> ParameterError:
    return ParameterError(detail, advice=advice, errors=[{"loc": place, "msg": detail, "type": "value_error"}])
