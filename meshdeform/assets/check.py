"""Inspect and decode an asset in a child process with bounded memory and time, to check that it can be deformed.

The API calls `check_asset_subprocess`, which needs no numpy and reads nothing of the file: a file that crashes a
decoder or occupies a parser affects only the child. The child gets neither the environment's secrets nor the current
folder. It is a fresh process for every file: one started in advance would save 0.2 s and cost 40 MB all the time.
"""

from __future__ import annotations

import mmap
import os
import signal
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from meshdeform.assets.archive import ZIP_MAGIC
from meshdeform.assets.inspect import AssetSummary, PictureSummary, inspect_asset
from meshdeform.assets.limits import Limits
from meshdeform.children.asking import ChildLostError, run_child
from meshdeform.children.protocol import Bounds, bound_memory
from meshdeform.errors import AssetEmptyError, AssetError, AssetTooLargeError, AssetTruncatedError
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.requests.kind_folders import kind_table
from meshdeform.support.recent import Recent

if TYPE_CHECKING:
    from meshdeform.assets.surface import Surface

MAX_SKIPPED = 100
"""How many skipped primitives a summary lists."""

MAX_LISTED = 200
"""How many nodes and materials a summary lists."""

FileContent = str
"""Content of a file: `mesh` (an asset), `silhouette` (a picture with one), `collection` (many assets in a ZIP), `words`
(of somebody's own), or what the kinds of job read besides (`contents.py` of their folders)."""

_REMEMBERED = 512


def check_asset_subprocess(
    path: str | os.PathLike[str], filename: str = "", limits: Limits | None = None, *, content: FileContent = "mesh"
) -> AssetSummary | PictureSummary:
    """Check a stored file completely, in a child process.

    Parameters
    ----------
    path : path
        The file.
    filename : str
        The name that the user gave the file. Default: the name in `path`.
    limits : Limits, optional
        Upper bounds on the asset; a file whose check takes longer than `max_check_s` counts as too large.
    content : str
        What the file should be.

    Returns
    -------
    AssetSummary, or PictureSummary of a silhouette.

    Raises
    ------
    AssetError
        The asset cannot be used, or a decoder crashed on it; the subclass and message say why and what to do.
    DependencyError
        A decoder is not installed.
    UnavailableError
        The machine cannot start a process at the moment.
    """
    path = Path(path)
    limits = limits or Limits()
    given = {
        "path": str(path.absolute()),
        "filename": filename or path.name,
        "limits": asdict(limits),
        "content": content,
    }
    try:
        summary = run_child("check", given, Bounds(limits.max_memory_bytes, limits.max_check_s))
    except TimeoutError as error:
        raise AssetTooLargeError(
            f"The file could not be checked within {limits.max_check_s:g} s.", advice="Simplify the asset."
        ) from error
    except ChildLostError as lost:
        raise _crash(lost, path) from lost
    return PictureSummary.read(summary) if content == "silhouette" else _summary(summary)


class CheckedAssets:
    """Check each file once per owner, since one asset is often posted with many prompts.

    Only files that passed are remembered, by owner, SHA-256 and format: if owners shared them, the time of a check
    would reveal whether another owner has sent the same file. The limits of a process never change.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._passed = Recent[AssetSummary | PictureSummary](_REMEMBERED)

    def check(
        self, path: Path, filename: str, sha256: str, owner_id: str, content: FileContent = "mesh"
    ) -> AssetSummary | PictureSummary:
        """Return the summary of a file of this owner that passed before, or check it completely.

        Raises AssetError, DependencyError: what is wrong with it.
        """
        # Some formats are recognised only by the file's extension.
        suffix = PurePath(filename).suffix.lower()
        known = (owner_id, sha256, content + suffix)
        summary = self._passed.get(known)
        if summary is None:
            summary = check_asset_subprocess(path, filename, self.limits, content=content)
            self._passed.put(known, summary)
        return summary


def _inspect_file(path: Path, filename: str, limits: Limits) -> None:
    """Refuse what can be refused before the file is read into memory and numpy is imported."""
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size == 0:
            raise AssetTruncatedError("The file is empty.")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            inspect_asset(data, filename, limits)


def _crash(lost: ChildLostError, path: Path) -> AssetError:
    status = lost.status or 0
    if status == -getattr(signal, "SIGXCPU", 0):
        return AssetTooLargeError("Checking the file took too much time.", advice="Simplify the asset.")
    if lost.out_of_memory:
        return AssetTooLargeError("Checking the file took more memory than is available.")
    name = signal.Signals(-status).name if status < 0 else f"exit status {status}"
    return AssetError(f"The decoder crashed on this file of {path.stat().st_size} bytes ({name}).")


def _summary(verdict: dict[str, Any]) -> AssetSummary:
    lists = ("extensions", "skipped", "nodes", "materials", "mesh_names", "joints", "warnings")
    bounds = tuple(map(tuple, verdict["bounds"]))
    return AssetSummary(**{**verdict, **{name: tuple(verdict[name]) for name in lists}, "bounds": bounds})


def check_given(given: dict[str, Any]) -> dict[str, Any]:
    """Return the summary of a file, in the child."""
    return _reader_of(given["content"])(Path(given["path"]), given["filename"], Limits(**given["limits"]))


def _reader_of(content: FileContent) -> Callable[[Path, str, Limits], dict[str, Any]]:
    """Return the function that checks a file."""
    own = {"mesh": decode_mesh, "silhouette": _read_picture, "collection": _read_collection, "words": _read_words}
    read: Callable[[Path, str, Limits], dict[str, Any]] = own.get(content) or kind_table("contents", "READERS")[content]
    return read


def decode_mesh(path: Path, filename: str, limits: Limits) -> dict[str, Any]:
    """Check a mesh completely and return its summary; for the child process, whose resources it bounds."""
    with path.open("rb") as file:
        packed = file.read(len(ZIP_MAGIC)) == ZIP_MAGIC  # it may unpack to as much as a file may have
    if not packed:
        bound_memory(limits.memory_bytes(path.stat().st_size))
    _inspect_file(path, filename, limits)
    from meshdeform.assets.asset import load_asset

    asset = load_asset(path.read_bytes(), filename, limits)
    if not has_area(asset.surface):
        raise AssetEmptyError("Every triangle of the asset has zero area.", advice="Send a mesh with a surface.")
    summary, skipped = asset.summary, asset.summary.skipped
    if len(skipped) > MAX_SKIPPED:
        skipped = (*skipped[:MAX_SKIPPED], {"reason": f"and {len(skipped) - MAX_SKIPPED} more"})
    lists = {name: getattr(summary, name)[:MAX_LISTED] for name in ("nodes", "materials", "mesh_names", "joints")}
    return asdict(replace(summary, skipped=skipped, **lists))


def _read_picture(path: Path, _filename: str, _limits: Limits) -> dict[str, Any]:
    from meshdeform.assets.silhouette import read_silhouette

    return asdict(read_silhouette(path.read_bytes()).summary)


def _read_collection(path: Path, _filename: str, limits: Limits) -> dict[str, Any]:
    from meshdeform.assets.collection import inspect_collection

    return asdict(inspect_collection(path.read_bytes(), limits))


def _read_words(path: Path, _filename: str, limits: Limits) -> dict[str, Any]:
    limits.check_bytes(path.stat().st_size)
    from meshdeform.words.file import read_words

    words = [word.checked() for word in read_words(path.read_bytes())]
    return asdict(AssetSummary("safetensors", 0, sum(sum(word.faces) for word in words), meshes=len(words)))


def has_area(surface: Surface) -> bool:
    """Return whether the solve can use any triangle; it drops those without area."""
    import numpy as np

    corners = surface.positions[surface.triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    areas = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return bool((areas > COLLAPSED_SHAPE * (edges**2).sum(2).max(1)).any())
