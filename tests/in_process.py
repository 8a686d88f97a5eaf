"""Do in this process what the API leaves to child processes.

Each child imports numpy, and some import torch, which takes seconds; what a child may do and what bounds it has is
tested in `tests/security/test_checks.py`, `tests/unit/assets/test_inspect.py` and with every real `meshdeform serve`.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from meshdeform.assets import check
from meshdeform.assets.limits import ChildOutcome
from meshdeform.runs import derive, questions
from meshdeform.runs.warm_processes import Asked, StoppedError, WarmProcesses, verdict_of

__all__ = ["children_in_process"]

_PARENTS: tuple[ModuleType, ...] = (check, derive, questions)
_one_at_a_time = threading.Lock()


def _run_here(module: str, arguments: list[str], *, timeout_s: float, temporary: Path | None = None) -> ChildOutcome:
    del timeout_s, temporary
    child = import_module(module)
    printed: list[str] = []
    with _one_at_a_time, pytest.MonkeyPatch.context() as patch:
        for place in (child, questions):
            patch.setattr(place, "print", printed.append, raising=False)
            for bound in ("bound_resources", "bound_memory"):
                patch.setattr(place, bound, lambda *_: None, raising=False)  # they would be those of the tests
        code = child.main(arguments)
    return ChildOutcome(code, json.loads(printed[-1]))


def _ask_here(
    processes: WarmProcesses, owner: str, task: dict[str, Any], timeout_s: float, asked: Asked
) -> dict[str, Any]:
    del owner, timeout_s
    with _one_at_a_time:
        verdict = verdict_of(import_module(processes.module).answer, task, lambda: asked.stopped)
    if verdict.get("stopped"):
        raise StoppedError
    return verdict


@contextmanager
def children_in_process() -> Iterator[None]:
    """Let the API check files and make artifacts in this process, while the block runs."""
    with pytest.MonkeyPatch.context() as patch:
        for parent in _PARENTS:
            patch.setattr(parent, "run_child", _run_here)
        patch.setattr(WarmProcesses, "prepare", lambda _: None)
        patch.setattr(WarmProcesses, "ask", _ask_here)
        yield
