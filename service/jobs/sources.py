"""Fetch the files of a job to disk from wherever they are: the request, an upload, or another job."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from meshdeform.errors import AssetTooLargeError, ConflictError, NotFoundError, ParameterError
from meshdeform.requests.document import JobRequest
from meshdeform.runs import kind_of
from service.http.bodies import ReceivedFile
from service.jobs.documents import FileReference, FileSource, JobDocument
from service.state import AppState

__all__ = ["Submission", "fetch", "file_advice", "in_order", "missing_files"]

_F = TypeVar("_F")


def file_advice(name: str) -> str:
    """Return advice on how to give a job a file."""
    return f"Send the file as the part `{name}`, or name an upload or an artifact in the document: `files.{name}`."


def in_order(request: JobRequest, files: Mapping[str, _F]) -> dict[str, _F]:
    """Return the files of a job in the order of the parts of its kind."""
    return {name: files[name] for name in kind_of(request.kind).parts if name in files}


def missing_files(document: JobDocument, sent: Collection[str]) -> list[str]:
    """Return the names of required files that are neither sent nor named in the document."""
    present = {*sent, *document.references}
    return [part.name for part in kind_of(document.kind).reads if part.required and part.name not in present]


@dataclass(frozen=True)
class Submission:
    """A request for a job, and the files that were sent with it, by part; those that are fetched join them in `folder`.

    Raises
    ------
    ParameterError
        A required file is missing, or is both sent and named.
    """

    document: JobDocument
    files: dict[str, ReceivedFile]
    folder: Path

    def __post_init__(self) -> None:
        """Check that every file is given once, and every required one is given."""
        named = self.document.references
        for name in self.files:
            if name in named:
                raise ParameterError.at(
                    [name], f"`{name}` is both sent as a part and named in the document.", "Leave one of the two out."
                )
        for name in missing_files(self.document, self.files):
            raise ParameterError.at([name], f"`{name}` is missing.", file_advice(name))

    @property
    def names(self) -> set[str]:
        """The names of all files, sent or named."""
        return {*self.files, *self.document.references}

    def fetch_all(self, app: AppState, owner_id: str) -> dict[str, ReceivedFile]:
        """Fetch the files that the document names, and return all files by name, in the order of the kind's parts.

        Raises
        ------
        ParameterError, ConflictError
            A reference names no file of this owner, or one that is not complete.
        """
        named = self.document.references.items()
        fetched = {name: fetch(app, owner_id, *reference, self.folder) for name, reference in named}
        return in_order(self.document, {**self.files, **fetched})


def fetch(
    app: AppState, owner_id: str, reference: FileReference | FileSource, place: list[str], folder: Path
) -> ReceivedFile:
    """Copy the file that a reference names into the folder.

    Parameters
    ----------
    owner_id : str
        The owner of the uploads and jobs that may be named.
    place : list of str
        The member that holds the reference; its last name is also that of the file in the folder.
    """
    path = folder / place[-1]
    if reference.upload_id is not None:
        with _reported_at(_inside(place, "upload_id"), f"There is no upload {reference.upload_id}."):
            upload = app.record.uploads.get(reference.upload_id, owner=owner_id)
            if upload.key is None or upload.sha256 is None:
                raise ConflictError(
                    f"The upload {upload.id} is not complete.",
                    advice=f"Send the rest of it, then POST /v1/uploads/{upload.id}/complete.",
                )
            app.store.fetch(upload.key, path, sha256=upload.sha256)
        return ReceivedFile(path, upload.filename, upload.size, upload.sha256)
    assert reference.job_id is not None
    with _reported_at(_inside(place, "job_id"), f"There is no job {reference.job_id}."):
        job = app.record.get(reference.job_id, owner=owner_id)
        artifacts = {artifact.name: artifact for artifact in app.record.artifacts(job.id, owner=owner_id)}
    if reference.artifact not in artifacts:
        if not job.state.terminal:
            raise ConflictError(f"The job {job.id} is {job.state}.", advice="Wait until it has succeeded.")
        detail = f"The {job.state} job {job.id} has no such artifact."
        raise ParameterError.at(_inside(place, "artifact"), detail, f"It has: {', '.join(artifacts) or 'none'}.")
    artifact = artifacts[reference.artifact]
    if artifact.size > app.settings.max_upload_bytes:
        raise AssetTooLargeError(
            f"The artifact has {artifact.size} bytes; the limit is {app.settings.max_upload_bytes} "
            "(MESHDEFORM_MAX_UPLOAD_BYTES)."
        )
    with _reported_at(_inside(place, "job_id"), f"There is no job {reference.job_id}."):
        app.store.fetch(artifact.key, path, sha256=artifact.sha256)
    return ReceivedFile(path, artifact.name, artifact.size, artifact.sha256)


def _inside(place: list[str], member: str) -> list[str]:
    """Return the place of a reference's member; a parameter is a name alone."""
    return place if place[0] == "params" else [*place, member]


@contextmanager
def _reported_at(place: list[str], detail: str) -> Iterator[None]:
    """Turn NotFoundError into a ParameterError at `place`: the document is wrong, not the path of the request."""
    try:
        yield
    except NotFoundError as error:
        raise ParameterError.at(
            place, detail, "Check the id; the file may have been deleted or have expired."
        ) from error
