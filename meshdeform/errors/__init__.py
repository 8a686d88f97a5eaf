"""Define every error that Meshdeform raises on purpose, with its HTTP status, stable code and advice.

::

    MeshdeformError                    500  internal
    ├── AssetError                     422  asset_invalid          the uploaded file
    │   ├── AssetFormatError           415  asset_format           not a GLB, OBJ, PLY, STL or ZIP
    │   ├── AssetTruncatedError        422  asset_truncated        bytes are missing, or a length is wrong
    │   ├── AssetTooLargeError         413  asset_too_large        exceeds a limit of this server
    │   ├── AssetExternalError         422  asset_external_uri     refers to a file that was not sent
    │   ├── AssetUnsupportedError      422  asset_unsupported      needs an extension that we cannot decode
    │   ├── AssetNotFiniteError        422  asset_not_finite       NaN or infinite positions
    │   ├── AssetEmptyError            422  asset_no_triangles     nothing to deform
    │   ├── DrawingError               422  not_a_drawing          a picture that is not a line drawing
    │   └── SilhouetteError            422  silhouette_unusable    a picture without a plain background, or an object
    ├── RequestError                   422  request_invalid        the request document
    │   ├── ParameterError             422  parameter_invalid      unknown name, or value out of range
    │   ├── AlignmentError             422  alignment_failed       the target could not be placed on the asset
    │   ├── PromptError                422  prompt_invalid         empty or too long
    │   ├── VocabularyError            422  prompt_unknown_words   the builtin prior does not know a word
    │   ├── IdempotencyMismatchError   422  idempotency_mismatch   an Idempotency-Key was reused for another request
    │   ├── ChecksumError              422  checksum_mismatch      an upload has another size or digest than announced
    │   └── WebhookAddressError        422  webhook_address        a webhook's address is not allowed
    ├── ModelError                     422  model_unavailable      a diffusion model cannot be loaded
    ├── UnauthorizedError              401  unauthorized           no valid API key
    ├── ForbiddenError                 403  forbidden              a signed URL is invalid or has expired
    ├── NotFoundError                  404  not_found              no such job, artifact or route
    ├── MethodNotAllowedError          405  method_not_allowed     the route does not support this method
    ├── RequestTimeoutError            408  request_timeout        the body arrives too slowly
    ├── RangeError                     416  range_not_satisfiable  the range begins past the end
    ├── ConflictError                  409  conflict               the resource's state does not allow it
    │   ├── JobNotFinishedError        409  job_not_finished       a result was requested before the job finished
    │   ├── UnreadableJobError         409  job_unreadable         another version's request, unknown to this one
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
    ├── UnavailableError               503  unavailable            Redis, the record or the store does not respond
    └── DependencyError                500  dependency_missing     an optional package or program is not installed

`ShapeError` is a plain `ValueError` for programming mistakes inside the numerical core.
"""

from __future__ import annotations

from meshdeform.errors.access import (
    ConflictError,
    ForbiddenError,
    IdempotencyBusyError,
    JobNotFinishedError,
    LimitError,
    MethodNotAllowedError,
    NotFoundError,
    RangeError,
    RequestTimeoutError,
    StaleAttemptError,
    TooManyJobsError,
    TooManyUploadsError,
    TooMuchStoredError,
    UnauthorizedError,
    UnreadableJobError,
)
from meshdeform.errors.base import (
    MeshdeformError,
)
from meshdeform.errors.inputs import (
    AlignmentError,
    AssetEmptyError,
    AssetError,
    AssetExternalError,
    AssetFormatError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
    ChecksumError,
    DrawingError,
    IdempotencyMismatchError,
    ModelError,
    ParameterError,
    PromptError,
    RequestError,
    SilhouetteError,
    VocabularyError,
    WebhookAddressError,
)
from meshdeform.errors.running import (
    CheckpointError,
    DependencyError,
    DeviceMemoryError,
    NumericalError,
    ShapeError,
    StoredFileError,
    UnavailableError,
    WorkerLostError,
    install_command,
)

__all__ = [
    "AlignmentError",
    "AssetEmptyError",
    "AssetError",
    "AssetExternalError",
    "AssetFormatError",
    "AssetNotFiniteError",
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
    "IdempotencyBusyError",
    "IdempotencyMismatchError",
    "JobNotFinishedError",
    "LimitError",
    "MeshdeformError",
    "MethodNotAllowedError",
    "ModelError",
    "NotFoundError",
    "NumericalError",
    "ParameterError",
    "PromptError",
    "RangeError",
    "RequestError",
    "RequestTimeoutError",
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
