"""Define the limits on an asset, which are checked on its JSON before anything is allocated. Pure Python.

Run code that reads users' files in a child process, with bounded memory, time and files.

The child gets neither the environment's secrets nor the current folder, and prints a verdict as JSON in its last line.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from meshdeform.errors import (
    AssetError,
    AssetTooLargeError,
    DependencyError,
    MeshdeformError,
    NumericalError,
    RequestError,
    UnavailableError,
)

if TYPE_CHECKING:
    from meshdeform.settings import Settings

# Address space of a check: what Python, numpy and trimesh map, plus a multiple of the file's size for its arrays.
CHECK_BASE_BYTES = 512 * 2**20
CHECK_BYTES_PER_BYTE = 16
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
_POLL_S = 0.1
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# fmt: off
_PASSED_ON = frozenset({
    "PATH", "HOME", "LANG", "LC_ALL", "LC_CTYPE", "TMPDIR", "TEMP", "TMP", "SYSTEMROOT", "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH", "PYTHONHOME",
    # What decides the last bits of a number: a preview is to have those of its job.
    "OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE", "NVPL_BLAS_DEBUG_CPU_TYPE", "MKL_CBWR", "NPY_DISABLE_CPU_FEATURES",
})
_gone: ContextVar[Callable[[], bool]] = ContextVar("_gone", default=lambda: False)


@dataclass(frozen=True)
class Limits:
    """Upper bounds on one asset. `from_settings` sets those that a deployment can configure."""

    max_bytes: int = 100 * 2**20
    """Size of the file, and of its compressed parts after decoding: a compressed asset may not become larger than an
    uncompressed one."""
    max_json_bytes: int = 16 * 2**20  # size of a GLB's JSON chunk
    max_accessor_elements: int = 20_000_000  # `count` of one accessor
    max_triangles: int = 1_000_000  # triangles to deform, over all instances
    max_bare_elements: int = 250_000
    """`count` of a vertex or index accessor that has no data in the file (its elements are zeros by definition)."""
    # Values in the JSON (Python objects cost up to 100 times their text) and their nesting depth. They also bound the
    # number of nodes, meshes, materials, images and animations, since each takes at least two values.
    max_json_values: int = 500_000
    max_json_depth: int = 128
    max_primitives: int = 50_000
    """Primitives and their morph targets in the default scene, over all instances: a few hundred values of JSON can
    describe a thousand instances of a thousand primitives."""
    max_chunks: int = 1000  # number of chunks in a GLB
    max_archive_files: int = 1000  # entries of a ZIP; together they may unpack to `max_bytes`
    max_memory_bytes: int = CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * 100 * 2**20
    """Address space of the process that first decodes a file. Small files get less."""
    max_check_s: float = 60.0  # seconds that this first decoding may take

    @property
    def max_vertices(self) -> int:
        """Vertices to deform, over all instances: four per triangle, to allow for some that no triangle uses."""
        return 4 * self.max_triangles

    def check_bytes(self, size: int, has: str = "The file has") -> None:
        """Raise AssetTooLargeError for more than `max_bytes`; `has` says what has them."""
        if size > self.max_bytes:
            raise AssetTooLargeError.more_than(self.max_bytes, has)

    @classmethod
    def from_settings(cls, settings: Settings) -> Self:
        """Return the limits given by a deployment's settings."""
        return cls(
            max_bytes=settings.max_upload_bytes,
            max_json_bytes=settings.max_json_bytes,
            max_accessor_elements=settings.max_accessor_elements,
            max_triangles=settings.max_triangles,
            max_memory_bytes=CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * settings.max_upload_bytes,
        )

    @classmethod
    def unlimited(cls) -> Self:
        """Return limits for our own output, which may be larger than an input that passed the real ones."""
        return cls(
            max_bytes=2**40,
            max_json_bytes=2**40,
            max_accessor_elements=2**40,
            max_triangles=2**40,
            max_bare_elements=2**40,
            max_json_values=2**40,
            max_primitives=2**40,
        )

    def memory_bytes(self, size: int) -> int:
        """Return the address space, in bytes, for checking a file of `size` bytes."""
        return min(self.max_memory_bytes, CHECK_BASE_BYTES + CHECK_BYTES_PER_BYTE * size)


# fmt: on


@dataclass(frozen=True)
class ChildOutcome:
    """How a child process ended."""

    returncode: int  # negative if a signal ended it
    verdict: dict[str, Any] | None  # what it printed; None if it did not get that far


@contextmanager
def ended_with(gone: Callable[[], bool]) -> Iterator[None]:
    """End the children that are run within, in this context, once nobody waits for them any more."""
    token = _gone.set(gone)
    try:
        yield
    finally:
        _gone.reset(token)


def run_child(module: str, arguments: list[str], *, timeout_s: float, temporary: Path | None = None) -> ChildOutcome:
    """Run the function `main` of a module of this package in a child process.

    `module`: its full name. `arguments`: its command line; paths must be absolute. `temporary`: the folder for the
    child's temporary files. Default: the system's. Raises TimeoutError, and UnavailableError if nobody waits for it.
    """
    until = time.monotonic() + timeout_s
    with start_child(module, arguments, temporary=temporary) as child:
        try:
            stdout = _printed(child, until)
        except BaseException:
            child.kill()
            raise
    return ChildOutcome(child.returncode, _verdict(stdout))


def _printed(child: subprocess.Popen[bytes], until: float) -> bytes:
    """Return what a child has printed when it ends."""
    while True:
        with suppress(subprocess.TimeoutExpired):
            return child.communicate(timeout=_POLL_S)[0]
        if time.monotonic() > until:
            raise TimeoutError
        if _gone.get()():
            raise UnavailableError("The caller has gone.")


def start_child(
    module: str, arguments: list[str], *, passed: Sequence[int] = (), temporary: Path | None = None
) -> subprocess.Popen[bytes]:
    """Start the function `main` of a module of this package in a child process, as `run_child` does.

    `passed`: file descriptors that it gets. `UnavailableError`: the machine cannot start a process now.
    """
    root = Path(__file__).resolve().parents[2]
    # -P leaves the current folder out of the module path.
    command = [sys.executable, "-P", "-c", _PROGRAM.format(module=module), str(root), *arguments]
    try:
        return subprocess.Popen(
            command,
            env=_environment(temporary),
            cwd=root.anchor,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=passed,
        )
    except OSError as error:
        raise UnavailableError(f"No process can be started now: {error.strerror}.") from error


def _environment(temporary: Path | None = None) -> dict[str, str]:
    """Return the child's environment: what an interpreter needs, and no secrets."""
    environment = {name: value for name, value in os.environ.items() if name in _PASSED_ON}
    folders = [folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if Path(folder).is_absolute()]
    one_thread = dict.fromkeys(_THREADS, "1")
    own = {} if temporary is None else {"TMPDIR": str(temporary)}
    return {**environment, **one_thread, **own, "PYTHONPATH": os.pathsep.join(folders)}


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


def error_from(document: dict[str, Any]) -> MeshdeformError:
    """Return the error that a child has printed."""
    others = (*RequestError.__subclasses__(), DependencyError, NumericalError, UnavailableError)
    kinds: list[type[MeshdeformError]] = [AssetError, *AssetError.__subclasses__(), *others]
    kind = next((kind for kind in kinds if kind.code == document["code"]), AssetError)
    return kind(document["detail"], advice=document["advice"], **document["extra"])


def bound_resources(memory_bytes: int, seconds: float, file_bytes: int = 0) -> None:
    """Limit this process's address space, CPU time and the size of files that it writes; forbid core dumps."""
    try:
        import resource
    except ImportError:  # Windows has no rlimits; the limits on counts still apply there
        return
    bound_memory(memory_bytes)
    # The parent limits the wall-clock time; this ends a child whose parent has died.
    for bound, bound_value in ((resource.RLIMIT_CPU, math.ceil(seconds) + 1), (resource.RLIMIT_FSIZE, file_bytes)):
        resource.setrlimit(bound, (bound_value, bound_value))


def bound_memory(limit: int) -> None:
    """Limit this process's address space to `limit` bytes and disable core dumps."""
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or hard > limit:
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
