"""Ask a child process: start it without secrets, give it a task, and wait for its answer."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshdeform.children.protocol import ANSWERS, OUT_OF_MEMORY, Bounds, found_in
from meshdeform.children.tasks import entry_point
from meshdeform.errors import UnavailableError

__all__ = ["ChildLostError", "ended_with", "run_child", "start_child"]

# Our package's folder comes last, so that a file beside it cannot replace an installed module. A child lives for
# seconds, most of which are imports: they make a million objects that would be searched for garbage after each 700, and
# again as it ends.
_PROGRAM = """
import gc, sys
gc.set_threshold(20_000)
sys.path.append(sys.argv.pop(1))
from meshdeform.children.program import main
try:
    sys.exit(main())
finally:
    gc.freeze()
"""
_POLL_S = 0.1
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# fmt: off
_PASSED_ON = frozenset({
    "PATH", "HOME", "LANG", "LC_ALL", "LC_CTYPE", "TMPDIR", "TEMP", "TMP", "SYSTEMROOT", "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH", "PYTHONHOME",
    # What decides the last bits of a number: a preview is to have those of its job.
    "OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE", "NVPL_BLAS_DEBUG_CPU_TYPE", "MKL_CBWR", "NPY_DISABLE_CPU_FEATURES",
})
# fmt: on
_gone: ContextVar[Callable[[], bool]] = ContextVar("_gone", default=lambda: False)


class ChildLostError(Exception):
    """A child has ended without an answer: crashed, or killed for what it used.

    `status`: its exit status, negative if a signal ended it; None: of one that was kept.
    """

    def __init__(self, status: int | None = None) -> None:
        super().__init__(f"a child process ended with status {status}")
        self.status = status

    @property
    def out_of_memory(self) -> bool:
        """Whether it ended as one does that takes too much memory."""
        return self.status in (0, OUT_OF_MEMORY, -signal.SIGKILL)


@contextmanager
def ended_with(gone: Callable[[], bool]) -> Iterator[None]:
    """End the children that are run within, in this context, once nobody waits for them any more."""
    token = _gone.set(gone)
    try:
        yield
    finally:
        _gone.reset(token)


def run_child(task: str, given: Mapping[str, Any], bounds: Bounds, *, temporary: Path | None = None) -> Any:
    """Run a task in a child process, and return what it found.

    Parameters
    ----------
    task : str
        Its name.
    given : mapping
        JSON for its function; paths must be absolute.
    bounds : Bounds
        What it may use.
    temporary : Path, optional
        The folder for its temporary files. Default: the system's.

    Raises
    ------
    TimeoutError, ChildLostError
        It took too long, or ended without an answer.
    UnavailableError
        The machine cannot start a process now, or nobody waits for it.
    MeshdeformError
        What the task raised.
    """
    assert bounds.seconds is not None
    until = time.monotonic() + bounds.seconds
    with start_child(task, given, bounds, temporary=temporary) as child:
        try:
            answer = _printed(child, until)
        except BaseException:
            child.kill()
            raise
    try:
        said = json.loads(answer)
    except ValueError:
        said = None
    if not isinstance(said, dict) or said.keys() not in ANSWERS:
        raise ChildLostError(child.returncode)
    return found_in(said)


def start_child(
    task: str, given: Mapping[str, Any], bounds: Bounds, *, passed: Sequence[int] = (), temporary: Path | None = None
) -> subprocess.Popen[bytes]:
    """Start a task, as `run_child` does, and do not wait for it; `passed`: file descriptors that it gets."""
    root = Path(__file__).resolve().parents[2]
    # -P leaves the current folder out of the module path. The task's name is for whoever lists processes.
    command = [sys.executable, "-P", "-c", _PROGRAM, str(root), task]
    asked = {"task": entry_point(task), "given": given, "bounds": asdict(bounds)}
    try:
        # Not a pipe, which holds little: the rest would have to be written while the child starts.
        with tempfile.TemporaryFile(dir=temporary) as file:
            file.write(json.dumps(asked).encode())
            file.seek(0)
            return subprocess.Popen(
                command,
                env=_environment(temporary),
                cwd=root.anchor,
                stdin=file,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                pass_fds=passed,
            )
    except OSError as error:
        raise UnavailableError(f"No process can be started now: {error.strerror}.") from error


def _printed(child: subprocess.Popen[bytes], until: float) -> bytes:
    """Return what a child has printed when it ends."""
    while True:
        with suppress(subprocess.TimeoutExpired):
            return child.communicate(timeout=_POLL_S)[0]
        if time.monotonic() > until:
            raise TimeoutError
        if _gone.get()():
            raise UnavailableError("The caller has gone.")


def _environment(temporary: Path | None = None) -> dict[str, str]:
    """Return the child's environment: what an interpreter needs, and no secrets."""
    environment = {name: value for name, value in os.environ.items() if name in _PASSED_ON}
    folders = [folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if Path(folder).is_absolute()]
    one_thread = dict.fromkeys(_THREADS, "1")
    own = {} if temporary is None else {"TMPDIR": str(temporary)}
    return {**environment, **one_thread, **own, "PYTHONPATH": os.pathsep.join(folders)}
