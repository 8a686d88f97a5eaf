"""Choose the device and the number of threads by their settings. Imports torch only where a device is asked for."""

from __future__ import annotations

import re
import sys
from importlib.util import find_spec
from pathlib import Path

from meshdeform.errors import ParameterError
from meshdeform.support.memory import keep_freed_memory
from meshdeform.support.threads import choose_threads, default_threads, usable_threads

_DRIVERS = ("/dev/nvidiactl", "/dev/nvidia0", "/dev/dxg", "/dev/kfd")
"""What a Linux system has if it has a driver for a GPU: NVIDIA's, that of Windows under WSL, AMD's."""


def resolve_device(name: str) -> str:
    """Return the device of a setting: `auto` is CUDA if available, otherwise the CPU; other names are checked."""
    check_name(name)
    if name == "cpu" or (name == "auto" and not _may_have_cuda()):
        return "cpu"
    import torch

    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if (torch.device(name).index or 0) >= torch.cuda.device_count():
        raise ParameterError(
            f"The device {name!r} is not on this machine ({torch.cuda.device_count()} CUDA devices are).",
            advice="Choose auto or cpu; a CUDA device also needs a CUDA build of torch.",
        )
    return name


def check_name(name: str) -> None:
    """Refuse what is the name of no device, as ParameterError; whether this machine has it, is not looked up."""
    if not re.fullmatch(r"auto|cpu|cuda(:\d+)?", name):
        raise ParameterError(f"There is no device {name!r}.", advice="Choose auto, cpu, cuda or cuda:N.")


def _may_have_cuda() -> bool:
    """Return whether torch, which takes a second to import, may find a GPU."""
    if find_spec("torch") is None:
        return False
    return sys.platform != "linux" or any(Path(driver).exists() for driver in _DRIVERS)


def use_threads(count: int) -> int:
    """Set the number of CPU threads, torch's and ours, and return it; 0 is `support.threads.default_threads`.

    The process also keeps the memory of freed arrays (`support.memory.keep_freed_memory`).
    """
    keep_freed_memory()
    threads = count or default_threads()
    choose_threads(threads)
    share_with_torch()
    return threads


def share_with_torch() -> None:
    """Give torch the threads that were chosen, if it has been imported."""
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(usable_threads())
