"""Keep torch's threads out of short operations.

torch's threads meet after every operation. Operations on a surface or on small pictures take a tenth of a millisecond
or two, so that they would wait as long as they compute, and on a busy machine much longer (docs/performance.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


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
