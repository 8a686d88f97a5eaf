"""Settings of a deployment, read from the environment (prefix ``MESHDEFORM_``). None is needed to run.

Torch-free. `docs/configuration.md` has a heading for every field; a test says so.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from meshdeform.config import BUILTIN_MODEL

__all__ = ["Settings"]


class Settings(BaseSettings):
    """Where things lie and what is allowed."""

    model_config = SettingsConfigDict(env_prefix="MESHDEFORM_", env_ignore_empty=True, frozen=True, extra="ignore")

    data_dir: Path = Field(Path("meshdeform-data"), description="Folder for everything that `serve` keeps.")
    database_url: str = Field("", description="SQLAlchemy URL of the record. Default: SQLite in the data directory.")
    redis_url: str = Field("", description="Redis of the queue. Default: `serve` starts one of its own.")
    storage_url: str = Field(
        "",
        description="Object store: a folder, or s3://bucket/prefix. Default: a folder in the data directory.",
    )
    model: str = Field(BUILTIN_MODEL, min_length=1, description="The diffusion prior where a job names none.")
    allowed_models: list[str] = Field(
        default_factory=list,
        description="Models that jobs may name besides `builtin` and MESHDEFORM_MODEL, as a JSON list.",
    )
    model_revision: str = Field("", description="Revision (branch, tag or commit) of a hub model. Default: main.")
    device: str = Field("auto", description="`auto`, `cpu`, `cuda` or `cuda:N`.")
    threads: int = Field(0, ge=0, le=256, description="CPU threads of a worker. 0: as many as there are cores.")
    queue: str = Field("meshdeform", min_length=1, description="Name of the RQ queue.")
    lease_s: float = Field(30.0, ge=1.0, description="A worker that is silent for so long has lost its job.")
    max_attempts: int = Field(3, ge=1, description="Attempts at a job before it fails with `worker_lost`.")
    max_upload_bytes: int = Field(100 * 2**20, ge=1024, description="Largest request body.")
    max_accessor_elements: int = Field(
        20_000_000, ge=1, description="Largest number of elements that one accessor may declare."
    )
    max_triangles: int = Field(500_000, ge=1, description="Largest number of triangles to deform.")
    max_json_bytes: int = Field(16 * 2**20, ge=1024, description="Largest JSON chunk of a GLB.")

    @cached_property
    def resolved_database_url(self) -> str:
        """The record's URL, with the default filled in."""
        return self.database_url or f"sqlite:///{(self.data_dir / 'meshdeform.sqlite').absolute()}"

    @cached_property
    def resolved_storage_url(self) -> str:
        """The object store's URL or folder, with the default filled in."""
        return self.storage_url or str((self.data_dir / "objects").absolute())
