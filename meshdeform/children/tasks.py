"""The tasks of child processes by name: a function each, which takes what is given and returns what it found as JSON.

Those that are kept (`warm`) also take a function that says whether to stop, which they ask now and then.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

__all__ = ["TASKS", "task"]

TASKS = {
    "copies": "meshdeform.children.warm:make_copies",
    "check": "meshdeform.assets.check:check_given",
    "derive": "meshdeform.runs.derive:derive_given",
    "drawing": "meshdeform.runs.sketch_process:read_drawing",
    "outlook": "meshdeform.runs.outlook:find_outlook",
    "parts": "meshdeform.runs.changes:find_parts_asked",
    "preview": "meshdeform.runs.preview_work:make_preview",
    "sketch": "meshdeform.runs.sketch_process:make_shape",
    "word": "meshdeform.runs.word_process:make_given",
    "word_picture": "meshdeform.runs.word_process:draw_given",
}


def task(place: str) -> Callable[..., Any]:
    """Return the function at a place, as `TASKS` has it; `ModuleNotFoundError`: a package that it needs is missing."""
    module, _, name = place.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function
