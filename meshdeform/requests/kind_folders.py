"""Find the kinds of job that have a folder of their own: those of `meshdeform/kinds`, of which nothing else has a list.

What a folder may bring is in its docstring. Importing this imports none of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

__all__ = ["kind_modules", "kind_names", "kind_table"]

_KINDS = "meshdeform.kinds"


@cache
def _folders() -> tuple[str, ...]:
    """Return the full names of the packages."""
    return tuple(f"{_KINDS}.{each.name}" for each in iter_modules(import_module(_KINDS).__path__) if each.ispkg)


def kind_names() -> Iterator[str]:
    """Yield the names of the kinds, in the order of their folders."""
    for folder in _folders():
        yield from import_module(folder).NAMES


@cache
def kind_modules(module: str) -> tuple[ModuleType, ...]:
    """Return the modules of this name, one of each folder that has one."""
    names = (f"{folder}.{module}" for folder in _folders())
    return tuple(import_module(name) for name in names if find_spec(name) is not None)


def kind_table(module: str, table: str) -> Mapping[str, Any]:
    """Return what the folders have in the table of this name in these modules."""
    return {key: value for each in kind_modules(module) for key, value in getattr(each, table, {}).items()}
