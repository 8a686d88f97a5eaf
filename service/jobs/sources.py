"""Where a job's files come from: with the request, from an upload, or from another job. All end up as files on disk."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from meshdeform.errors import AssetTooLargeError, ConflictError, NotFoundError, ParameterError
from meshdeform.runs import file_parts, kind_of
from service.http.multipart import ReceivedFile
from service.jobs.documents import FileReference, JobDocument
from service.state import AppState

__all__ = ["Submission", "fetch", "file_advice", "missing_files"]


def file_advice(name: str) -> str:
    """Say how a file reaches a job."""
    return f"Send the file as the part `{name}`, or name an upload or an artifact in the document's `{name}`."


def missing_files(document: JobDocument, sent: Collection[str]) -> list[str]:
    """Return the parts that the kind of job requires, and that are neither sent nor named in the document."""
    there = {*sent, *_named_files(document)}
    return [part.name for part in kind_of(document.kind).reads if part.required and part.name not in there]


def _named_files(document: JobDocument) -> dict[str, FileReference]:
    """Return the files that the document names, by part."""
    found = {name: getattr(document, name, None) for name in file_parts()}
    return {name: reference for name, reference in found.items() if reference is not None}


@dataclass(frozen=True)
class Submission:
    """What a request asks for, and the files that came with it.

    Attributes
    ----------
    document : JobDocument
    files : dict of str to ReceivedFile
        Those that came along, by the part's name.
    folder : Path
        Where they lie, and where those go that the document names.

    Raises
    ------
    ParameterError
        A file is missing that the kind of job cannot be without, or there are two of something.
    """

    document: JobDocument
    files: dict[str, ReceivedFile]
    folder: Path

    def __post_init__(self) -> None:
        """Refuse a job that has two files for one part, or none for one that its kind requires."""
        named = _named_files(self.document)
        for name in self.files:
            if name in named:
                raise _parameter(
                    [name], f"`{name}` is sent as a part and named in the document.", "Leave one of the two out."
                )
        for name in missing_files(self.document, self.files):
            raise _parameter([name], f"`{name}` is missing.", file_advice(name))

    @property
    def names(self) -> set[str]:
        """The parts for which there is a file, sent or named."""
        return {*self.files, *_named_files(self.document)}

    def fetched(self, app: AppState, owner_id: str) -> dict[str, ReceivedFile]:
        """Return every file, fetched into the folder where it did not come along.

        Raises
        ------
        ParameterError, ConflictError
            A reference names nothing of this owner's, or nothing that is finished.
        """
        named = _named_files(self.document).items()
        fetched = {name: fetch(app, owner_id, reference, name, self.folder) for name, reference in named}
        return {**self.files, **fetched}


def fetch(app: AppState, owner_id: str, reference: FileReference, name: str, folder: Path) -> ReceivedFile:
    """Copy what a reference names into the folder.

    Parameters
    ----------
    app : AppState
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
            upload = app.record.uploads.get(reference.upload_id, owner=owner_id)
            if upload.key is None or upload.sha256 is None:
                raise ConflictError(
                    f"The upload {upload.id} is not complete.",
                    advice=f"Send the rest of it, then POST /v1/uploads/{upload.id}/complete.",
                )
            app.store.fetch(upload.key, path, sha256=upload.sha256)
        return ReceivedFile(path, upload.filename, upload.size, upload.sha256)
    assert reference.job_id is not None
    with _named([name, "job_id"], f"There is no job {reference.job_id}."):
        job = app.record.get(reference.job_id, owner=owner_id)
        artifacts = {artifact.name: artifact for artifact in app.record.artifacts(job.id, owner=owner_id)}
    if reference.artifact not in artifacts:
        if not job.state.terminal:
            raise ConflictError(f"The job {job.id} is {job.state}.", advice="Wait until it has succeeded.")
        names = ", ".join(artifacts) or "none"
        raise _parameter([name, "artifact"], f"The {job.state} job {job.id} has no such artifact.", f"It has: {names}.")
    artifact = artifacts[reference.artifact]
    if artifact.size > app.settings.max_upload_bytes:
        raise AssetTooLargeError(
            f"The artifact has {artifact.size} bytes; the limit is {app.settings.max_upload_bytes} "
            "(MESHDEFORM_MAX_UPLOAD_BYTES)."
        )
    with _named([name, "job_id"], f"There is no job {reference.job_id}."):
        app.store.fetch(artifact.key, path, sha256=artifact.sha256)
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
