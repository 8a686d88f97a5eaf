"""Decode an asset in a child process with bounded memory and time, and tell whether it can be deformed.

The API asks `check_asset_subprocess`, which needs no numpy; the child is `python -m meshdeform.gltf.check FILE`. What a
broken file does to a decoder then costs a child, and nothing else.
"""

from __future__ import annotations

import argparse
import json
import mmap
import os
import signal
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetTooLargeError,
    AssetTruncatedError,
    DependencyError,
    MeshdeformError,
)
from meshdeform.gltf.inspect import AssetSummary, inspect_asset
from meshdeform.gltf.limits import Limits

if TYPE_CHECKING:
    from meshdeform.gltf.surface import Surface

__all__ = ["check_asset_subprocess", "main"]

# Address space of the child: what Python, numpy and trimesh map, and a multiple of the file for its arrays.
_BASE_ADDRESS_SPACE = 512 * 2**20
_ADDRESS_SPACE_PER_BYTE = 16


def check_asset_subprocess(
    path: str | os.PathLike[str], filename: str = "", limits: Limits | None = None, *, timeout_s: float = 60.0
) -> AssetSummary:
    """Check a stored file from its JSON to its last vertex.

    Parameters
    ----------
    path : path
        The file.
    filename : str
        The name that the user gave it; its own unless given.
    limits : Limits, optional
        What is allowed.
    timeout_s : float
        Seconds after which the file counts as too large.

    Returns
    -------
    AssetSummary

    Raises
    ------
    AssetError
        One of its subclasses says what is wrong and what to do. A decoder that crashed is one, too.
    DependencyError
        A decoder is not installed.
    """
    path = Path(path)
    limits = limits or Limits()
    filename = filename or path.name
    _inspect_file(path, filename, limits)
    command = [sys.executable, "-m", "meshdeform.gltf.check", str(path), "--filename", filename]
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    try:
        child = subprocess.run(
            [*command, "--limits", json.dumps(asdict(limits))],
            env={**os.environ, **one_thread},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise AssetTooLargeError(f"The file could not be checked within {timeout_s:g} s.") from error
    try:
        verdict = json.loads(child.stdout)
    except ValueError:
        raise _crash(child.returncode, path) from None
    if not verdict["ok"]:
        raise _error(verdict["error"])
    return _summary(verdict["summary"])


def _inspect_file(path: Path, filename: str, limits: Limits) -> None:
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size == 0:
            raise AssetTruncatedError("The file is empty.")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            inspect_asset(data, filename, limits)


def _crash(returncode: int, path: Path) -> AssetError:
    if returncode == -signal.SIGKILL or returncode == 0:
        return AssetTooLargeError("Checking the file took more memory than there is.")
    name = signal.Signals(-returncode).name if returncode < 0 else f"exit status {returncode}"
    return AssetError(f"The decoder crashed on this file of {path.stat().st_size} bytes ({name}).")


def _error(verdict: dict[str, Any]) -> MeshdeformError:
    kinds: list[type[MeshdeformError]] = [AssetError, *AssetError.__subclasses__(), DependencyError]
    kind = next((kind for kind in kinds if kind.code == verdict["code"]), AssetError)
    return kind(verdict["detail"], advice=verdict["advice"], **verdict["extra"])


def _summary(verdict: dict[str, Any]) -> AssetSummary:
    return AssetSummary(**{**verdict, "extensions": tuple(verdict["extensions"]), "skipped": tuple(verdict["skipped"])})


def main(arguments: list[str] | None = None) -> int:
    """Check one file and print a JSON verdict: `{"ok": true, "summary": ...}` or `{"ok": false, "error": ...}`."""
    parser = argparse.ArgumentParser(prog="python -m meshdeform.gltf.check", description=main.__doc__)
    parser.add_argument("path", type=Path)
    parser.add_argument("--filename", default="", help="the name that the user gave the file")
    parser.add_argument("--limits", type=json.loads, default={}, help="the limits, as JSON")
    options = parser.parse_args(arguments)
    try:
        verdict = {"ok": True, "summary": _decode(options.path, options.filename, Limits(**options.limits))}
    except (AssetError, DependencyError) as error:
        verdict = {"ok": False, "error": _as_json(error)}
    except MemoryError:
        verdict = {"ok": False, "error": _as_json(AssetTooLargeError("Decoding the file takes too much memory."))}
    print(json.dumps(verdict))
    return 0 if verdict["ok"] else 1


def _decode(path: Path, filename: str, limits: Limits) -> dict[str, Any]:
    _bound_memory(path.stat().st_size)
    from meshdeform.gltf.asset import load_asset

    asset = load_asset(path.read_bytes(), filename or path.name, limits)
    if not _has_area(asset.surface):
        raise AssetEmptyError("Every triangle of the asset has zero area.", advice="Send a mesh with a surface.")
    return asdict(asset.summary)


def _has_area(surface: Surface) -> bool:
    """Whether any triangle spans a plane; a mesh of lines and points only would be accepted and then fail."""
    import numpy as np

    a, b, c = (surface.positions[surface.triangles[:, corner]] for corner in range(3))
    cross = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.maximum(((b - a) ** 2).sum(1), ((c - a) ** 2).sum(1))
    return bool((cross > 1e-12 * longest).any())


def _bound_memory(size: int) -> None:
    try:
        import resource
    except ImportError:  # not on Windows; the limits on counts hold there all the same
        return
    wanted = _BASE_ADDRESS_SPACE + _ADDRESS_SPACE_PER_BYTE * size
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or hard > wanted:
        resource.setrlimit(resource.RLIMIT_AS, (wanted, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _as_json(error: MeshdeformError) -> dict[str, Any]:
    return {"code": error.code, "detail": error.detail, "advice": error.advice_text, "extra": error.extra}


if __name__ == "__main__":
    sys.exit(main())
