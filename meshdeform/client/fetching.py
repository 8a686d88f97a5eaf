"""Provide the methods of the clients that fetch files: artifacts, what was sent, shapes of checkpoints."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from meshdeform.client import downloads
from meshdeform.client.connections import AsyncConnection, Connection
from meshdeform.client.paths import JobLike, artifact_path, job_path

__all__ = ["AsyncFileMethods", "FileMethods"]


class FileMethods(Connection):
    """The methods of `Client` that fetch files."""

    def read(self, job: JobLike, name: str, *, strength: float | None = None) -> bytes:
        """Return an artifact's bytes after verifying their SHA-256.

        Parameters
        ----------
        job : JobView or str
        name : str
        strength : float, optional
            Of `result.glb`: from 0, the source, over 1, the result, to 1.5, in steps of 0.01.
        """
        return self._driver.run(downloads.loaded(artifact_path(job, name, strength), self._policy))

    def download(self, job: JobLike, name: str, path: str | os.PathLike[str], *, strength: float | None = None) -> Path:
        """Save an artifact. The file appears complete, with its SHA-256 verified, or not at all.

        An interrupted download resumes where it stopped. An existing file is replaced. `strength` as for `read`.
        """
        url = artifact_path(job, name, strength)
        return self._driver.run(downloads.saved(url, Path(path), self._policy))

    def fetch(self, job: JobLike, folder: str | os.PathLike[str], names: Sequence[str] | None = None) -> list[Path]:
        """Save a job's artifacts to a folder, created if missing. Identical existing files are not downloaded again.

        Parameters
        ----------
        job : JobView or str
        folder : path
        names : sequence of str, optional
            The artifacts to save. Default: all.

        Raises
        ------
        JobNotFinishedError
            The job has not finished.
        NotFoundError
            The job has no artifact with such a name.
        MeshdeformError
            The job failed: its error; `ConflictError` if it was canceled or has expired.
        """
        return self._driver.run(downloads.fetched(job, Path(folder), names, self._policy))

    def download_asset(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the asset as it was sent, for a job in any state."""
        return self._driver.run(downloads.saved(job_path(job, "asset"), Path(path), self._policy))

    def download_file(self, job: JobLike, part: str, path: str | os.PathLike[str]) -> Path:
        """Save a file of a job of any kind as it was sent, by the name of its part."""
        return self._driver.run(downloads.saved(job_path(job, "files", part), Path(path), self._policy))

    def download_target(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the second mesh of `target` guidance as it was sent."""
        return self._driver.run(downloads.saved(job_path(job, "target"), Path(path), self._policy))

    def download_checkpoint(self, job: JobLike, step: int, path: str | os.PathLike[str]) -> Path:
        """Save the asset with its shape at a checkpoint."""
        return self._driver.run(
            downloads.saved(job_path(job, "checkpoints", step, "mesh.glb"), Path(path), self._policy)
        )


class AsyncFileMethods(AsyncConnection):
    """The methods of `AsyncClient` that fetch files."""

    async def read(self, job: JobLike, name: str, *, strength: float | None = None) -> bytes:
        """Return an artifact's bytes after verifying their SHA-256.

        Parameters
        ----------
        job : JobView or str
        name : str
        strength : float, optional
            Of `result.glb`: from 0, the source, over 1, the result, to 1.5, in steps of 0.01.
        """
        return await self._driver.run(downloads.loaded(artifact_path(job, name, strength), self._policy))

    async def download(
        self, job: JobLike, name: str, path: str | os.PathLike[str], *, strength: float | None = None
    ) -> Path:
        """Save an artifact. The file appears complete, with its SHA-256 verified, or not at all.

        An interrupted download resumes where it stopped. An existing file is replaced. `strength` as for `read`.
        """
        url = artifact_path(job, name, strength)
        return await self._driver.run(downloads.saved(url, Path(path), self._policy))

    async def fetch(
        self, job: JobLike, folder: str | os.PathLike[str], names: Sequence[str] | None = None
    ) -> list[Path]:
        """Save a job's artifacts to a folder, created if missing. Identical existing files are not downloaded again.

        Parameters
        ----------
        job : JobView or str
        folder : path
        names : sequence of str, optional
            The artifacts to save. Default: all.

        Raises
        ------
        JobNotFinishedError
            The job has not finished.
        NotFoundError
            The job has no artifact with such a name.
        MeshdeformError
            The job failed: its error; `ConflictError` if it was canceled or has expired.
        """
        return await self._driver.run(downloads.fetched(job, Path(folder), names, self._policy))

    async def download_asset(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the asset as it was sent, for a job in any state."""
        return await self._driver.run(downloads.saved(job_path(job, "asset"), Path(path), self._policy))

    async def download_file(self, job: JobLike, part: str, path: str | os.PathLike[str]) -> Path:
        """Save a file of a job of any kind as it was sent, by the name of its part."""
        return await self._driver.run(downloads.saved(job_path(job, "files", part), Path(path), self._policy))

    async def download_target(self, job: JobLike, path: str | os.PathLike[str]) -> Path:
        """Save the second mesh of `target` guidance as it was sent."""
        return await self._driver.run(downloads.saved(job_path(job, "target"), Path(path), self._policy))

    async def download_checkpoint(self, job: JobLike, step: int, path: str | os.PathLike[str]) -> Path:
        """Save the asset with its shape at a checkpoint."""
        return await self._driver.run(
            downloads.saved(job_path(job, "checkpoints", step, "mesh.glb"), Path(path), self._policy)
        )
