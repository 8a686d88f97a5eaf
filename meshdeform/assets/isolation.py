"""Run code that reads users' files in a child process, with bounded memory, time and files.

The child gets neither the environment's secrets nor the current folder, and prints a verdict as JSON in its last line.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshdeform.errors import AssetError, DependencyError, MeshdeformError, ParameterError, UnavailableError

# Our package's folder comes last, so that a file beside it cannot replace an installed module. A child lives for
# seconds, most of which are imports: they make a million objects that would be searched for garbage after each 700, and
# again as it ends (`support.memory`).
_PROGRAM = """
import gc, sys
gc.set_threshold(20_000)
sys.path.append(sys.argv.pop(1))
from {module} import main
try:
    sys.exit(main())
finally:
    gc.freeze()
"""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# fmt: off
_PASSED_ON = frozenset({
    "PATH", "HOME", "LANG", "LC_ALL", "LC_CTYPE", "TMPDIR", "TEMP", "TMP", "SYSTEMROOT", "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH", "PYTHONHOME",
})
# fmt: on


@dataclass(frozen=True)
class ChildOutcome:
    """How a child process ended."""

    returncode: int  # negative if a signal ended it
    verdict: dict[str, Any] | None  # what it printed; None if it did not get that far


def run_child(module: str, arguments: list[str], *, timeout_s: float, temporary: Path | None = None) -> ChildOutcome:
    """Run the function `main` of a module of this package in a child process.

    `module`: its full name. `arguments`: its command line; paths must be absolute. `temporary`: the folder for the
    child's temporary files. Default: the system's.
    """
    root = Path(__file__).resolve().parents[2]
    # -P leaves the current folder out of the module path.
    command = [sys.executable, "-P", "-c", _PROGRAM.format(module=module), str(root), *arguments]
    try:
        child = subprocess.run(
            command,
            env=_environment(temporary),
            cwd=root.anchor,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise TimeoutError from error
    except OSError as error:
        raise UnavailableError(f"No process can be started now: {error.strerror}.") from error
    return ChildOutcome(child.returncode, _verdict(child.stdout))


def _environment(temporary: Path | None = None) -> dict[str, str]:
    """Return the child's environment: what an interpreter needs, and no secrets."""
    found = {name: value for name, value in os.environ.items() if name in _PASSED_ON}
    folders = [folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if Path(folder).is_absolute()]
    one_thread = dict.fromkeys(_THREADS, "1")
    own = {} if temporary is None else {"TMPDIR": str(temporary)}
    return {**found, **one_thread, **own, "PYTHONPATH": os.pathsep.join(folders)}


def _verdict(stdout: bytes) -> dict[str, Any] | None:
    """Return the child's verdict from its last line; a decoder may have printed something before it."""
    try:
        verdict = json.loads((stdout.splitlines() or [b""])[-1])
    except ValueError:
        return None
    return verdict if isinstance(verdict, dict) and "ok" in verdict else None


def error_to_json(error: MeshdeformError) -> dict[str, Any]:
    """Return an error as the child prints it."""
    return {"code": error.code, "detail": error.detail, "advice": error.advice_text, "extra": error.extra}


def error_from(found: dict[str, Any]) -> MeshdeformError:
    """Return the error that a child has printed."""
    others = (DependencyError, ParameterError, UnavailableError)
    kinds: list[type[MeshdeformError]] = [AssetError, *AssetError.__subclasses__(), *others]
    kind = next((kind for kind in kinds if kind.code == found["code"]), AssetError)
    return kind(found["detail"], advice=found["advice"], **found["extra"])


def bound_resources(memory_bytes: int, seconds: float, file_bytes: int = 0) -> None:
    """Limit this process's address space, CPU time and the size of files that it writes; forbid core dumps."""
    try:
        import resource
    except ImportError:  # Windows has no rlimits; the limits on counts still apply there
        return
    bound_memory(memory_bytes)
    # The parent limits the wall-clock time; this ends a child whose parent has died.
    for bound, wanted in ((resource.RLIMIT_CPU, math.ceil(seconds) + 1), (resource.RLIMIT_FSIZE, file_bytes)):
        resource.setrlimit(bound, (wanted, wanted))


def bound_memory(wanted: int) -> None:
    """Limit this process's address space to `wanted` bytes and disable core dumps."""
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or hard > wanted:
        resource.setrlimit(resource.RLIMIT_AS, (wanted, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
