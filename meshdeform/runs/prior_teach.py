"""Run jobs of kind `prior_teach`: teach the builtin prior a noun, step by step."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from pydantic import ValidationError

from meshdeform.assets import Limits, build_glb
from meshdeform.priors.builtin.taught import check
from meshdeform.priors.builtin.teaching.teacher import TeachConfig
from meshdeform.priors.builtin.weights_file import WEIGHTS
from meshdeform.priors.public_names import hidden_folders
from meshdeform.requests.models import WEIGHTS_PART, is_sent, is_taught
from meshdeform.requests.teaching import TeachParams
from meshdeform.requests.unbounded import read_unbounded
from meshdeform.runs import teaching
from meshdeform.runs.base import ArtifactData, RunInput, StepReport
from meshdeform.runs.lesson_files import packed_meshes
from meshdeform.runs.prior_teach_kind import FAMILY_PART, MESHES_PART, noun_of_request, params_of
from meshdeform.runs.sent_weights import TAUGHT_WEIGHTS, WEIGHTS_ARTIFACT, weights_on_disk
from meshdeform.runs.teaching import TeachingRun, TeachRequest

__all__ = ["PriorTeachRun", "start"]


def start(given: RunInput) -> PriorTeachRun:
    """Unpack the meshes, read the weights to start from, and draw the pictures.

    Raises
    ------
    AssetError, RequestError, ModelError, CheckpointError
        The input cannot be run; the error says what to do.
    """
    params = _params(given)
    limits = given.limits or Limits()
    with ExitStack() as stack:
        base = WEIGHTS
        if is_sent(params.model):
            base = stack.enter_context(weights_on_disk(given.files[WEIGHTS_PART]))
        elif is_taught(params.model):
            base = Path(params.model).expanduser()
        file = given.files[MESHES_PART]
        with hidden_folders([str(base)]):
            new = noun_of_request(params, check(base))
            request = TeachRequest(
                noun=params.noun,
                synonyms=tuple(params.synonyms),
                replace=params.replace,
                licence=params.licence,
                front_deg=params.front_deg,
                base=base,
                config=TeachConfig(steps=params.steps, seed=params.seed),
            )
            meshes = packed_meshes(file.data, file.filename, new, limits)
            family = given.files[FAMILY_PART].data if FAMILY_PART in given.files else None
            lesson = teaching.start(
                request, meshes, family=family, state=given.checkpoint, device=given.device, limits=limits
            )
        return PriorTeachRun(lesson, stack.pop_all())


def _params(given: RunInput) -> TeachParams:
    """Return the parameters stored when the request was accepted, as far as this version can read them."""
    params = params_of(given.request)
    if given.resolved is None:
        return params
    try:
        return read_unbounded(TeachParams, given.resolved)
    except ValidationError:
        # It has the path of a model that the request names by its id.
        return params.model_copy(update={"model": given.resolved["model"]})


class PriorTeachRun:
    """A run in progress, created by `start`. Implements `meshdeform.runs.base.JobRun`."""

    def __init__(self, lesson: TeachingRun, files: ExitStack) -> None:
        self._lesson, self._files = lesson, files

    @property
    def total_steps(self) -> int:
        """Most steps that the lesson takes."""
        return self._lesson.total_steps

    @property
    def step(self) -> int:
        """Number of steps done."""
        return self._lesson.step

    def __iter__(self) -> Iterator[StepReport]:
        """Run the remaining steps; fewer if the held-out loss has stopped to fall."""
        for done in self._lesson:
            losses = {"total": done.loss}
            if done.held_new is not None and done.held_old is not None:
                losses |= {"held_out_new": done.held_new, "held_out_old": done.held_old}
            yield StepReport(done.step, done.total_steps, losses)

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        return self._lesson.state()

    def snapshot(self) -> ArtifactData:
        """Return the first mesh of the lesson as the training sees it."""
        mesh = self._lesson.first_shape
        return ArtifactData(build_glb(mesh.verts, mesh.faces), "model/gltf-binary")

    def finish(self) -> dict[str, ArtifactData]:
        """Return the results, by artifact name."""
        with self._files:  # the weights to start from are deleted afterwards
            made = self._lesson.finish()
        return {
            WEIGHTS_ARTIFACT: ArtifactData(made["result"], TAUGHT_WEIGHTS),
            "report.json": ArtifactData(made["report"], "application/json"),
            "preview.png": ArtifactData(made["preview"], "image/png"),
        }
