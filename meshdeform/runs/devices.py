"""Choose the device and the number of threads by their settings."""

from __future__ import annotations

import torch

from meshdeform.errors import ParameterError
from meshdeform.support.threads import choose_threads, default_threads, keep_freed_memory


def resolve_device(name: str) -> str:
    """Return the device of a setting: `auto` is CUDA if available, otherwise the CPU; other names are checked."""
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(name)
    except RuntimeError:
        device = None
    if device is None or device.type not in ("cpu", "cuda"):
        raise ParameterError(f"There is no device {name!r}.", advice="Choose auto, cpu, cuda or cuda:N.")
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        raise ParameterError(
            f"The device {name!r} is not on this machine ({torch.cuda.device_count()} CUDA devices are).",
            advice="Choose auto or cpu; a CUDA device also needs a CUDA build of torch.",
        )
    return name


def use_threads(count: int) -> int:
    """Set the number of CPU threads, torch's and ours, and return it; 0 is `support.threads.default_threads`.

    The process also keeps the memory of freed tensors (`support.memory.keep_freed_memory`).
    """
    keep_freed_memory()
    threads = count or default_threads()
    choose_threads(threads)
    torch.set_num_threads(threads)
    return threads
