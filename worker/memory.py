"""Whether an error says that the device ran out of memory. Needs no torch: a fake may raise one as well."""

from __future__ import annotations

__all__ = ["is_out_of_memory"]

_NAME = "OutOfMemoryError"
# What CUDA and its libraries say where torch has no class for it.
_WORDS = ("CUDA error: out of memory", "CUBLAS_STATUS_ALLOC_FAILED", "CUDNN_STATUS_ALLOC_FAILED")


def is_out_of_memory(error: BaseException | None) -> bool:
    """Whether the error, or the one that it was made of, is a `torch.OutOfMemoryError` or its like."""
    while error is not None:
        if any(each.__name__ == _NAME for each in type(error).__mro__):
            return True
        if isinstance(error, RuntimeError) and any(words in str(error) for words in _WORDS):
            return True
        error = error.__cause__
    return False
