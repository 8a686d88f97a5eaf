"""Define the errors of a request that may not be made, or not now: keys, resources, conflicts and limits."""

from __future__ import annotations

from meshdeform.errors.base import MeshdeformError

__all__ = [
    "ConflictError",
    "ForbiddenError",
    "IdempotencyBusyError",
    "JobNotFinishedError",
    "LimitError",
    "MethodNotAllowedError",
    "NotFoundError",
    "RangeError",
    "RequestTimeoutError",
    "StaleAttemptError",
    "TooManyJobsError",
    "TooManyUploadsError",
    "TooMuchStoredError",
    "UnauthorizedError",
    "UnreadableJobError",
]


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
