"""Where a job's files come from: with the request, from an upload, or from another job. All end up as files on disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from meshdeform.errors import AssetTooLargeError, ConflictError, NotFoundError, ParameterError
from service.http.multipart import ReceivedFile
from service.jobs.documents import FileReference, JobDocument
from service.state import AppState

__all__ = ["ASSET_ADVICE", "Submission", "fetch"]

ASSET_ADVICE = "Send the file as the part `asset`, or name an upload or an artifact in the document's `asset`."


@dataclass(frozen=True)
class Submission:
    """What a request asks for, and the files that came with it.

    Attributes
    ----------
    document : JobDocument
    files : dict of str to ReceivedFile
        Those that came along, by the part's name: `asset`, `target`.
    folder : Path
        Where they lie, and where those go that the document names.

    Raises
    ------
    ParameterError
        There is no asset, or two of something.
    """

    document: JobDocument
    files: dict[str, ReceivedFile]
    folder: Path

    def __post_init__(self) -> None:
        """Refuse anything but one asset and at most one target."""
        for name in self.files:
            if getattr(self.document, name) is not None:
                raise _parameter(
                    [name], f"`{name}` is sent as a part and named in the document.", "Leave one of the two out."
                )
        if "asset" not in self.files and self.document.asset is None:
            raise _parameter(["asset"], "`asset` is missing.", ASSET_ADVICE)

    @property
    def has_target(self) -> bool:
        """Whether there is a second mesh."""
        return "target" in self.files or self.document.target is not None

    def fetched(self, app: AppState, owner_id: str) -> dict[str, ReceivedFile]:
        """Return the asset and the target, fetched into the folder where they did not come along.

        Raises
        ------
        ParameterError, ConflictError
            A reference names nothing of this owner's, or nothing that is finished.
        """
        named = {"asset": self.document.asset, "target": self.document.target}
        fetched = {
            name: fetch(app, owner_id, reference, name, self.folder) for name, reference in named.items() if reference
        }
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
