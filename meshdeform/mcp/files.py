"""Resolve the files that an agent names: local paths below allowed folders, uploads, and files of jobs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from meshdeform.errors import ForbiddenError, NotFoundError, ParameterError

__all__ = ["Folders"]

_UPLOAD = re.compile(r"upl_[0-9a-z]{26}")
_JOB_FILE = re.compile(r"(job_[0-9a-z]{26})/([\w.-]+)")


class Folders:
    """The folders of this machine in which an agent may read and write. Relative paths count from the first one.

    Without any, no path is accepted, as on a server that other machines reach.
    """

    def __init__(self, roots: Sequence[Path]) -> None:
        self.roots = [root.resolve() for root in roots]

    def source(self, name: str) -> Path | dict[str, str]:
        """Return an existing local file, or the reference that the service takes.

        The name is a path, the id of an upload, or `JOB/NAME`, an artifact of a job. `NotFoundError`: there is no such
        file; `ForbiddenError`: the path is outside the folders.
        """
        if _UPLOAD.fullmatch(name):
            return {"upload_id": name}
        if found := _JOB_FILE.fullmatch(name):
            return {"job_id": found[1], "artifact": found[2]}
        path = self._inside(name)
        if not path.is_file():
            raise NotFoundError(f"There is no file {name}.", advice=self._advice())
        return path

    def destination(self, name: str) -> Path:
        """Return where a new file may be written.

        `ForbiddenError`: it is outside the folders; `ParameterError`: its folder does not exist, or the name is taken.
        """
        path = self._inside(name)
        if not path.parent.is_dir():
            raise ParameterError(f"There is no folder {path.parent}.", advice="Name a file in an existing folder.")
        if path.exists():
            raise ParameterError(f"{name} exists already.", advice="Choose another name: nothing is overwritten.")
        return path

    def _inside(self, name: str) -> Path:
        if not self.roots:
            raise ForbiddenError(
                "This server reads and writes no files of its own machine.",
                advice="Send the file with upload_asset, or name a file of a job as JOB_ID/result.glb.",
            )
        # Resolved first, so that neither `..` nor a link leads out.
        path = (self.roots[0] / name).resolve()
        if not any(path.is_relative_to(root) for root in self.roots):
            raise ForbiddenError(f"{name} is outside the folders that this server may use.", advice=self._advice())
        return path

    def _advice(self) -> str:
        return f"Paths must be below {', '.join(map(str, self.roots))}."
