"""Do in this process what the API leaves to child processes.

Each child imports numpy, and some import torch, which takes seconds; what a child may do and what bounds it has is
tested in `tests/security/test_checks.py`, `tests/unit/assets/test_inspect.py` and with every real `meshdeform serve`.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from meshdeform.assets import check
from meshdeform.children.protocol import Bounds, answer_of, found_in
from meshdeform.children.tasks import entry_point, loaded
from meshdeform.children.warm import Asked, WarmProcesses
from meshdeform.runs import derive, questions

__all__ = ["children_in_process"]

_PARENTS: tuple[ModuleType, ...] = (check, derive, questions)
_one_at_a_time = threading.Lock()


def _run_here(name: str, given: Mapping[str, Any], bounds: Bounds, *, temporary: Path | None = None) -> Any:
    del bounds, temporary
    asked = json.loads(json.dumps(given))
    with _one_at_a_time:
        answer = answer_of(lambda: loaded(entry_point(name))(asked))
    return found_in(json.loads(json.dumps(answer)))


def _ask_here(processes: WarmProcesses, owner: str, given: Mapping[str, Any], timeout_s: float, asked: Asked) -> Any:
    del owner, timeout_s
    with _one_at_a_time:
        answer = answer_of(lambda: loaded(entry_point(processes.name))(given, lambda: asked.stopped))
    return found_in(json.loads(json.dumps(answer)))


@contextmanager
def children_in_process() -> Iterator[None]:
    """Let the API check files and make artifacts in this process, while the block runs."""
    with pytest.MonkeyPatch.context() as patch:
        for parent in _PARENTS:
            patch.setattr(parent, "run_child", _run_here)
        patch.setattr(check, "bound_memory", lambda _: None)  # it would be that of the tests
        patch.setattr(WarmProcesses, "prepare", lambda _: None)
        patch.setattr(WarmProcesses, "ask", _ask_here)
        yield
