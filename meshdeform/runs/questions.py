"""Ask a child process something that needs a package that this process lacks, or memory that it should not take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshdeform.children.asking import ChildLostError, run_child
from meshdeform.children.protocol import Bounds
from meshdeform.errors import DependencyError, UnavailableError

__all__ = ["Question"]

_MEMORY_BYTES, _FILE_BYTES = 16 * 2**30, 2**30
"""Address space, of which torch alone maps several gigabytes, and bytes of a file."""


@dataclass(frozen=True)
class Question:
    """A task of a child process, and what to say where it cannot be carried out."""

    task: str
    cannot: str  # what is so where it takes too much: "The front cannot be found on this server."
    lacks: str
    """Sentence for where the child lacks a package: "The front is found with the extra `deform`, which ... lacks"."""
    instead: str  # advice for both

    def ask(self, given: Mapping[str, Any], folder: Path, timeout_s: float) -> Any:
        """Return the answer.

        `given`: JSON for the task; paths must be absolute. `folder`: for the child's temporary files.
        """
        bounds = Bounds(_MEMORY_BYTES, timeout_s, _FILE_BYTES)
        try:
            return run_child(self.task, given, bounds, temporary=folder)
        except TimeoutError as error:
            raise self._too_much(f"It takes longer than {timeout_s:g} s.") from error
        except ChildLostError as error:
            raise self._too_much(f"The process ended with status {error.status}.") from error
        except DependencyError as error:
            raise DependencyError(f"{self.lacks}: {error.detail}", advice=self.instead) from error

    def _too_much(self, reason: str) -> UnavailableError:
        return UnavailableError(f"{self.cannot} {reason}", advice=self.instead)
