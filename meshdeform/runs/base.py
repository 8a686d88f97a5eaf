"""What a kind of job is: what it reads, how it is asked for, what it writes, and how a worker runs it. Torch-free."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from pydantic import BaseModel

from meshdeform.requests.document import BUILTIN_MODEL, JobKind, JobRequest

if TYPE_CHECKING:
    from meshdeform.assets import Limits
    from meshdeform.priors.base import Prior
    from meshdeform.settings import Settings

__all__ = [
    "ArtifactData",
    "ArtifactKind",
    "FilePart",
    "InputFile",
    "JobRun",
    "Kind",
    "RunInput",
    "StartRun",
    "StepReport",
]


@dataclass(frozen=True)
class FilePart:
    """A file that a kind of job reads.

    Attributes
    ----------
    name : str
        Of the part of a form, and of the member of a document that names a file which the service has.
    summary : str
        What it is, in one sentence.
    required : bool
        Whether a job cannot be without it. Whether one that is not required fits the request, the kind's check says.
    media_types : tuple of str
    """

    name: str
    summary: str
    required: bool
    media_types: tuple[str, ...]


@dataclass(frozen=True)
class ArtifactKind:
    """A result that a kind of job may write.

    Attributes
    ----------
    name : str
    media_type : str
    summary : str
        What it is, and which option asks for it if one does.
    """

    name: str
    media_type: str
    summary: str


@dataclass(frozen=True)
class InputFile:
    """A file as a run gets it.

    Attributes
    ----------
    data : bytes
    filename : str
    sha256 : str, optional
        Of the data, hexadecimal, where it is known.
    """

    data: bytes
    filename: str
    sha256: str | None = None


def _no_prior(model: str) -> Prior:
    raise RuntimeError(f"no prior is at hand, neither {model} nor another one")


@dataclass(frozen=True)
class RunInput:
    """What a run begins with.

    Attributes
    ----------
    request : JobRequest
    files : mapping of str to InputFile
        By the names of the kind's parts.
    resolved : mapping, optional
        Every parameter with its value, as the kind's check returned them when the job was accepted, in JSON. Where it
        is None, the run resolves them.
    checkpoint : bytes, optional
        A checkpoint of the same request, from which the run goes on.
    initial : bytes, optional
        A checkpoint of any request with the same asset; the run begins with its shape, at step 0.
    load_prior : callable
        Returns the prior of a model, which is kept between jobs.
    default_model : str
        The model where the request names none.
    limits : Limits, optional
        On the files.
    device : str
    """

    request: JobRequest
    files: Mapping[str, InputFile]
    resolved: Mapping[str, Any] | None = None
    checkpoint: bytes | None = None
    initial: bytes | None = None
    load_prior: Callable[[str], Prior] = field(default=_no_prior)
    default_model: str = BUILTIN_MODEL
    limits: Limits | None = None
    device: str = "cpu"


@dataclass(frozen=True)
class ArtifactData:
    """A result as bytes with its media type."""

    data: bytes
    content_type: str


@dataclass(frozen=True)
class StepReport:
    """Where a run stands after a step.

    Attributes
    ----------
    step : int
        Steps done, from 1.
    total_steps : int
        Steps in all.
    losses : dict of name to value
    """

    step: int
    total_steps: int
    losses: dict[str, float]


class JobRun(Protocol):
    """A run that a worker drives: it decides when to store, publish and stop."""

    @property
    def total_steps(self) -> int:
        """Steps in all."""

    @property
    def step(self) -> int:
        """Steps done."""

    def __iter__(self) -> Iterator[StepReport]:
        """Run the steps that are left."""

    def checkpoint(self) -> bytes:
        """Return everything that the rest of the run depends on; valid between two steps."""

    def snapshot(self) -> ArtifactData:
        """Return the asset as it stands now; valid between two steps."""

    def finish(self) -> dict[str, ArtifactData]:
        """Return the results, by artifact name."""


StartRun = Callable[[RunInput], JobRun]


@dataclass(frozen=True)
class Kind:
    """One kind of job.

    Attributes
    ----------
    name : JobKind
    summary : str
        What it does, in one sentence.
    reads : tuple of FilePart
    params : type of BaseModel
        The model of `params` in its requests. Workers read `checkpoint_every_steps` from it.
    check : callable
        Refuses a request that no worker of a deployment could run, and returns every parameter with the value that it
        would have: gets the request, the settings and the names of the files that come with it. Torch-free.
    steps : callable
        Returns how many steps a request takes, for limits and estimates: gets the request, the model where it names
        none, and what the check returned, in JSON, if that was kept. Torch-free.
    load : callable
        Imports what runs it, torch and all, and returns what starts a run.
    artifacts : tuple of ArtifactKind
    """

    name: JobKind
    summary: str
    reads: tuple[FilePart, ...]
    params: type[BaseModel]
    check: Callable[[JobRequest, Settings, frozenset[str]], BaseModel]
    steps: Callable[[JobRequest, str, Mapping[str, Any] | None], int]
    load: Callable[[], StartRun]
    artifacts: tuple[ArtifactKind, ...]
