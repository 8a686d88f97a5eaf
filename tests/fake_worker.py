"""``python -m tests.fake_worker``: the real worker process with a sum in place of the deformation, and no torch.

Everything around it is real: RQ, the record, the store, leases, checkpoints, signals. ``--supervised`` is the
supervisor of such a process. ``FAKE_STEP_S`` says how long a step takes. Words of a prompt make trouble: `fails`,
`ooms` (in every attempt), `ooms once` (unless there is the file that ``FAKE_OOM_ONCE`` names), `hangs`,
`freezes` (with the interpreter's lock, as compiled code may; there is then the file that ``FAKE_FROZEN`` names), and
`never ends` (after its last step).
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

from meshdeform.errors import NumericalError
from meshdeform.runs.base import RunInput
from meshdeform.serving import processes
from meshdeform.settings import Settings
from tests.fake_kind import FakeKind, OutOfMemoryError
from worker.__main__ import main as supervise
from worker.process import Engine
from worker.process import main as work

TROUBLE_AT = 7


class TroubledKind(FakeKind):
    """A fake kind that does as the prompt says."""

    def __init__(self, step_s: float) -> None:
        super().__init__()
        self._step_s = step_s

    def start(self, given: RunInput) -> Any:
        """Start a run that may run into trouble at its seventh step."""
        self.on_step = lambda step: self._step(step, given.request.prompt)
        self.on_finish = lambda: time.sleep(3600.0 if "never ends" in given.request.prompt else 0.0)
        return super().start(given)

    def _step(self, step: int, prompt: str) -> None:
        time.sleep(self._step_s)
        if step != TROUBLE_AT:
            return
        if "fails" in prompt:
            raise NumericalError("The loss is not finite.")
        if "hangs" in prompt:
            time.sleep(3600.0)
        if "freezes" in prompt:
            Path(os.environ["FAKE_FROZEN"]).touch()  # no thread tells of any step from now on
            ctypes.PyDLL(None).sleep(3600)
        if "ooms" in prompt and not ("ooms once" in prompt and _not_the_first()):
            raise OutOfMemoryError("CUDA out of memory. Tried to allocate 1 GiB.")


def _not_the_first() -> bool:
    try:
        Path(os.environ["FAKE_OOM_ONCE"]).open("x").close()
    except FileExistsError:
        return True
    return False


def engine(settings: Settings) -> Engine:
    """Take the place of `worker.process.torch_engine`."""
    kind = TroubledKind(float(os.environ.get("FAKE_STEP_S", "0.01")))
    return Engine(kind.start, lambda model: None, "cpu")  # type: ignore[arg-type, return-value]


if __name__ == "__main__":
    if "--supervised" in sys.argv[1:]:
        # Workers are killed on purpose here, and nothing is learned from waiting between two of them.
        processes.Backoff = partial(processes.Backoff, 0.05, 0.05)  # type: ignore[assignment, misc]
        supervise("tests.fake_worker")
    else:
        sys.exit(work(engine))
