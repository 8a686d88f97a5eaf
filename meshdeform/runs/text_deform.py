"""Run jobs of kind `text_deform`: deform an asset by a prompt or towards a target mesh."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.assets import Asset, load_asset
from meshdeform.deformation.checkpoint import dump_checkpoint, fingerprint, load_checkpoint, load_shape
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.orientation import Orientation
from meshdeform.deformation.stand_in import FACES, MAX_FACES
from meshdeform.deformation.surface_colours import welded_appearance
from meshdeform.deformation.surface_guard import EVERY_STEPS
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.cameras import Frame
from meshdeform.rendering.studio import preview_png
from meshdeform.requests.choices import GuidanceKind, RigMode
from meshdeform.requests.document import BUILTIN_MODEL
from meshdeform.requests.silhouettes import SILHOUETTE_PARTS
from meshdeform.runs.base import ArtifactData, RunInput, StepReport
from meshdeform.runs.control import Control, control_report, read_control
from meshdeform.runs.goals import Goal, GoalSource, read_goal
from meshdeform.runs.likeness import likeness, likeness_and_before
from meshdeform.runs.movement import HoldCounter
from meshdeform.runs.precision import precision_of
from meshdeform.runs.preparation import drawn_triangles, prepared, shape_id, welded_surface
from meshdeform.runs.prompts import Prompts, prompt_reports, read_prompts
from meshdeform.runs.recognition import front_of, known_source
from meshdeform.runs.report import LossHistory, PhaseClock, sha256_hex
from meshdeform.runs.selection import SelectableSurface
from meshdeform.runs.sent_weights import load_sent
from meshdeform.runs.shown import Shown, pose_in_frame
from meshdeform.runs.silhouette_fit import SilhouetteFit
from meshdeform.runs.strength import AssetPath, write_morph
from meshdeform.runs.surfaces import DeformedSurface, deformed_surface, vertex_jacobians
from meshdeform.runs.text_deform_kind import read_target, resolved_params
from meshdeform.runs.text_report import (
    RunFacts,
    appearance_report,
    build_report,
    provenance,
    read_result,
    sees_colours,
)

__all__ = ["TextDeformRun", "start"]

_GLB = "model/gltf-binary"
_ON_ORIGIN = 0.01
"""Height of the lowest point over the origin, as a share of the asset's, up to which it stands on it."""


def start(given: RunInput) -> TextDeformRun:
    """Read the files and prepare the run.

    Raises
    ------
    AssetError, RequestError, ModelError, NumericalError, CheckpointError
        The input cannot be run; the error says what to do.
    """
    clock = PhaseClock()
    request, asset, limits, device = given.request, given.files["asset"], given.limits, given.device
    params = resolved_params(request, given.default_model, given.resolved)
    prior = load_sent(params.model, given) if params.guidance is GuidanceKind.SDS else None
    asset_sha256 = asset.sha256 or sha256_hex(asset.data)
    with clock.phase("read"):
        loaded, division = prepared(load_asset(asset.data, asset.filename, limits), params, request.output, limits)
        welded = welded_surface(loaded, params.backdrop)
    frame = Frame.around(welded.mesh.verts)
    mesh = RestMesh.of(frame.place(welded.mesh))
    shape = shape_id(asset_sha256, loaded, params, request.output)
    with clock.phase("prepare"):
        surface = SelectableSurface(loaded, welded)
        control = read_control(params, surface, frame, mesh)
        prompts = read_prompts(request.prompt, params, surface, mesh, control) if params.prompts else None
        pictures = [given.files[name].data for name in SILHOUETTE_PARTS if name in given.files]
        silhouettes = SilhouetteFit.of(params, pictures) if params.silhouettes else None
        target = read_target(params, given)
        source = GoalSource(loaded, welded.mesh, mesh, prior, target, silhouettes, limits, device, prompts)
        goal = read_goal(request, params, source)
        run = fingerprint(
            params=params.model_dump(mode="json"),
            prompt=request.prompt,
            asset=shape,
            guidance=goal.guidance.identity,
            **({"stand_in": FACES} if mesh.faces.shape[0] > MAX_FACES else {}),
        )
        state = load_checkpoint(given.checkpoint, run) if given.checkpoint is not None else None
        start_shape = load_shape(given.initial, shape) if given.initial is not None else None
        look = welded_appearance(loaded.appearance(), welded) if sees_colours(params) else None
        known = known_source(welded.mesh, prior, params)
        front = front_of(known, prior, params, request.prompt)
        pose = pose_in_frame(loaded, welded, frame) if request.output.rig is RigMode.KEEP else None
        deformation = Deformation(
            mesh,
            goal.guidance,
            params,
            device=device,
            checkpoint=state,
            initial=start_shape,
            bodies=control.bodies,
            appearance=look,
            constraints=control.constraints,
            shares=goal.shares,
            front=front,
            pose=pose,
        )
    given_as, guided_by = (asset_sha256, len(asset.data), asset.filename), goal.guidance.identity
    where = device, precision_of(prior, state)
    facts = RunFacts(request, params, *given_as, guided_by, run, *where, shape, division, known)
    return TextDeformRun(loaded, welded, frame, deformation, facts, clock, control, goal, silhouettes, prompts)


class TextDeformRun:
    """A run in progress, created by `start`. Implements `meshdeform.runs.base.JobRun`."""

    def __init__(
        self,
        asset: Asset,
        welded: WeldedMesh,
        frame: Frame,
        deformation: Deformation,
        facts: RunFacts,
        clock: PhaseClock,
        control: Control,
        goal: Goal,
        silhouettes: SilhouetteFit | None = None,
        prompts: Prompts | None = None,
    ) -> None:
        self._prompts = prompts
        self._control = control
        self._goal = goal
        self._silhouettes = silhouettes
        self._asset = asset
        self._drawn = drawn_triangles(asset, facts.params.backdrop)
        self._welded = welded
        self._frame = frame
        self._deformation = deformation
        self._facts = facts
        self._clock = clock
        self._history, self._holds = LossHistory(), HoldCounter()
        self._rebuilt_normals = 0
        self._first_step = deformation.step

    @property
    def total_steps(self) -> int:
        """Total number of steps."""
        return self._facts.params.steps

    @property
    def step(self) -> int:
        """Number of steps done."""
        return self._deformation.step

    @property
    def orientation(self) -> Orientation:
        """The turn of the cameras, and how it was chosen."""
        return self._deformation.orientation

    def __iter__(self) -> Iterator[StepReport]:
        """Run the remaining steps."""
        start = time.perf_counter()
        for step in self._deformation:
            self._clock.seconds["optimize"] = self._clock.seconds.get("optimize", 0.0) + time.perf_counter() - start
            self._history.add(step.step, step.losses)
            checked = self._deformation.step % EVERY_STEPS == 0 or self._deformation.done
            self._holds.add(step.losses, checked=checked)
            yield StepReport(step.step, self.total_steps, step.losses)
            start = time.perf_counter()

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        state = replace(self._deformation.checkpoint(), precision=self._facts.precision or "")
        return dump_checkpoint(state, self._facts.fingerprint, self._facts.shape_id)

    def positions(self) -> NDArray[np.float64]:
        """Return the current world positions (N, 3), float64, of the asset's own vertices."""
        return self._welded.scatter(self._world_verts(), self._asset.surface.positions)

    def snapshot(self) -> ArtifactData:
        """Return the asset with its current shape, in the form of `result.glb`.

        Raises
        ------
        NumericalError
            The shape is not finite.
        """
        verts = self._world_verts()
        return ArtifactData(self._written(self._surface(verts), verts), _GLB)

    def finish(self) -> dict[str, ArtifactData]:
        """Return `result.glb`, `report.json` and `preview.png`, and `morph.glb` if requested.

        Raises
        ------
        NumericalError
            The result is not finite.
        """
        verts = self._world_verts()
        with self._clock.phase("write"):
            surface = self._surface(verts)
            result = self._written(surface, verts)
            # Read the file back, so that the report describes what is in the file.
            written = read_result(result).without(self._asset.excluded)
            artifacts = {"result.glb": ArtifactData(result, _GLB)}
            if self._facts.request.output.morph:
                artifacts["morph.glb"] = ArtifactData(self._morph(surface), _GLB)
            # With the normals that the file has now, so that the picture shows what a viewer of the file does.
            shown = Shown.of(self._asset, written, self._welded, verts)
            appearance = self._asset.appearance().of_triangles(self._drawn)
            artifacts["preview.png"] = ArtifactData(preview_png(appearance, *shown.poses), "image/png")
        report = build_report(
            self._facts,
            asset=self._asset,
            welded=self._welded,
            verts=verts,
            deformation=self._deformation,
            appearance=appearance_report(self._facts.params, self._deformation),
            result=result,
            written=written,
            shown=shown,
            history=self._history,
            holds=self._holds,
            rebuilt_normals=self._rebuilt_normals,
            first_step=self._first_step,
            clock=self._clock,
            look=appearance,
            drawn=self._drawn,
            likeness=self._likeness(shown),
            fit=self._fitted(verts),
            silhouettes=self._overlaps(verts),
            prompts=self._compared_prompts(shown),
            bodies=self._control.bodies,
            control=control_report(self._control, self._facts.params, self._welded, self._frame, self._asset, written),
        )
        artifacts["report.json"] = ArtifactData(report, "application/json")
        return artifacts

    def _written(self, surface: DeformedSurface, verts: Tensor) -> bytes:
        """Return the asset with a new shape as a GLB, with the options of the request."""
        follows = self._facts.request.output.rig is RigMode.FOLLOW
        jacobians = vertex_jacobians(self._welded, verts) if follows else None
        shape = surface.positions, surface.normals, surface.tangents
        return self._asset.replace(*shape, jacobians=jacobians, **self._file_options())

    def _morph(self, surface: DeformedSurface) -> bytes:
        path = AssetPath(self._asset, surface.positions, self._welded)
        return write_morph(self._asset, path, surface, self._facts.request.output.morph_path, **self._file_options())

    def _file_options(self) -> dict[str, Any]:
        output = self._facts.request.output
        return {
            "compact": output.compact,
            "provenance": provenance(self._facts, self.step) if output.provenance else None,
        }

    def _likeness(self, shown: Shown) -> dict[str, Any] | None:
        """Compare result and source with the prompt where the builtin prior guided; nothing else has a judge."""
        goal = self._goal
        if goal.guidance.identity["id"] != BUILTIN_MODEL or not goal.prompt:
            return None
        known = self._facts.recognised
        # A skin was recognised in its bind pose.
        nouns = {} if known is None or shown.posed else known.nouns
        with self._clock.phase("measure"):
            return likeness_and_before(shown.source, shown.result, goal.prompt, nouns)

    def _compared_prompts(self, shown: Shown) -> list[dict[str, Any]] | None:
        """Compare the result with each of several prompts, if there are any."""
        if self._prompts is None:
            return None
        judged = self._goal.guidance.identity["id"] == BUILTIN_MODEL
        with self._clock.phase("measure"):
            return prompt_reports(self._prompts, shown.source, shown.result, likeness if judged else None)

    def _fitted(self, verts: Tensor) -> dict[str, Any] | None:
        """Compare the result with the target, if there is one."""
        fit = self._goal.fit
        if fit is None:
            return None
        with self._clock.phase("measure"):
            return fit.measure(self._frame.place(self._welded.mesh), self._frame.enter(verts))

    def _overlaps(self, verts: Tensor) -> list[dict[str, Any]] | None:
        """Compare the result with the pictures, if there are any."""
        if self._silhouettes is None:
            return None
        with self._clock.phase("measure"):
            return self._silhouettes.measure(self._frame.place(self._welded.mesh), self._frame.enter(verts))

    def _surface(self, verts: Tensor) -> DeformedSurface:
        found = deformed_surface(self._asset.surface, self._welded, verts)
        self._rebuilt_normals = found.rebuilt_normals
        return found

    @cached_property
    def _keeps_ground(self) -> bool:
        """Whether the result stands where the source stood: by a prompt, if built or on the origin."""
        structure, heights = self._deformation.structure, self._welded.mesh.verts[:, 1]
        if structure is None or pose_in_frame(self._asset, self._welded, self._frame) is not None:
            return False
        stands = abs(float(heights.min())) <= _ON_ORIGIN * float(heights.max() - heights.min())
        return structure.level or stands

    def _world_verts(self) -> Tensor:
        constraints = self._control.constraints
        verts, kept = self._frame.leave(self._deformation.verts()), constraints.kept
        if kept is None and not constraints.handles and self._keeps_ground:
            verts[:, 1] += self._welded.mesh.verts[:, 1].min() - verts[:, 1].min()
        # The way into the frame and back rounds.
        return verts if kept is None else torch.where(torch.from_numpy(kept)[:, None], self._welded.mesh.verts, verts)
