"""Ask a child process something that needs torch, for a process without it.

The child has no secrets in its environment, and bounded memory and time. Importing this loads neither numpy nor torch.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshdeform.assets.limits import bound_memory, error_from, error_to_json, run_child
from meshdeform.errors import DependencyError, MeshdeformError, ModelError, UnavailableError

_MEMORY_BYTES = 16 * 2**30
"""Address space; torch alone maps several gigabytes of it."""


@dataclass(frozen=True)
class Question:
    """A question that a module's `main` answers in a child process by `answer`."""

    module: str  # its full name
    cannot: str  # what is so where it takes too much: "The front cannot be found on this server."
    lacks: str
    """Sentence for where the child lacks a package: "The front is found with the extra `deform`, which ... lacks"."""
    instead: str  # advice for both

    def ask(self, arguments: list[str], folder: Path, timeout_s: float) -> Any:
        """Return the answer.

        `arguments`: the child's command line; paths must be absolute. `folder`: for its temporary files.
        """
        try:
            child = run_child(self.module, arguments, timeout_s=timeout_s, temporary=folder)
        except TimeoutError as error:
            raise self._too_much(f"It takes longer than {timeout_s:g} s.") from error
        if child.verdict is None:
            raise self._too_much(f"The process ended with status {child.returncode}.")
        if not child.verdict["ok"]:
            raise self._error(child.verdict["error"])
        return child.verdict["found"]

    def ask_about(self, file: Path, task: Mapping[str, Any], timeout_s: float) -> Any:
        """Return the answer to a task, which the child's `main` hands to `answer_task`; it lies beside the file."""
        path = file.absolute().with_name(f"{self.module.rpartition('.')[2]}.json")
        path.write_text(json.dumps({**task, "asset": str(file.absolute())}))
        return self.ask([str(path)], path.parent, timeout_s)

    def _error(self, answer: dict[str, Any]) -> MeshdeformError:
        if answer["code"] == DependencyError.code:
            return DependencyError(f"{self.lacks}: {answer['detail']}", advice=self.instead)
        if answer["code"] == ModelError.code:
            return ModelError(answer["detail"], advice=answer["advice"], **answer["extra"])
        return error_from(answer)

    def _too_much(self, reason: str) -> UnavailableError:
        return UnavailableError(f"{self.cannot} {reason}", advice=self.instead)


def answer(find: Callable[[], Any]) -> int:
    """Print the result of `find`, or its error, as a JSON verdict; return the exit status. For the child's `main`."""
    bound_memory(_MEMORY_BYTES)
    try:
        verdict: dict[str, Any] = {"ok": True, "found": find()}
    except MeshdeformError as error:
        verdict = {"ok": False, "error": error_to_json(error)}
    except ModuleNotFoundError as error:
        verdict = {"ok": False, "error": error_to_json(DependencyError(f"{error.name} is not installed."))}
    print(json.dumps(verdict))
    return 0 if verdict["ok"] else 1


def answer_task(find: Callable[[dict[str, Any]], Any], arguments: Sequence[str] | None) -> int:
    """Answer the task of `Question.ask_about`, whose file is the only argument, by what `find` makes of it."""
    (path,) = sys.argv[1:] if arguments is None else arguments
    return answer(lambda: find(json.loads(Path(path).read_text())))
