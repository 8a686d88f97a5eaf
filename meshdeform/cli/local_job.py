"""Run one job in this process, without record, queue and store. Imports torch."""

from __future__ import annotations

import json
import shlex
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshdeform.assets import Limits
from meshdeform.assets.bundle import read_with_files
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.interrupting import ctrl_c_between_steps, second_ctrl_c_ends
from meshdeform.cli.progress import ProgressView
from meshdeform.cli.request import find_taught
from meshdeform.errors import AlignmentError, UnavailableError
from meshdeform.priors import load_prior
from meshdeform.priors.base import Prior
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.requests.prompts import needs_prior
from meshdeform.runs import text_deform
from meshdeform.runs.base import FITTED_SOURCE, ArtifactData, InputFile, JobRun, RunInput
from meshdeform.runs.devices import resolve_device, use_threads
from meshdeform.runs.text_deform_kind import read_source, read_target
from meshdeform.settings import Settings
from meshdeform.support.collector import collection_paused
from meshdeform.support.files import write_files

__all__ = ["LocalJob", "Outputs", "try_folder", "writing"]


@dataclass(frozen=True)
class Outputs:
    """Paths of the outputs."""

    result: Path
    report: Path
    preview: Path
    morph: Path | None = None
    checkpoint: Path | None = None


class LocalJob:
    """One deformation in this process.

    Parameters
    ----------
    asset : Path
    request : JobRequest
    settings : Settings
        Model, device, precision, threads and limits.
    outputs : Outputs
    target : Path, optional
        The mesh of `params.guidance = target`.
    pictures : sequence of Path
        The pictures of `params.silhouettes`.
    resume : Path, optional
        A checkpoint of the same request to continue from.
    load : callable
        Loads the prior; a caching one saves time from job to job.

    Attributes
    ----------
    source : Path
        The mesh that is deformed: the asset, or once it is there what was fitted to an asset without triangles.
    """

    def __init__(
        self,
        asset: Path,
        request: JobRequest,
        settings: Settings,
        outputs: Outputs,
        *,
        target: Path | None = None,
        pictures: Sequence[Path] = (),
        resume: Path | None = None,
        load: Callable[..., Prior] = load_prior,
    ) -> None:
        self._asset, self._settings, self._outputs = asset, settings, outputs
        self._request = find_taught(request, settings)
        self._target = target
        self._pictures, self._resume, self._load = pictures, resume, load
        self._shown: list[Path] = []
        self.source = asset
        self._last_losses: dict[str, float] = {}
        self._last_step: tuple[int, int] | None = None
        self._saved_step: int | None = None

    def run(self, progress: ProgressView) -> dict[str, Any]:
        """Run the job to its end and write the outputs, all or none.

        Returns
        -------
        dict
            Paths of the outputs, number of steps, last losses and elapsed seconds.

        Raises
        ------
        MeshdeformError
            The job cannot run, or an output cannot be written.
        OutcomeError
            Ctrl-C came (`interrupted`); the checkpoint is written if requested.
        """
        try:
            with second_ctrl_c_ends():
                return self._run(progress)
        except KeyboardInterrupt:
            raise self._interruption() from None

    def _run(self, progress: ProgressView) -> dict[str, Any]:
        start = time.perf_counter()
        progress.phase("loading")
        self._check_folders()
        run = self._start(progress)
        first = run.step
        progress.phase("optimizing")
        self._optimize(run, progress)
        progress.phase("writing")
        artifacts = run.finish()
        self._write(artifacts)
        report = json.loads(artifacts["report.json"].data)
        return {
            "result": str(self._outputs.result),
            "report": str(self._outputs.report),
            "preview": str(self._outputs.preview),
            "morph": str(self._outputs.morph) if self._outputs.morph else None,
            "targets": [str(path) for path in self._shown],
            "source": str(self.source) if self.source != self._asset else None,
            "steps": run.step,
            "resumed_from": first or None,
            "losses": self._last_losses,
            "source_noun": report["source_noun"],
            "carrier": report["carrier"],
            "orientation": report["orientation"],
            "appearance": report["appearance"],
            "likeness": report.get("likeness"),
            "verdict": report.get("verdict"),
            "prompts": report.get("prompts"),
            "texture_stretch": report["texture_stretch"],
            "quality": report["quality"],
            "posed_quality": report.get("posed_quality"),
            "faces": report["mesh"]["welded_faces"],
            "silhouettes": report.get("silhouettes"),
            "fit": report.get("fit") and report["fit"] | {"quality": report["quality"]},
            "warnings": [*report["input"]["warnings"], *report["warnings"]],
            "elapsed_s": round(time.perf_counter() - start, 3),
        }

    def _check_folders(self) -> None:
        """Create the folders and test that they are writable, before the first step."""
        outputs = self._outputs
        with writing():
            for path in filter(None, (outputs.result, outputs.report, outputs.preview, outputs.morph)):
                try_folder(path)
        if outputs.checkpoint is not None:
            with writing("The checkpoint", "--checkpoint"):
                try_folder(outputs.checkpoint)

    def _start(self, progress: ProgressView) -> JobRun:
        limits = Limits.from_settings(self._settings)
        asset = read_with_files(self._asset, limits)
        use_threads(self._settings.threads)
        device = resolve_device(self._settings.device)
        params = resolve(self._request.params, default_model=self._settings.model)
        prior = None
        if needs_prior(params):
            revision = self._settings.model_revision if params.model == self._settings.model else ""
            prior = self._load(params.model, device=device, revision=revision, dtype=self._settings.dtype)
        files = {"asset": InputFile(asset, self._asset.name)}
        if self._target is not None:
            files["target"] = InputFile(read_with_files(self._target, limits), self._target.name)
        given = RunInput(
            request=self._request,
            files=files,
            checkpoint=self._resume.read_bytes() if self._resume else None,
            default_model=self._settings.model,
            limits=limits,
            device=device,
            on_phase=progress.phase,
            on_artifact=self._show,
        )
        with self._alignment_picture(), collection_paused():  # compiled kernels are loaded, and a library for them
            return self._begin(given, prior)

    @contextmanager
    def _alignment_picture(self) -> Iterator[None]:
        """Write the picture of a failed alignment beside the result, and name it in the error."""
        try:
            yield
        except AlignmentError as error:
            path = self._outputs.result.with_suffix(".alignment.png")
            if error.picture is not None:
                with writing("The picture of the alignment"):
                    write_files({path: error.picture})
                error.advice_text += f" {path} shows the asset in blue and the target in orange."
            raise

    def _show(self, name: str, artifact: ArtifactData) -> None:
        """Write what is shown before the run has ended beside the result."""
        path = self._outputs.result.with_suffix(f".{name}")
        with writing(name):
            write_files({path: artifact.data})
        if name == FITTED_SOURCE.name:
            self.source = path
        else:
            self._shown.append(path)

    def _begin(self, given: RunInput, prior: Prior | None) -> JobRun:
        target, sketch = read_target(given.request.params, given)
        return text_deform.start(
            asset=given.files["asset"].data,
            filename=given.files["asset"].filename,
            request=given.request,
            prior=prior,
            target=None if target is None else target.data,
            target_filename="" if target is None else target.filename,
            sketch=sketch,
            pictures=[path.read_bytes() for path in self._pictures],
            checkpoint=given.checkpoint,
            default_model=given.default_model,
            limits=given.limits,
            device=given.device,
            source=read_source(given),
        )

    def _optimize(self, run: JobRun, progress: ProgressView) -> None:
        path, every = self._outputs.checkpoint, self._request.params.checkpoint_every_steps
        with ctrl_c_between_steps() as interrupted:
            for report in run:
                self._last_losses = report.losses
                self._last_step = (report.step, report.total_steps)
                progress.step(report.step, report.total_steps, report.losses.get("total", float("nan")))
                stop = interrupted()
                if path is not None and (stop or report.step % every == 0):
                    with writing("The checkpoint", "--checkpoint"):
                        write_files({path: run.checkpoint()})
                    self._saved_step = report.step
                if stop:
                    raise KeyboardInterrupt

    def _interruption(self) -> OutcomeError:
        where = "before the first step"
        if self._last_step is not None:
            where = "at step {} of {}".format(*self._last_step)
        saved, path, extra = self._saved_step, self._outputs.checkpoint, {}
        if saved is not None:
            assert self._last_step is not None
            which = "The state" if saved == self._last_step[0] else f"The state of step {saved}"
            detail, advice = f"{which} is in {path}.", f"Continue with --resume {shlex.quote(str(path))}"
            extra = {"checkpoint": str(path), "step": saved}
        else:
            detail, advice = "Nothing was written.", "The same command starts over."
            if self._resume is not None:
                advice = f"The same command continues from {self._resume} again."
            elif path is None:
                advice += " With --checkpoint FILE it could be resumed."
        return OutcomeError(ExitCode.INTERRUPTED, "interrupted", f"Interrupted {where}. {detail}", advice, **extra)

    def _write(self, artifacts: dict[str, ArtifactData]) -> None:
        places = {
            "result.glb": self._outputs.result,
            "report.json": self._outputs.report,
            "preview.png": self._outputs.preview,
            "morph.glb": self._outputs.morph,
        }
        files = {path: artifacts[name].data for name, path in places.items() if path is not None}
        # A Ctrl-C that comes now is too late: the outputs are written all or none.
        with ctrl_c_between_steps(), writing():
            write_files(files)


@contextmanager
def writing(what: str = "The result", option: str = "-o") -> Iterator[None]:
    """Turn errors of the file system into an `UnavailableError` that names `what` and the option for another place."""
    try:
        yield
    except OSError as error:
        raise UnavailableError(
            f"{what} cannot be written: {error}.", advice=f"Choose another path with {option}."
        ) from error


def try_folder(path: Path) -> None:
    """Make the folder of a path, and test that files can be written there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path.parent):
        pass
