"""Define every error that Meshdeform raises on purpose, with its HTTP status, stable code and advice.

::

    MeshdeformError                    500  internal
    ├── AssetError                     422  asset_invalid          the uploaded file
    │   ├── AssetFormatError           415  asset_format           not a GLB, OBJ, PLY, STL or ZIP
    │   ├── AssetTruncatedError        422  asset_truncated        bytes are missing, or a length is wrong
    │   ├── AssetTooLargeError         413  asset_too_large        exceeds a limit of this server
    │   ├── AssetExternalError         422  asset_external_uri     refers to a file that was not sent
    │   ├── AssetNotFetchedError       422  asset_not_fetched      could not be fetched from its URL
    │   ├── AssetUnsupportedError      422  asset_unsupported      needs an extension that we cannot decode
    │   ├── AssetNotFiniteError        422  asset_not_finite       NaN or infinite positions
    │   ├── AssetEmptyError            422  asset_no_triangles     nothing to deform
    │   ├── DrawingError               422  not_a_drawing          a picture that is not a line drawing
    │   └── SilhouetteError            422  silhouette_unusable    a picture without a plain background, or an object
    ├── RequestError                   422  request_invalid        the request document
    │   ├── ParameterError             422  parameter_invalid      unknown name, or value out of range
    │   ├── AlignmentError             422  alignment_failed       the target could not be placed on the asset
    │   ├── PromptError                422  prompt_invalid         empty or too long
    │   ├── VocabularyError            422  prompt_unknown_words   a word of the prompt is unknown
    │   ├── PartNotFoundError          422  part_not_found         a change names a part that the asset lacks
    │   ├── IdempotencyMismatchError   422  idempotency_mismatch   an Idempotency-Key was reused for another request
    │   ├── ChecksumError              422  checksum_mismatch      an upload has another size or digest than announced
    │   └── WebhookAddressError        422  webhook_address        a webhook's address is not allowed
    ├── ModelError                     422  model_unavailable      a diffusion model cannot be loaded
    ├── UnauthorizedError              401  unauthorized           no valid API key
    ├── ForbiddenError                 403  forbidden              a signed URL is invalid or has expired
    ├── NotFoundError                  404  not_found              no such job, artifact or route
    │   └── AssetNotKeptError          404  asset_not_kept         a preview names an asset that is no longer kept
    ├── MethodNotAllowedError          405  method_not_allowed     the route does not support this method
    ├── RequestTimeoutError            408  request_timeout        the body arrives too slowly
    ├── HeadersTooLargeError           431  headers_too_large      the request's headers are too large, or too many
    ├── RangeError                     416  range_not_satisfiable  the range begins past the end
    ├── ConflictError                  409  conflict               the resource's state does not allow it
    │   ├── JobNotFinishedError        409  job_not_finished       a result was requested before the job finished
    │   ├── UnreadableJobError         409  job_unreadable         another version's request, unknown to this one
    │   │   └── KindRetiredError       422  kind_retired           a kind of job or of model that is gone
    │   ├── IdempotencyBusyError       409  idempotency_in_flight  the first request with this key is still running
    │   └── StaleAttemptError          409  stale_attempt          a worker writes after losing its lease
    ├── LimitError                     429  rate_limited           more requests than the key is allowed
    │   ├── TooManyJobsError           429  too_many_jobs          more unfinished jobs than the key is allowed
    │   ├── TooManyUploadsError        429  too_many_uploads       more unused uploads than the key is allowed
    │   └── TooMuchStoredError         429  too_much_stored        the owner's jobs keep more bytes than allowed
    ├── CheckpointError                500  checkpoint_invalid     damaged, or made with other parameters
    ├── StoredFileError                500  file_damaged           a stored file differs from what was stored
    ├── NumericalError                 500  numerical_failure      a factorisation or a loss broke down
    ├── WorkerLostError                500  worker_lost            every attempt's worker died
    ├── DeviceMemoryError              500  gpu_oom                the device's memory is too small for the job
    ├── RunTimeError                   500  run_time_exceeded      the job ran for longer than it may
    ├── RecordVersionError             500  record_version         a record that this version cannot use
    ├── UnavailableError               503  unavailable            Redis, the record or the store does not respond
    └── DependencyError                501  dependency_missing     an optional package or program is not installed

`ShapeError` is a plain `ValueError` for programming mistakes inside the numerical core.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Self

__all__ = [
    "AlignmentError",
    "AssetEmptyError",
    "AssetError",
    "AssetExternalError",
    "AssetFormatError",
    "AssetNotFetchedError",
    "AssetNotFiniteError",
    "AssetNotKeptError",
    "AssetTooLargeError",
    "AssetTruncatedError",
    "AssetUnsupportedError",
    "CheckpointError",
    "ChecksumError",
    "ConflictError",
    "DependencyError",
    "DeviceMemoryError",
    "DrawingError",
    "ForbiddenError",
    "HeadersTooLargeError",
    "IdempotencyBusyError",
    "IdempotencyMismatchError",
    "JobNotFinishedError",
    "KindRetiredError",
    "LimitError",
    "MeshdeformError",
    "MethodNotAllowedError",
    "ModelError",
    "NotFoundError",
    "NumericalError",
    "ParameterError",
    "PartNotFoundError",
    "PromptError",
    "RangeError",
    "RecordVersionError",
    "RequestError",
    "RequestTimeoutError",
    "RunTimeError",
    "ShapeError",
    "SilhouetteError",
    "StaleAttemptError",
    "StoredFileError",
    "TooManyJobsError",
    "TooManyUploadsError",
    "TooMuchStoredError",
    "UnauthorizedError",
    "UnavailableError",
    "UnreadableJobError",
    "VocabularyError",
    "WebhookAddressError",
    "WorkerLostError",
    "install_command",
]


def readable_size(count: int) -> str:
    """Return a number of bytes for people: in MiB, if it is one or more."""
    return f"{count:,} bytes" if count < 2**20 else f"{count / 2**20:.4g} MiB"


class MeshdeformError(Exception):
    """Something inside Meshdeform went wrong."""

    status: ClassVar[int] = 500
    code: ClassVar[str] = "internal"
    advice: ClassVar[str] = "Report this with the job's report.json."
    transient: ClassVar[bool] = False
    """Whether the same attempt at a job may succeed later, without anything being changed by its owner."""

    # Set on errors received from a service: the request's id, and the delay before it may be sent again.
    request_id: str | None = None
    retry_after_s: float | None = None

    def __init__(self, detail: str, *, advice: str | None = None, **extra: Any) -> None:
        """Initialise the error.

        Parameters
        ----------
        detail : str
            One sentence about this occurrence.
        advice : str, optional
            What to do about it. Default: the class's advice.
        **extra
            Further members of the problem document (JSON values).
        """
        super().__init__(detail)
        self.detail = detail
        self.advice_text = advice if advice is not None else self.advice
        self.extra = extra

    @property
    def title(self) -> str:
        """The error's docstring: the same sentence for every occurrence."""
        return (type(self).__doc__ or "").strip().splitlines()[0].rstrip(".")


# Contents of a request: the files, the request document and the model that it names.


class AssetError(MeshdeformError):
    """The asset is not valid."""

    status = 422
    code = "asset_invalid"
    advice = "Check the file with the Khronos glTF validator, or export it again."


class AssetFormatError(AssetError):
    """Meshdeform cannot read the file's format."""

    status = 415
    code = "asset_format"
    advice = "Send glTF 2.0 (.glb, or .gltf with its files as a ZIP), or a mesh as OBJ, PLY or STL."


class AssetTruncatedError(AssetError):
    """The file is truncated."""

    code = "asset_truncated"
    advice = "Send the whole file, or export it again if it is damaged on disk."


class AssetTooLargeError(AssetError):
    """The asset exceeds a limit of this server."""

    status = 413
    code = "asset_too_large"
    advice = "Simplify the mesh, or raise the limit that the message names."

    @classmethod
    def more_than(cls, limit: int, has: str = "The file has") -> Self:
        """Return the error about more bytes than MESHDEFORM_MAX_UPLOAD_BYTES; `has` says what has them."""
        advice = "Simplify the mesh. Whoever runs the service can raise MESHDEFORM_MAX_UPLOAD_BYTES."
        return cls(f"{has} more than {readable_size(limit)}, which is the limit.", advice=advice, limit=limit)


class AssetExternalError(AssetError):
    """The asset refers to a file that was not sent."""

    code = "asset_external_uri"
    advice = "Send the .gltf and its files as a ZIP, or pack them into a .glb: gltf-transform copy in.gltf out.glb"


class AssetNotFetchedError(AssetError):
    """The asset could not be fetched from the URL in the request."""

    code = "asset_not_fetched"
    advice = "Send the file as the field `asset`, or as an upload, or name a public https:// URL that answers with it."


class AssetUnsupportedError(AssetError):
    """The asset needs something that Meshdeform cannot decode."""

    code = "asset_unsupported"
    advice = "Export it without the extension that the message names."


class AssetNotFiniteError(AssetError):
    """The asset has positions that are not finite numbers."""

    code = "asset_not_finite"
    advice = "Remove the NaN or infinite vertices and export again."


class AssetEmptyError(AssetError):
    """The asset has no triangles to deform."""

    code = "asset_no_triangles"
    advice = "Points and lines cannot be deformed; send a mesh with triangles."


class DrawingError(AssetError):
    """A picture is not a line drawing."""

    code = "not_a_drawing"
    advice = "Draw the outlines of one thing with dark lines on an even, bright page."


class SilhouetteError(AssetError):
    """The picture shows no silhouette that can be used."""

    code = "silhouette_unusable"
    advice = "Send a mask, or a picture of one object in front of a plain background."


class RequestError(MeshdeformError):
    """The request is not valid."""

    status = 422
    code = "request_invalid"
    advice = "Compare the request with /openapi.json."

    def located(self, loc: Sequence[str | int], message: str | None = None) -> Self:
        """Return the error after naming the member of the request that it is about."""
        self.extra["errors"] = [{"loc": [*loc], "msg": message or self.detail, "type": "value_error"}]
        return self


class ParameterError(RequestError):
    """A parameter is unknown or out of range."""

    code = "parameter_invalid"
    advice = "Fix the members that `errors` names."

    @classmethod
    def at(
        cls, loc: Sequence[str | int], detail: str, advice: str | None = None, *, message: str | None = None
    ) -> Self:
        """Return the error about one member of a request.

        Parameters
        ----------
        loc : sequence of str and int
            The path to the member, as in `["params", "control", "handles", 2]`.
        detail : str
            One sentence about this occurrence.
        advice : str, optional
            What to do about it. Default: the class's advice.
        message : str, optional
            What stands beside the member. Default: `detail`.
        """
        return cls(detail, advice=advice).located(loc, message)


class AlignmentError(RequestError):
    """The target mesh could not be placed on the asset."""

    code = "alignment_failed"
    advice = "Turn and move the target onto the asset, and set params.guidance.align to none."


class PromptError(RequestError):
    """The prompt is empty or too long."""

    code = "prompt_invalid"
    advice = "Describe in a few words what the asset should become, for example: a mushroom."


class VocabularyError(RequestError):
    """A word of the prompt is neither a noun, nor a change, nor a word of one's own."""

    code = "prompt_unknown_words"
    advice = (
        "Use one of the suggested prompts, or add the word: `meshdeform words add FILE --noun NOUN`. Free text needs "
        'a Stable Diffusion model: set params.guidance.model to its id or folder (the "sd" extra on the worker).'
    )


class PartNotFoundError(RequestError):
    """The asset has no such part; `parts` lists those that were found."""

    code = "part_not_found"
    advice = "Name a part that `meshdeform inspect` lists."


class IdempotencyMismatchError(RequestError):
    """The Idempotency-Key was used for another request."""

    code = "idempotency_mismatch"
    advice = "Send the same request as the first time, or a new key for a new request."


class ChecksumError(RequestError):
    """The bytes differ from what the sender announced."""

    code = "checksum_mismatch"
    advice = "Send the file again; compare its size and its SHA-256 with what you announced."


class WebhookAddressError(RequestError):
    """The webhook's address is not allowed."""

    code = "webhook_address"
    advice = (
        "Use an https URL whose host has only public addresses. The server's operator can allow other networks, "
        "for example MESHDEFORM_WEBHOOK_NETWORKS=10.1.0.0/16,fd00::/8."
    )


class ModelError(MeshdeformError):
    """The diffusion model cannot be loaded."""

    status = 422
    code = "model_unavailable"
    advice = (
        "Download it once on a machine with internet access (hf download ID --local-dir FOLDER) "
        "and set MESHDEFORM_MODEL to the folder, or use the builtin demonstration prior (model: builtin)."
    )


# A request that may not be made, or not now: keys, resources, conflicts and limits.


class UnauthorizedError(MeshdeformError):
    """The request has no valid API key."""

    status = 401
    code = "unauthorized"
    advice = (
        "Send the header: Authorization: Bearer KEY. The server's operator creates keys with: meshdeform keys create."
    )


class ForbiddenError(MeshdeformError):
    """The signed URL is invalid or has expired."""

    status = 403
    code = "forbidden"
    advice = "Request a new URL."


class NotFoundError(MeshdeformError):
    """Not found."""

    status = 404
    code = "not_found"
    advice = "Check the id; deleting a job also deletes its artifacts."


class AssetNotKeptError(NotFoundError):
    """The asset that a preview names by its hash is not kept, or no longer."""

    code = "asset_not_kept"
    advice = "Send the file again, as the field `asset`."


class MethodNotAllowedError(MeshdeformError):
    """The route does not support this method."""

    status = 405
    code = "method_not_allowed"
    advice = "Use a method listed in the Allow header."


class RequestTimeoutError(MeshdeformError):
    """The request's body arrived too slowly."""

    status = 408
    code = "request_timeout"
    advice = "Send it again; for a large file on a slow connection, use a resumable upload: POST /v1/uploads."


class HeadersTooLargeError(MeshdeformError):
    """The request's headers are too large."""

    status = 431
    code = "headers_too_large"
    advice = "Send fewer or shorter headers, cookies and query parameters."


class RangeError(MeshdeformError):
    """The range begins past the end of the file."""

    status = 416
    code = "range_not_satisfiable"
    advice = "Request a range within the size given in Content-Range; if you have all bytes, the download is complete."


class ConflictError(MeshdeformError):
    """The state of the job, upload or webhook does not allow that."""

    status = 409
    code = "conflict"
    advice = "Check its state first; a finished job never changes."


class JobNotFinishedError(ConflictError):
    """The job has not finished, so that it has no results yet."""

    code = "job_not_finished"
    advice = "Request it again after the seconds in Retry-After; GET /v1/jobs/{id} with Prefer waits for the job's end."


class UnreadableJobError(ConflictError):
    """Another version accepted the job's request, and this one cannot read it."""

    code = "job_unreadable"
    advice = "Use a server of the version that accepted it; any server can cancel or delete it."


class KindRetiredError(UnreadableJobError):
    """Such jobs and models were retired."""

    status = 422
    code = "kind_retired"
    advice = (
        "Add the meshes as a word (meshdeform words add FILE --noun NOUN, or POST /v1/words), and use it in prompts. "
        "docs/changes.md names the last commit with lessons."
    )


class IdempotencyBusyError(ConflictError):
    """The first request with this Idempotency-Key is still in progress."""

    code = "idempotency_in_flight"
    advice = "Send the request again with the same key after the number of seconds in Retry-After."


class StaleAttemptError(ConflictError):
    """A worker wrote for an attempt that it no longer owns."""

    code = "stale_attempt"
    advice = "Nothing to do: another attempt has taken the job over."


class LimitError(MeshdeformError):
    """Rate limit exceeded."""

    status = 429
    code = "rate_limited"
    advice = "Wait for the number of seconds in Retry-After."


class TooManyJobsError(LimitError):
    """Too many unfinished jobs for this API key."""

    code = "too_many_jobs"
    advice = "Wait until a job has finished, or cancel one."


class TooManyUploadsError(LimitError):
    """The API key has too many unused uploads, or too large ones."""

    code = "too_many_uploads"
    advice = "Delete uploads that you do not need, use them in jobs, or wait until they expire."


class TooMuchStoredError(LimitError):
    """The jobs of this owner keep too many bytes."""

    code = "too_much_stored"
    advice = (
        "Delete jobs that you do not need (DELETE /v1/jobs/{id} or meshdeform delete), or wait until their retention "
        "ends. The service's operator can raise MESHDEFORM_MAX_STORED_BYTES."
    )


# Jobs that run, and what they need: checkpoints, workers, devices and other services.


class CheckpointError(MeshdeformError):
    """The checkpoint cannot be used."""

    code = "checkpoint_invalid"
    advice = "Start again from an older checkpoint or from the beginning."


class StoredFileError(MeshdeformError):
    """A stored file is damaged."""

    code = "file_damaged"
    transient = True  # whoever sends the same file again mends it
    advice = "Send the same file again, which replaces the stored copy; a damaged result has to be computed again."


class NumericalError(MeshdeformError):
    """The computation broke down."""

    code = "numerical_failure"
    advice = "Lower learning_rate or guidance_scale, or repair the mesh; report.json says what was skipped."


class WorkerLostError(MeshdeformError):
    """Every attempt at the job lost its worker."""

    code = "worker_lost"
    advice = "Check the workers' logs (a common cause is lack of memory), then post the job again."


class DeviceMemoryError(MeshdeformError):
    """The device ran out of memory in every attempt."""

    code = "gpu_oom"
    advice = "Simplify the mesh, choose a smaller model, or run a worker on a device with more memory."


class RunTimeError(MeshdeformError):
    """The job ran for longer than it may."""

    code = "run_time_exceeded"
    advice = (
        "Retry the job: it goes on from its last checkpoint and may run for as long again, or for the `max_run_s` that "
        "the retry names. Or post it with fewer steps; the service's operator can raise MESHDEFORM_MAX_RUN_S."
    )


class RecordVersionError(MeshdeformError):
    """The record was written by a version of Meshdeform whose records this one cannot use."""

    code = "record_version"
    advice = "Install the version that wrote it: nothing was changed."


class UnavailableError(MeshdeformError):
    """A service that Meshdeform needs does not respond."""

    status = 503
    code = "unavailable"
    advice = "Try again in a moment; /readyz shows which part is unavailable."


class DependencyError(MeshdeformError):
    """A required program or package is not installed."""

    status = 501
    code = "dependency_missing"
    advice = "Install what the message names."


def install_command(extra: str = "") -> str:
    """Return the command that installs Meshdeform, or an extra of it: no index of packages has it."""
    return f'pip install -e "{f".[{extra}]" if extra else "."}", in a clone of Meshdeform'


class ShapeError(ValueError):
    """An array has the wrong shape, dtype or device."""
