"""The tasks of child processes by name: a function each, which takes what is given and returns what it found as JSON.

Those that are kept (`warm`) also take a function that says whether to stop, which they ask now and then. Kinds of job
bring further ones.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from meshdeform.requests.kind_folders import kind_table

__all__ = ["TASKS", "entry_point", "loaded"]

TASKS = {
    "copies": "meshdeform.children.warm:make_copies",
    "check": "meshdeform.assets.check:check_given",
    "derive": "meshdeform.runs.derive:derive_given",
    "outlook": "meshdeform.runs.outlook:find_outlook",
    "parts": "meshdeform.runs.changes:find_parts_asked",
    "preview": "meshdeform.runs.preview_work:make_preview",
}


def entry_point(task: str) -> str:
    """Return the entry point of a task, `module:function`."""
    found: str = TASKS[task] if task in TASKS else kind_table("child_tasks", "TASKS")[task]
    return found


def loaded(entry: str) -> Callable[..., Any]:
    """Return the function of an entry point; `ModuleNotFoundError`: a package that it needs is missing."""
    module, _, name = entry.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function
