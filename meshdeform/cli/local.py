"""Run a job of any kind in this process, without record, queue and store: the one driver of all commands.

The request is checked and the outputs are protected before torch is imported; the outputs are written all or none; a
Ctrl-C takes effect between two steps, and the state is saved first where a checkpoint is wanted.
"""

from __future__ import annotations

import hashlib
import json
import math
import shlex
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import typer

from meshdeform.cli.environment import load_settings
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.output import ProgressView, show_progress
from meshdeform.errors import ParameterError, UnavailableError, VocabularyError
from meshdeform.support.memory import collection_paused

if TYPE_CHECKING:
    from meshdeform.assets import Asset, Limits
    from meshdeform.cli.options import Here
    from meshdeform.priors.base import Prior
    from meshdeform.requests.document import JobRequest
    from meshdeform.runs.base import JobRun
    from meshdeform.settings import Settings

_FORCE = "Choose another name with -o, or overwrite it with --force."
_ELSEWHERE = "Choose another path with -o."
_REPORT = "report.json"
_UNFINISHED = "unfinished"
"""What a report has of a run that was ended before its last step (`JobRun.so_far`)."""


@dataclass(frozen=True)
class FinishedRun:
    """A run that has written its outputs: its artifacts by name, and the steps with those of the checkpoint."""

    report: dict[str, Any]
    artifacts: dict[str, bytes]
    steps: int
    resumed_from: int | None
    losses: dict[str, float]
    elapsed_s: float


@dataclass
class LocalJob:
    """A job of any kind in this process.

    `outputs` says where artifacts go, by name, the main one first; others are not written. With `whole_folder`, outputs
    of an earlier run that this one does not make are removed. `load` loads the prior: a caching one saves time from job
    to job.
    """

    request: JobRequest
    files: Mapping[str, Path]
    outputs: Mapping[str, Path]
    settings: Settings
    checkpoint: Path | None = None
    resume: Path | None = None
    whole_folder: bool = False
    load: Callable[..., Prior] | None = None
    _words: bytes | None = field(default=None, init=False)
    _losses: dict[str, float] = field(default_factory=dict, init=False)
    _step: tuple[int, int] | None = field(default=None, init=False)
    _saved_step: int | None = field(default=None, init=False)
    _unfinished: list[Path] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        """Decide the kind of guidance of a request that names none, and pin the words that it names."""
        from meshdeform.requests.default_kind import with_kind

        request = with_kind(self.request, self.settings.model, self.files)
        self.request, self._words = pinned_here(request, self.settings)

    def check(self, *, force: bool = False, also: Sequence[Path] = ()) -> None:
        """Refuse, without torch, what could not run here, and unless with `force` to lose a file.

        `also` are further files that the command writes.
        """
        if not force:
            model = getattr(self.request.params, "model", None)
            read = [*self.files.values(), *filter(None, [self.resume]), *([Path(model)] if model else [])]
            check_outputs(self.outputs, read, also=also, kind=str(self.request.kind))
            if self.checkpoint is not None:
                _check_checkpoint(self.checkpoint)
        check_locally(self.request, self.settings, list(self.files))

    def run(self, progress: ProgressView) -> FinishedRun:
        """Run the job to its end and write the outputs, all or none.

        A Ctrl-C is an OutcomeError (`interrupted`); the checkpoint is written if requested, and what the run has of its
        results, where that is something, and none of an earlier run would go for it.
        """
        try:
            return self._run(progress)
        except KeyboardInterrupt:
            raise self._interruption() from None

    def start(self) -> JobRun:
        """Read the files and start the run."""
        from meshdeform.assets import Limits
        from meshdeform.assets.bundle import read_with_files
        from meshdeform.requests.parameters import WORDS_FIELD
        from meshdeform.runs import kind_of, start_run
        from meshdeform.runs.base import InputFile, RunInput
        from meshdeform.runs.kept_readings import FolderReadings

        limits = Limits.from_settings(self.settings)
        with collection_paused(keep=True):
            kind_of(self.request.kind).load()
            from meshdeform.runs.devices import check_name, resolve_device, use_threads

        files = {field: InputFile(read_with_files(path, limits), path.name) for field, path in self.files.items()}
        if self._words is not None:
            files[WORDS_FIELD] = InputFile(self._words, "words.word")
        use_threads(self.settings.threads)
        check_name(self.settings.device)
        job_input = RunInput(
            request=self.request,
            files=files,
            checkpoint=self.resume.read_bytes() if self.resume else None,
            load_prior=lambda model: self._prior(model, resolve_device(self.settings.device)),
            default_model=self.settings.model,
            limits=limits,
            device=self.settings.device,
            readings=FolderReadings(self.settings.cache_folder),
        )
        with collection_paused():  # compiled kernels are loaded, and a library for them
            return start_run(job_input)

    def _prior(self, model: str, device: str) -> Prior:
        from meshdeform.priors import load_prior

        revision = self.settings.model_revision if model == self.settings.model else ""
        return (self.load or load_prior)(model, device=device, revision=revision, dtype=self.settings.dtype)

    def _run(self, progress: ProgressView) -> FinishedRun:
        began = time.perf_counter()
        progress.phase("loading")
        with writing():
            for path in self.outputs.values():
                _try_folder(path)
        if self.checkpoint is not None:
            with _writing_checkpoint():
                _try_folder(self.checkpoint)
        run = self.start()
        first = run.step
        progress.phase("optimizing")
        self._optimize(run, progress)
        progress.phase("writing")
        artifacts = {name: artifact.data for name, artifact in run.finish().items() if name in self.outputs}
        self._write(artifacts)
        elapsed_s = round(time.perf_counter() - began, 3)
        report = json.loads(artifacts[_REPORT])
        return FinishedRun(report, artifacts, run.step, first or None, self._losses, elapsed_s)

    def _write(self, artifacts: Mapping[str, bytes]) -> None:
        """Write artifacts, all or none, in place of all that an earlier run wrote."""
        missing = [path for name, path in self.outputs.items() if name not in artifacts] if self.whole_folder else []
        write_all({self.outputs[name]: data for name, data in artifacts.items()}, remove=missing)

    def _write_so_far(self, run: JobRun, progress: ProgressView) -> None:
        """Write what a run that is interrupted has of its results, unless whole ones of an earlier run are there."""
        before = _read_report(self.outputs[_REPORT], str(self.request.kind))
        if before is not None and _UNFINISHED not in before:
            return
        progress.phase("writing")
        artifacts = {name: made.data for name, made in run.so_far().items() if name in self.outputs}
        if artifacts:
            self._write(artifacts)
            self._unfinished = [self.outputs[name] for name in artifacts]

    def _optimize(self, run: JobRun, progress: ProgressView) -> None:
        path, every = self.checkpoint, self.request.params.checkpoint_every_steps
        with ctrl_c_between_steps() as interrupted:
            for report in run:
                self._losses, self._step = report.losses, (report.step, report.total_steps)
                progress.step(report.step, report.total_steps, report.losses.get("total", math.nan))
                stop = interrupted()
                if path is not None and (stop or report.step % every == 0):
                    with _writing_checkpoint():
                        _write({path: run.checkpoint()})
                    self._saved_step = report.step
                if stop:
                    if report.step < report.total_steps:
                        self._write_so_far(run, progress)
                    raise KeyboardInterrupt

    def _interruption(self) -> OutcomeError:
        where = "before the first step" if self._step is None else "at step {} of {}".format(*self._step)
        path, extra = self.checkpoint, dict[str, Any]()
        if self._saved_step is not None and self._step is not None:
            which = "The state" if self._saved_step == self._step[0] else f"The state of step {self._saved_step}"
            detail, advice = f"{which} is in {path}.", f"Continue with --resume {shlex.quote(str(path))}"
            extra = {"checkpoint": str(path), "step": self._saved_step}
        else:
            detail, advice = "Nothing was written.", "The same command starts over."
            if self.resume is not None:
                advice = f"The same command continues from {self.resume} again."
            elif path is None:
                advice += " With --checkpoint FILE it could be resumed."
        if self._unfinished:
            path = self._unfinished[0].parent if self.whole_folder else self._unfinished[0]
            so_far = f"What was done so far is in {path}."
            detail = f"{so_far} {detail}" if extra else so_far
            extra["unfinished"] = [str(path) for path in self._unfinished]
        return OutcomeError(ExitCode.INTERRUPTED, "interrupted", f"Interrupted {where}. {detail}", advice, **extra)


def run_here(
    request: JobRequest,
    files: Mapping[str, Path],
    outputs: Mapping[str, Path],
    here: Here,
    *,
    quiet: bool,
    whole_folder: bool = False,
    also: Sequence[Path] = (),
) -> FinishedRun:
    """Check and run a job of any kind and show its progress; the arguments are those of `LocalJob` and its check."""
    settings = load_settings(device=here.device, threads=here.threads)
    job = LocalJob(request, files, outputs, settings, here.checkpoint, here.resume, whole_folder)
    job.check(force=here.force, also=also)
    with show_progress(quiet=quiet) as progress:
        return job.run(progress)


def read_asset(path: Path, limits: Limits) -> Asset:
    """Return the asset in a file, with the files beside it that it names."""
    from meshdeform.assets import load_asset
    from meshdeform.assets.bundle import read_with_files

    return load_asset(read_with_files(path, limits), path.name, limits)


def check_locally(request: JobRequest, settings: Settings, files: Sequence[str]) -> None:
    """Refuse a request that could not run on this machine, where any model may be named; without torch."""
    from meshdeform.requests.parameters import WORDS_FIELD
    from meshdeform.runs import check_request, kind_of
    from meshdeform.runs.word_pins import about_own
    from meshdeform.words import WordFolder, in_use, read_words

    request, words = pinned_here(request, settings)
    model = getattr(request.params, "model", None)
    if model:
        settings = settings.model_copy(update={"allowed_models": [*settings.allowed_models, model]})
    sent = [] if words is None else [WORDS_FIELD]
    try:
        with in_use([] if words is None else read_words(words)):
            params = check_request(request, settings, files=[*files, *sent])
            kind_of(request.kind).check_extra(request, params)
    except VocabularyError as error:
        raise about_own(error, request, WordFolder(settings.words_folder).words()) from None


def pinned_here(request: JobRequest, settings: Settings) -> tuple[JobRequest, bytes | None]:
    """Return the request with the user's words that it names, pinned by their hashes, and their content."""
    from meshdeform.runs.word_pins import pinned
    from meshdeform.words import WordFolder

    return pinned(request, WordFolder(settings.words_folder).words())


def check_outputs(outputs: Mapping[str, Path], inputs: Sequence[Path], *, also: Sequence[Path], kind: str) -> None:
    """Refuse outputs that would replace an input or a file of the user, as a ParameterError.

    Files of an earlier run may be replaced, so that loops and Makefiles work: the report beside the result has the
    result's SHA-256, or that of a folder the kind of job. A result that was edited since then is a file of the user.
    The outputs are by artifact, the result first; `also` are further ones whose names are made from that of the result.
    """
    paths = [*outputs.values(), *also]
    for path in paths:
        if path.exists() and any(source.exists() and path.samefile(source) for source in inputs):
            raise ParameterError(f"{path} is an input of this run.", advice=_FORCE)
    report, main = _read_report(outputs[_REPORT], kind), next(iter(outputs.values()))
    for path in paths:
        if path.exists() and not (report is not None and (path != main or _is_result(path, report))):
            raise ParameterError(f"{path} exists and was not written by an earlier run.", advice=_FORCE)


def check_free(paths: Sequence[Path], inputs: Sequence[Path | None] = (), *, force: bool) -> None:
    """Refuse outputs that would replace an input, or without `force` any file, as a ParameterError."""
    for path in paths:
        if path.exists() and any(source is not None and path.samefile(source) for source in inputs):
            raise ParameterError(f"{path} is an input of this command.", advice="Choose another name with -o.")
        if path.exists() and not force:
            raise ParameterError(f"{path} exists.", advice=_FORCE)


def check_glb(path: Path) -> None:
    """Refuse a name for the result that does not end in .glb, as a `typer.BadParameter`."""
    if path.suffix.lower() != ".glb":
        raise typer.BadParameter(f"the result is a GLB, but {path.name} does not end in .glb", param_hint="--output")


def _read_report(path: Path, kind: str) -> dict[str, Any] | None:
    try:
        report = json.loads(path.read_bytes())
        ours = report.get("kind") == kind or ("fingerprint" in report and isinstance(report["result"]["sha256"], str))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return report if ours else None


def _is_result(path: Path, report: Mapping[str, Any]) -> bool:
    digest = (report.get("result") or {}).get("sha256")
    return digest is None or (path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == digest)


def _check_checkpoint(path: Path) -> None:
    """Refuse to replace a file that is not a checkpoint."""
    if path.exists() and not _is_checkpoint(path):
        raise ParameterError(
            f"{path} exists and is not a checkpoint.",
            advice="Choose another name with --checkpoint, or overwrite it with --force.",
        )


def _is_checkpoint(path: Path) -> bool:
    # The layout of safetensors: 8 bytes of length, then JSON.
    try:
        with path.open("rb") as file:
            size = int.from_bytes(file.read(8), "little")
            header = json.loads(file.read(min(size, 2**24)))
        return str(header["__metadata__"]["format"]).startswith("meshdeform-checkpoint")
    except (OSError, ValueError, KeyError, TypeError):
        return False


def write_all(
    files: Mapping[Path, bytes],
    *,
    what: str | Path = "The result",
    advice: str = _ELSEWHERE,
    remove: Sequence[Path] = (),
) -> None:
    """Write all files or none, and then remove others; a Ctrl-C that comes now is too late."""
    with ctrl_c_between_steps(), writing(what, advice):
        for path in files:
            path.parent.mkdir(parents=True, exist_ok=True)
        _write(files)
        for path in remove:
            path.unlink(missing_ok=True)


def _write(files: Mapping[Path, bytes]) -> None:
    from meshdeform.support.files import write_files

    write_files(dict(files))


@contextmanager
def writing(what: str | Path = "The result", advice: str = _ELSEWHERE) -> Iterator[None]:
    """Turn errors of the file system into an `UnavailableError` that names `what`, a file by its path."""
    try:
        yield
    except OSError as error:
        reason = error.strerror if isinstance(what, Path) and error.strerror else error
        raise UnavailableError(f"{what} cannot be written: {reason}.", advice=advice) from error


def _writing_checkpoint() -> AbstractContextManager[None]:
    return writing("The checkpoint", "Choose another path with --checkpoint.")


def _try_folder(path: Path) -> None:
    """Make the folder of a path, and test that files can be written there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path.parent):
        pass


@contextmanager
def ctrl_c_between_steps() -> Iterator[Any]:
    """Defer the first Ctrl-C to the end of the step, when the state is consistent; the second acts at once."""
    interrupted = False

    def handle(_number: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        if interrupted:
            raise KeyboardInterrupt
        interrupted = True

    previous = signal.signal(signal.SIGINT, handle)
    try:
        yield lambda: interrupted
    finally:
        signal.signal(signal.SIGINT, previous)
