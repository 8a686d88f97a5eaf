"""Keep torch's threads out of short operations, and share work among threads that each compute alone.

torch's threads meet after every operation. Operations on a surface or on small pictures take a tenth of a millisecond
or two, so that they would wait as long as they compute, and on a busy machine much longer (docs/performance.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import torch

from meshdeform.support.threads import in_ranges

T = TypeVar("T")


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Let torch compute on one thread inside the block."""
    threads = torch.get_num_threads()
    if threads == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def share_work(work: Callable[[int, int], T], count: int) -> list[T]:
    """Call ``work(begin, end)`` as `in_ranges` does, on threads that do not share torch's operations with others.

    `work`: called with ranges that cover ``range(count)``, in order; which ranges these are must not change the result.
    Gradients are recorded or not as each thread decides: `torch.no_grad` outside does not reach it.
    """

    def alone(begin: int, end: int) -> T:
        torch.set_num_threads(1)  # of this thread, and of those that begin later
        return work(begin, end)

    with one_torch_thread():
        return in_ranges(alone, count)
