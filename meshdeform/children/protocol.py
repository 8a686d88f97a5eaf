"""What a child is given and what it answers, as JSON: the same for one that ends and for one that is kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from meshdeform.errors import (
    AssetError,
    DependencyError,
    MeshdeformError,
    ModelError,
    NumericalError,
    RequestError,
    UnavailableError,
)

__all__ = ["ANSWERS", "OUT_OF_MEMORY", "Bounds", "StoppedError", "answer_of", "bound_memory", "found_in"]

OUT_OF_MEMORY = 71
"""The status of a child that ends as it may not have more memory."""
ANSWERS = ({"found"}, {"error"}, {"stopped"})
"""The members that an answer has: one of these."""


class StoppedError(Exception):
    """Nobody waits for the answer any more."""


@dataclass(frozen=True)
class Bounds:
    """What a child may use: address space, seconds, and bytes of a file that it writes."""

    memory_bytes: int
    seconds: float | None
    """Of the clock for its parent, and of the processor for the kernel. None: it is kept."""
    file_bytes: int = 0

    def apply(self) -> None:
        """Limit this process, and forbid core dumps."""
        try:
            import resource
        except ImportError:  # Windows has no rlimits; the limits on counts still apply there
            return
        bound_memory(self.memory_bytes)
        resource.setrlimit(resource.RLIMIT_FSIZE, (self.file_bytes, self.file_bytes))
        if self.seconds is not None:
            longest = math.ceil(self.seconds) + 1
            resource.setrlimit(resource.RLIMIT_CPU, (longest, longest))


def bound_memory(limit: int) -> None:
    """Limit this process's address space to `limit` bytes and disable core dumps."""
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or hard > limit:
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def answer_of(find: Callable[[], Any]) -> dict[str, Any]:
    """Return what a child says: what it found, its error, or that it was stopped."""
    try:
        return {"found": find()}
    except StoppedError:
        return {"stopped": True}
    except MeshdeformError as error:
        return _told(error)
    except ModuleNotFoundError as error:
        return _told(DependencyError(f"{error.name} is not installed."))


def found_in(answer: dict[str, Any]) -> Any:
    """Return what a child found, or raise what it raised."""
    if "stopped" in answer:
        raise StoppedError
    if "error" in answer:
        raise _raised(answer["error"])
    return answer["found"]


def _told(error: MeshdeformError) -> dict[str, Any]:
    told = {"code": error.code, "detail": error.detail, "advice": error.advice_text, "extra": error.extra}
    return {"error": told}


def _raised(told: dict[str, Any]) -> MeshdeformError:
    """Return the error of a child, which may say no more than that of a file, of a request, or of what is there."""
    others = (*RequestError.__subclasses__(), DependencyError, ModelError, NumericalError, UnavailableError)
    kinds: list[type[MeshdeformError]] = [AssetError, *AssetError.__subclasses__(), *others]
    kind = next((kind for kind in kinds if kind.code == told["code"]), AssetError)
    return kind(told["detail"], advice=told["advice"], **told["extra"])
