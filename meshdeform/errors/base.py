"""Define the class from which all errors derive."""

from __future__ import annotations

from typing import Any, ClassVar

__all__ = [
    "MeshdeformError",
]


class MeshdeformError(Exception):
    """Something inside Meshdeform went wrong."""

    status: ClassVar[int] = 500
    code: ClassVar[str] = "internal"
    advice: ClassVar[str] = "Report this with the job's report.json."

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
