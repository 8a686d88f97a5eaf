"""Let the processes of a tests' service draw and measure less, as the tests' own process does.

Python imports a module of this name at its start if its folder is on the module path: `Service` in
tests/acceptance/service.py puts it there. Nothing is imported for it; a module is changed once a process imports it.
"""

from __future__ import annotations

import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

SMALLER: dict[str, dict[str, Any]] = {
    "meshdeform.kinds.surface_fit.oriented_points": {"_MOST": 48},
    "meshdeform.geometry.target_distance": {"_FIT_SAMPLES": 2000},
    "meshdeform.guidance.points": {"SAMPLES": 2000},
    "meshdeform.reading.banks": {"_WISHED": 48, "_WISHED_WITH_ATTRIBUTES": 24},
    "meshdeform.rendering.studio": {"_SIZE": 32},
    "meshdeform.runs.rehearsal": {"rehearse": lambda: None},
    "service.jobs.previews": {"PREVIEW_S": 600.0},
}
"""What takes a short job longer than its steps: previews, the samples by which it fits and measures fits, the members
that it chooses an exemplar from, the grid that points are made a surface on, and what a worker does before its first
job, which the jobs of most tests do not need. A preview gives way to all else, so that beside other tests
it may take as long as only a hang would."""


class _Changing(Loader):
    """Loads a module and changes its constants."""

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        self._loader.exec_module(module)
        for constant, value in SMALLER[module.__name__].items():
            assert hasattr(module, constant), f"{module.__name__} has no {constant}"
            setattr(module, constant, value)


class _Finder(MetaPathFinder):
    """Finds the modules that are changed; all others are left to the usual finders."""

    def find_spec(self, name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path, target) if name in SMALLER else None
        if spec is not None and spec.loader is not None:
            spec.loader = _Changing(spec.loader)
        return spec


if __name__ == "sitecustomize":
    sys.meta_path.insert(0, _Finder())
