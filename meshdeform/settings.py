"""Read the settings of a deployment from the environment (prefix ``MESHDEFORM_``). None is required.

Torch-free. `docs/configuration.md` is made of the descriptions (`python docs/generate.py`).
"""

from __future__ import annotations

import ipaddress
import json
import os
import re
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from meshdeform.requests.document import BUILTIN_MODEL, MAX_STEPS

_ORIGIN = re.compile(r"https?://(?:\[[0-9a-f:]+\]|[a-z0-9._-]+)(?::[0-9]{1,5})?")
"""As browsers write them: in lower case, without a path."""


def _split(value: Any) -> Any:
    """Parse a comma-separated list or a JSON list."""
    if not isinstance(value, str):
        return value
    if not value.lstrip().startswith("["):
        return [part for text in value.split(",") if (part := text.strip())]
    try:
        return json.loads(value)
    except ValueError:
        raise ValueError("write a comma-separated list, or a valid JSON list") from None


def _check_networks(blocks: list[str]) -> list[str]:
    for block in blocks:
        try:
            ipaddress.ip_network(block)
        except ValueError as error:
            raise ValueError(f"{error}; write networks such as 10.1.0.0/16,fd00::/8, separated by commas") from None
    return blocks


def _check_origins(origins: list[str]) -> list[str]:
    for origin in origins:
        if origin != "*" and not _ORIGIN.fullmatch(origin):
            raise ValueError(f"{origin!r} is not an origin; write origins such as https://app.example, or * for all")
    return origins


_Texts = Annotated[list[str], NoDecode, BeforeValidator(_split)]
_Networks = Annotated[_Texts, AfterValidator(_check_networks)]


class Settings(BaseSettings):
    """The settings of a deployment: locations, devices and limits."""

    model_config = SettingsConfigDict(env_prefix="MESHDEFORM_", env_ignore_empty=True, frozen=True, extra="ignore")

    data_dir: Path = Field(
        Path("meshdeform-data"), description="Folder of all that `serve` keeps: record, objects, the data of its Redis."
    )
    cache_dir: str = Field(
        "",
        description="Folder for what can be made again, at most 512 MB: readings of assets, and samples of nouns for "
        "them. Processes may share it, and it may be deleted at any time. Default: `meshdeform` in the user's cache "
        "folder.",
    )
    words: str = Field(
        "",
        description="Folder of the words of your own, for commands on this machine. Default: `meshdeform/words` in the "
        "user's data folder.",
    )
    database_url: str = Field(
        "",
        description="SQLAlchemy URL of the record; for several machines postgresql://user:password@host/database. "
        "Tables are made and migrated at the start. Default: SQLite in the data directory.",
    )
    redis_url: str = Field(
        "",
        description="Redis of the queue: redis://host:6379/0. `api` and `worker` need it. Default: `serve` starts its "
        "own.",
    )
    storage_url: str = Field(
        "",
        description="Object store, the same for API and workers: a folder, or an s3://, gs:// or az:// URL. Default: "
        "the folder `objects` in the data directory.",
    )
    storage_public_url: str = Field(
        "",
        description="URL at which clients reach an S3 store, for signed URLs, if it differs from AWS_ENDPOINT_URL.",
    )
    model: str = Field(
        BUILTIN_MODEL,
        min_length=1,
        description="The diffusion prior of jobs that name none: `builtin`, or a Stable Diffusion checkpoint in "
        "diffusers layout with safetensors weights, as a folder or an id in the worker's Hugging Face cache.",
    )
    allowed_models: _Texts = Field(
        default_factory=list,
        description="Models that jobs may name besides `builtin` and MESHDEFORM_MODEL, separated by commas. Clients "
        "name a folder by its own name; its path stays private.",
    )
    model_revision: str = Field("", description="Branch, tag or commit of a hub model. Default: main.")
    dtype: Literal["auto", "float32", "float16", "bfloat16"] = Field(
        "auto",
        description="Precision of the diffusion prior. `auto`: of a Stable Diffusion model, float32 on the CPU, "
        "bfloat16 on a GPU that supports it, else float16; of the builtin one, float32.",
    )
    device: str = Field("auto", description="`auto`, `cpu`, `cuda` or `cuda:N`.")
    threads: int = Field(
        0,
        ge=0,
        le=256,
        description="CPU threads of a worker and of `run`. 0: OMP_NUM_THREADS, else one per usable core.",
    )
    queue: str = Field(
        "meshdeform",
        min_length=1,
        description="Name of the RQ queue; deployments that share a Redis need different names.",
    )
    lease_s: float = Field(
        30.0, ge=1.0, description="Seconds: a worker that is silent for this long loses its job to another."
    )
    turn_s: float = Field(
        300.0,
        ge=1.0,
        description="Seconds: a job of another owner, or of a higher priority, that has waited for this long is given "
        "the worker of one that has run for as long. That one goes on later from a checkpoint.",
    )
    max_running_jobs: int = Field(
        0, ge=0, description="Jobs of one owner that run at the same time. 0: as many as there are workers."
    )
    max_run_s: float = Field(
        0.0,
        ge=0.0,
        description="Seconds for which a job may run, all its attempts together; a job may ask for less. 0: unlimited.",
    )
    max_attempts: int = Field(
        3, ge=1, description="Attempts at a job that are lost, or fail for reasons that may pass, before it fails."
    )
    retry_delay_s: float = Field(
        10.0,
        ge=0.0,
        le=600.0,
        description="Seconds until a job is tried again after a failure that may pass; four times as long each time.",
    )
    step_timeout_s: float = Field(
        600.0, ge=1.0, description="Seconds: a worker that completes no step for this long is killed and restarted."
    )
    checkpoints_kept: int = Field(
        10, ge=2, le=10_000, description="How many checkpoints a job keeps; older ones are deleted."
    )
    retention_s: float = Field(
        0.0, ge=0.0, description="Seconds after its end when a job is deleted, unless it sets its own. 0: never."
    )
    auth: Literal["auto", "on", "off"] = Field(
        "auto",
        description="Whether requests need an API key. `auto`: if the API listens on more than loopback, or the "
        "request comes through a proxy. `on`: always. `off`: never.",
    )
    allowed_hosts: _Texts = Field(
        default_factory=list,
        description="Host names, separated by commas, by which web pages may use a service on loopback without a key.",
    )
    cors_origins: Annotated[_Texts, AfterValidator(_check_origins)] = Field(
        default_factory=list,
        description="Origins, separated by commas, whose web pages may use the API from the browser (CORS): "
        "`https://app.example`. `*`: all, only with MESHDEFORM_AUTH=off. Signed URLs are open to pages of every "
        "origin.",
    )
    trusted_proxies: _Networks = Field(
        default_factory=list,
        description="Addresses or networks, separated by commas, of proxies whose `X-Forwarded-For` is trusted.",
    )
    web: Literal["on", "off"] = Field("on", description="Whether the API serves the web page at `/`.")
    requests_per_minute: int = Field(
        600,
        ge=0,
        description="Requests per minute of an API key that sets no limit itself; a tenth may come at once. 0: "
        "unlimited.",
    )
    max_active_jobs: int = Field(
        1000, ge=0, description="Unfinished jobs of an API key that sets no limit itself. 0: unlimited."
    )
    max_priority: int = Field(
        0,
        ge=-100,
        le=100,
        description="Highest job priority of an API key that sets no limit itself. Above 0, its jobs can delay "
        "those of all others. Without keys, any priority is allowed.",
    )
    max_stored_bytes: int = Field(
        100 * 2**30,
        ge=0,
        description="Bytes of files, checkpoints and artifacts that the jobs of one owner keep; no accepted job is "
        "stopped by it. 0: unlimited.",
    )
    max_uploads: int = Field(1000, ge=0, description="Uploads of one owner that no job has used. 0: unlimited.")
    max_uploads_bytes: int = Field(
        20 * 2**30, ge=0, description="Bytes of these uploads altogether, as announced. 0: unlimited."
    )
    max_words: int = Field(200, ge=0, le=200, description="Words of their own that one owner may keep. 0: none.")
    max_words_bytes: int = Field(2**30, ge=0, description="Bytes of these words altogether. 0: unlimited.")
    upload_ttl_s: float = Field(86_400.0, ge=60.0, description="How long an upload that no job uses is kept.")
    signed_url_ttl_s: float = Field(3600.0, ge=1.0, description="How long signed URLs and links to jobs are valid.")
    fetch_assets: bool = Field(
        True, description="Whether requests may name the URL of an asset on the public internet, which the API fetches."
    )
    fetch_networks: _Networks = Field(
        default_factory=list,
        description="Networks besides the public internet that assets may be fetched from: CIDR blocks, separated by "
        "commas. Plain http is allowed there.",
    )
    webhook_networks: _Networks = Field(
        default_factory=list,
        description="Networks besides the public internet that webhooks may reach: CIDR blocks, separated by commas. "
        "Plain http is allowed there.",
    )
    log_format: Literal["text", "json"] = Field("text", description="`text`: plain lines. `json`: one object per line.")
    max_steps: int = Field(MAX_STEPS, ge=1, le=MAX_STEPS, description="Largest number of steps of a job.")
    max_upload_bytes: int = Field(100 * 2**20, ge=1024, description="Largest request body, with all its files.")
    max_accessor_elements: int = Field(
        20_000_000, ge=1, description="Largest number of elements that one accessor may declare."
    )
    max_triangles: int = Field(
        1_000_000, ge=1, description="Largest number of triangles to deform, all instances counted."
    )
    max_json_bytes: int = Field(16 * 2**20, ge=1024, description="Largest JSON chunk of a GLB.")

    @cached_property
    def resolved_database_url(self) -> str:
        """The record's URL, with the default filled in."""
        return self.database_url or f"sqlite:///{(self.data_dir / 'meshdeform.sqlite').absolute()}"

    @property
    def cache_folder(self) -> Path:
        """The folder of what can be made again, with the default filled in."""
        users = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
        folder = Path(self.cache_dir or Path(users, "meshdeform"))
        try:
            return folder.expanduser()
        except RuntimeError:  # a user without a home
            return self.data_dir / "cache"

    @property
    def words_folder(self) -> Path:
        """The folder of the words of one's own, with the default filled in."""
        users = os.environ.get("XDG_DATA_HOME") or "~/.local/share"
        folder = Path(self.words or Path(users, "meshdeform", "words"))
        try:
            return folder.expanduser()
        except RuntimeError:  # a user without a home
            return self.data_dir / "words"

    @property
    def offered_models(self) -> list[str]:
        """Every model that a job may name, as configured, the default one first."""
        return list(dict.fromkeys([self.model, BUILTIN_MODEL, *self.allowed_models]))

    @cached_property
    def resolved_storage_url(self) -> str:
        """The object store's URL or folder, with the default filled in."""
        return self.storage_url or str((self.data_dir / "objects").absolute())
