"""Keep Python's cyclic garbage collector from searching what a program has loaded. Standard library only."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["collection_paused", "skip_last_collections"]


@contextmanager
def collection_paused(*, keep: bool = False) -> Iterator[None]:
    """Do not look for garbage inside the block, where much is made and hardly anything dropped.

    To import torch and numba makes a million objects, and a thousand collections search them for garbage that is not
    there (docs/performance.md). Outside of programs of our own nothing is paused. With `keep`, what exists at the end
    of the block, such as modules, is also left out of all later collections.
    """
    if not gc.isenabled():  # whoever turned it off, or an outer block, decides
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if keep:
            gc.freeze()
        gc.enable()


def skip_last_collections() -> None:
    """Let the interpreter end without a search for garbage; call it last in a program of our own.

    As it ends, Python looks for cycles several times among all that was ever loaded, which takes longer with torch than
    everything else that ends. What was to be done at the end (`atexit`, `weakref.finalize`) is done as before.
    """
    gc.freeze()
