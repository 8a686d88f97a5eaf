"""Describe kinds of job: the files they read, their parameters, their artifacts, and their runs. Torch-free.

`RunLog` collects the contents of `report.json`: hashes, versions, durations of phases, and losses.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.metadata
import platform
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

import meshdeform
from meshdeform.assets.check import FileContent
from meshdeform.errors import DependencyError, install_command
from meshdeform.priors import hidden_folders
from meshdeform.requests.document import BUILTIN_MODEL, JobKind, JobRequest, read_unbounded
from meshdeform.runs.kept_readings import Readings, Unkept

if TYPE_CHECKING:
    from meshdeform.assets import AssetSummary, Limits
    from meshdeform.assets.inspect import PictureSummary
    from meshdeform.priors.base import Prior
    from meshdeform.settings import Settings

_PACKAGES = (
    "torch",
    "numpy",
    "scipy",
    "numba",
    "trimesh",
    "fast-simplification",
    "safetensors",
    "diffusers",
    "transformers",
)

TORCH_EXTRA = "sds"
"""The extra that brings torch."""

P = TypeVar("P", bound=BaseModel)

_MAX_SAMPLES = 200
RESULT = "result.glb"


def sha256_hex(data: bytes) -> str:
    """Return the SHA-256 of `data` in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of all packages that can affect a result."""
    return {"meshdeform": meshdeform.__version__, "python": platform.python_version(), **_installed()}


@functools.cache
def _installed() -> dict[str, str]:
    """Return the versions of the packages. Reading their metadata takes longer than a step."""
    versions = {}
    for name in _PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions


class RunLog:
    """The wall-clock seconds of an attempt by phase, and the losses of its first, last and up to 200 spaced steps."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._samples: list[dict[str, Any]] = []
        self._stride = 1
        self._last: dict[str, Any] | None = None

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the duration of the `with` block to phase `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def add(self, step: int, losses: Mapping[str, float]) -> None:
        """Add the losses of one step."""
        self._last = {"step": step, **losses}
        if (step - 1) % self._stride == 0:
            self._samples.append(self._last)
        if len(self._samples) > _MAX_SAMPLES:
            self._samples = self._samples[::2]
            self._stride *= 2

    def losses(self) -> list[dict[str, Any]]:
        """Return the samples in order, including the last step."""
        if self._last is None or (self._samples and self._samples[-1] is self._last):
            return list(self._samples)
        return [*self._samples, self._last]


@dataclass(frozen=True)
class FileField:
    """A file that a kind of job reads, as a field of a form."""

    name: str
    """Name of the field of a form, and of the member of the document's `files` that refers to a stored file: at most 64
    lower-case letters, digits and `_`."""
    summary: str  # one sentence about the file
    required: bool
    """Whether every job needs it; a branch keeps that of its job. If False, the kind's check decides whether it fits
    the request."""
    media_types: tuple[str, ...]
    content: FileContent = "mesh"  # what the file is checked as when it arrives


@dataclass(frozen=True)
class ArtifactKind:
    """A result that a kind of job may write."""

    name: str
    media_type: str
    summary: str  # one sentence about the result, and the option that requests it, if any
    afterwards: bool = False  # whether the service can make it from the job's files later on (`meshdeform.runs.derive`)
    strengths: bool = False
    """Whether it is the first file with a new shape, so that it can be had at other strengths (`runs/strength.py`)."""


FORMATS_OF_RESULT = tuple(
    ArtifactKind(
        name,
        media_type,
        f"{what}, made of `result.glb` [afterwards](http.md#post-v1jobsidartifactsname) only "
        "([Assets: other formats](assets.md#other-formats)).",
        afterwards=True,
    )
    for name, media_type, what in (
        ("result.usdz", "model/vnd.usdz+zip", "USDZ with materials, skins, morph targets and one animation"),
        ("result.obj.zip", "application/zip", "An OBJ with its materials and textures, as a ZIP"),
        ("result.3mf", "model/3mf", "The surface for printing, with colours"),
        ("result.stl", "model/stl", "The triangles for printing"),
    )
)
"""Artifacts that any kind of job with `result.glb` can have made of it."""


@dataclass(frozen=True)
class InputFile:
    """An input file of a run."""

    data: bytes
    filename: str
    sha256: str | None = None  # SHA-256 of the data, hexadecimal, if known

    @property
    def digest(self) -> str:
        """SHA-256 of the data, hexadecimal."""
        return self.sha256 or sha256_hex(self.data)


@dataclass(frozen=True)
class JobFile:
    """What is known of a file of a job that is checked: at first maybe only that there is one."""

    summary: AssetSummary | PictureSummary | None = None  # None: it was not decoded
    path: Path | None = None  # None: nobody looks into it
    filename: str = ""  # as the user named it
    readings: Readings = field(default_factory=Unkept)  # where readings of it are kept


def _no_prior(model: str) -> Prior:
    raise RuntimeError(f"no function to load the prior {model} was given")


@dataclass(frozen=True)
class ArtifactData:
    """The bytes of a result with their media type."""

    data: bytes
    content_type: str


@dataclass(frozen=True)
class RunInput:
    """The input of a run."""

    request: JobRequest
    files: Mapping[str, InputFile]  # files by the names of the kind's fields
    resolved: Mapping[str, Any] | None = None
    """The values of all parameters, as the kind's check returned them when the job was accepted, in JSON. If None, the
    run resolves them."""
    checkpoint: bytes | None = None  # a checkpoint of the same request, at which the run resumes
    initial: bytes | None = None
    """A checkpoint of any request with the same asset; the run starts with its shape at step 0."""
    load_prior: Callable[[str], Prior] = field(default=_no_prior)
    """Returns the prior of a model, which is kept between jobs."""
    default_model: str = BUILTIN_MODEL  # the model used if the request names none
    limits: Limits | None = None  # limits on the files
    device: str = "cpu"  # as the setting names it: `auto`, `cpu`, `cuda` or `cuda:N`; what needs one resolves it
    readings: Readings = field(default_factory=Unkept)  # where readings of the asset are kept
    draft: bool = False  # whether a fit is left unmended, of a large surface that of a simple one (`runs/drafts.py`)
    on_wait: Callable[[], None] = lambda: None
    """Called now and then while the start takes long; raises if the run must stop."""


def job_input(
    asset: bytes,
    filename: str,
    request: JobRequest,
    *,
    prior: Prior | None = None,
    target: bytes | None = None,
    target_filename: str = "target.glb",
    pictures: Sequence[bytes] = (),
    resolved: BaseModel | None = None,
    **more: Any,
) -> RunInput:
    """Return the input of a deformation whose files are at hand, as scripts and tests have them.

    `asset` and `target`: a GLB, OBJ, PLY, STL or ZIP; `prior`: used whatever model the request names; `pictures`: one
    PNG, JPEG or WebP for each of the guidance's `silhouettes`. `resolved`: the values of all parameters; default:
    resolved from the request. `**more`: further attributes of `RunInput`.
    """
    files = {"asset": InputFile(asset, filename)}
    if target is not None:
        files["target"] = InputFile(target, target_filename)
    files |= {f"silhouette_{n}": InputFile(picture, f"{n}.png") for n, picture in enumerate(pictures, 1)}
    if prior is not None:
        more["load_prior"] = lambda _model: prior
    values = None if resolved is None else resolved.model_dump(mode="json")
    return RunInput(request=request, files=files, resolved=values, **more)


@dataclass(frozen=True)
class StepReport:
    """The position of a run after a step."""

    step: int  # number of steps done, from 1
    total_steps: int  # total number of steps
    losses: dict[str, float]


class JobRun(ABC):
    """A run driven by its caller, which decides when to store, publish and stop.

    `step`: number of steps done; `first_step`: number of steps done by earlier attempts; `log`: with the phases before
    the first step.
    """

    def __init__(self, total_steps: int, first_step: int = 0, log: RunLog | None = None) -> None:
        self.total_steps, self.first_step, self.step = total_steps, first_step, first_step
        self.log = RunLog() if log is None else log

    def __iter__(self) -> Iterator[StepReport]:
        """Run the remaining steps."""
        steps = self._steps()
        while True:
            with self.log.phase("optimize"):
                losses = next(steps, None)
            if losses is None:
                return
            self.step += 1
            self.log.add(self.step, losses)
            yield StepReport(self.step, self.total_steps, losses)

    @abstractmethod
    def _steps(self) -> Iterator[dict[str, float]]:
        """Run the remaining steps; yield the losses of each."""

    @abstractmethod
    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""

    @abstractmethod
    def snapshot(self) -> ArtifactData:
        """Return the asset with its current shape; call only between two steps."""

    @abstractmethod
    def finish(self) -> dict[str, ArtifactData]:
        """Return the results, by artifact name."""

    def so_far(self) -> dict[str, ArtifactData]:
        """Return those results that the steps done are enough for, of a run that is ended before its last step.

        The report among them says so: `unfinished`, with `step` and `total_steps`. Empty if they would be worth nothing
        by themselves, which is the default. Call only between two steps.
        """
        return {}


StartRun = Callable[[RunInput], JobRun]


def start_of(module: str) -> Callable[[], StartRun]:
    """Return a function that imports a module, and with it torch if it needs that, and returns its function `start`."""

    def load() -> StartRun:
        start: StartRun = import_extra(module).start
        return start

    return load


def import_extra(module: str) -> ModuleType:
    """Import a module of ours that may need torch.

    Raises DependencyError: torch is not installed; the error names the extra that brings it.
    """
    try:
        imported = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise missing_torch() from error
    from meshdeform.runs.devices import share_with_torch

    share_with_torch()
    return imported


def missing_torch() -> DependencyError:
    """Return the error of what needs torch where it is not installed."""
    return DependencyError(
        "This job needs torch, which the extra `sds` brings and which is not installed.",
        advice=f"Install it where jobs run: {install_command(TORCH_EXTRA)}. Guidance `exemplar`, also to targets, and "
        "changes in plain words do without.",
        extra=TORCH_EXTRA,
    )


@dataclass(frozen=True)
class Kind:
    """One kind of job."""

    name: JobKind
    summary: str  # one sentence about the kind
    reads: tuple[FileField, ...]  # the first is required: it is the job's `asset` in the API, and names its downloads
    params: type[BaseModel]
    """The model of `params` in its requests. Workers read `checkpoint_every_steps` from it."""
    check: Callable[[JobRequest, Settings, Mapping[str, JobFile]], BaseModel]
    """Refuses a request that no worker of a deployment could run, and returns the values of all its parameters. Takes
    the request, the settings and its files, as far as they are known: it is asked again when more is. Torch-free."""
    steps: Callable[[JobRequest, str, Mapping[str, Any] | None], int]
    """Returns the number of steps of a request, for limits and estimates. Takes the request, the default model, and the
    stored result of `check` in JSON, if any. Torch-free."""
    load: Callable[[], StartRun]
    """Imports the code that runs the kind, and torch if it needs that, and returns the function that starts a run."""
    artifacts: tuple[ArtifactKind, ...]
    takes_output: bool = False  # whether requests may have options in `output`
    uses: Callable[[JobRequest], Collection[str]] | None = None
    """Returns the names of the fields that a request uses; a branch inherits only these. Default: all."""
    outlook: Callable[[JobRequest, Any, Settings, JobFile], dict[str, Any] | None] = lambda *_: None
    """Returns whether what a valid request asks for is `doubtful`, the `reasons` in sentences, and `suggestions`:
    prompts that would work better; None where nobody knows. Takes the request, the result of `check`, the settings and
    the first file. Torch-free."""
    needs_torch: Callable[[JobRequest, Any], bool] = lambda *_: True
    """Returns whether a request needs the extra `sds`. Takes the request and the result of `check`. Default: it does.
    Torch-free."""
    as_branch: Callable[[JobRequest, JobRequest], JobRequest] = lambda _job, branch: branch
    """Returns the request of a branch: with what it must have in common with its job, if it leaves that out; refuses a
    request that contradicts it. Takes the job's request and the branch's. Default: unchanged. Torch-free."""
    goal: Callable[[JobRequest, Mapping[str, str]], str] = lambda request, _: request.prompt
    """Returns the goal in a few words, for the names of downloads. Takes the request and the
    names of its files by field. Default: the prompt."""

    def check_extra(self, request: JobRequest, params: Any) -> None:
        """Refuse what could not run on this machine, as DependencyError.

        `params`: the result of `check`.
        """
        if self.needs_torch(request, params) and find_spec("torch") is None:
            raise missing_torch()

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the fields of its files, in order."""
        return tuple(each.name for each in self.reads)

    def content_of(self, name: str) -> FileContent:
        """Return the type as which the file of a field is checked."""
        return next(each.content for each in self.reads if each.name == name)

    def inherits(self, request: JobRequest) -> frozenset[str]:
        """Return the names of the fields that a branch with this request takes from its job unless it replaces them."""
        return frozenset(self.fields if self.uses is None else self.uses(request))


def params_of(request: JobRequest, model: type[P], kept: Mapping[str, Any] | None = None) -> P:
    """Return a request's parameters, or those stored when it was accepted, if this version can read them.

    `model`: that of the request's kind, by which the request was validated.
    """
    params: Any = request.params
    assert isinstance(params, model)
    try:
        return params if kept is None else read_unbounded(model, kept)
    except ValidationError:
        return params


def load_model(model: str, job_input: RunInput) -> Prior:
    """Load the prior of a job; errors name its model as a client does."""
    with hidden_folders([model]):
        return job_input.load_prior(model)
