"""Optimise an asset for a prompt, a target mesh or pictures: the guidances that need torch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from meshdeform.deformation.checkpoint import dump_checkpoint, fingerprint, load_checkpoint, load_shape
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.orientation import Orientation
from meshdeform.deformation.stand_in import FACES, MAX_FACES
from meshdeform.deformation.surface_colours import welded_appearance
from meshdeform.deformation.surface_guard import EVERY_STEPS
from meshdeform.geometry.mesh import RestMesh
from meshdeform.priors.base import Prior
from meshdeform.reading import Reading
from meshdeform.runs.base import RunInput, RunLog
from meshdeform.runs.facts import AssetFacts, Held, Outcome, Wanted
from meshdeform.runs.front import asks_source, front_of
from meshdeform.runs.goals import GoalSource, read_goal
from meshdeform.runs.plain_change import source_body
from meshdeform.runs.recognition import nature_of
from meshdeform.runs.shape_run import ShapeRun
from meshdeform.runs.starts import start_of
from meshdeform.runs.surfaces import shape_id
from meshdeform.runs.text_report import RunFacts, build_report, precision_of, sees_colours

__all__ = ["TextDeformRun", "start_optimised"]

_ON_ORIGIN = 0.01
"""Height of the lowest point over the origin, as a share of the asset's, up to which it stands on it."""


def start_optimised(facts: AssetFacts, prior: Prior | None, job_input: RunInput, log: RunLog) -> TextDeformRun:
    """Start an optimisation of an asset that was read.

    `prior`: for a prompt.
    """
    request, params, asset, welded, device = facts.request, facts.params, facts.asset, facts.welded, facts.device
    target, limits = job_input.files.get("target"), job_input.limits
    shape = shape_id(facts.file.sha256 or "", asset, params, request.output)
    reading = _reading(facts, job_input, log)
    begun = start_of(facts, shape, job_input, log)
    frame = begun.frame
    mesh = RestMesh.of(frame.place(welded.mesh))
    with log.phase("prepare"):
        wanted = Wanted.of(facts, frame, mesh, job_input.files)
        control = wanted.control
        source = GoalSource(
            asset, welded.mesh, begun.mesh, frame, prior, target, wanted.silhouettes, limits, device, wanted.prompts
        )
        goal = read_goal(request, params, source)
        run = fingerprint(
            params=params.model_dump(mode="json"),
            prompt=request.prompt,
            asset=shape,
            guidance=goal.guidance.identity,
            **({"stand_in": FACES} if mesh.faces.shape[0] > MAX_FACES else {}),
        )
        state = load_checkpoint(job_input.checkpoint, run) if job_input.checkpoint is not None else None
        deformation = Deformation(
            begun.mesh,
            goal.guidance,
            params,
            device=device,
            checkpoint=state,
            initial=load_shape(job_input.initial, shape) if job_input.initial is not None else None,
            bodies=control.bodies,
            appearance=welded_appearance(asset.appearance(), welded) if sees_colours(params) else None,
            constraints=control.constraints,
            shares=goal.shares,
            front=begun.turned(front_of(reading, params)),
            nature=nature_of(params, reading, request.prompt),
        )
    known = RunFacts(
        **vars(facts),
        **vars(wanted),
        start=begun,
        frame=frame,
        shape_id=shape,
        fingerprint=run,
        goal=goal,
        reading=reading,
        precision=precision_of(prior, state),
    )
    return TextDeformRun(known, deformation, log)


def _reading(facts: AssetFacts, job_input: RunInput, log: RunLog) -> Reading | None:
    """Return the reading of the source; None if nothing depends on it, or it cannot be read."""
    if not asks_source(facts.params):
        return None
    with log.phase("parts"):
        return source_body(facts, job_input.readings).reader.reading


class TextDeformRun(ShapeRun):
    """An optimisation in progress, created by `start_optimised`."""

    _facts: RunFacts

    def __init__(self, facts: RunFacts, deformation: Deformation, log: RunLog) -> None:
        super().__init__(facts, facts.params.steps, deformation.step, log)
        self._deformation = deformation
        self._held_shares: dict[int, float] = {}

    @property
    def orientation(self) -> Orientation:
        """The turn of the cameras, and how it was chosen."""
        return self._deformation.orientation

    def _steps(self) -> Iterator[dict[str, float]]:
        for step in self._deformation:
            checked = step.step % EVERY_STEPS == 0 or self._deformation.done
            if checked and "held_share" in step.losses:
                self._held_shares[step.step] = step.losses["held_share"]
            yield step.losses

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        state = replace(self._deformation.checkpoint(), precision=self._facts.precision or "")
        state = replace(state, tensors=state.tensors | self._facts.start.state)
        return dump_checkpoint(state, self._facts.fingerprint, self._facts.shape_id)

    def positions(self) -> NDArray[np.float64]:
        """Return the current world positions (N, 3), float64, of the asset's own vertices."""
        return self._facts.welded.scatter(self.verts(), self._facts.asset.surface.positions)

    def _report(self, outcome: Outcome) -> bytes:
        return build_report(self._facts, self._deformation, outcome, self.first_step, self.log)

    @property
    def _held(self) -> Held:
        return Held.of(self._held_shares, self.total_steps)

    @cached_property
    def _keeps_ground(self) -> bool:
        """Whether the result stands where the source stood: by a prompt, if built, on the origin or over a backdrop."""
        structure, heights = self._deformation.structure, self._facts.welded.mesh.verts[:, 1]
        if structure is None:
            return False
        stands = abs(float(heights.min())) <= _ON_ORIGIN * float(heights.max() - heights.min())
        backdrop = self._facts.asset.backdrop
        return structure.level or stands or (backdrop is not None and backdrop.left)

    def verts(self) -> NDArray[np.float64]:
        """Return the current welded vertices (V, 3) float64, in world space."""
        constraints = self._facts.control.constraints
        verts, kept = self._facts.frame.leave(self._deformation.verts().numpy()), constraints.kept
        if kept is None and not constraints.handles and self._keeps_ground:
            verts[:, 1] += self._facts.welded.mesh.verts[:, 1].min() - verts[:, 1].min()
        # The way into the frame and back rounds.
        return verts if kept is None else np.where(kept[:, None], self._facts.welded.mesh.verts, verts)
