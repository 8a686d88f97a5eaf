"""Run jobs of kind `text_deform`: deform an asset by a prompt or towards a target mesh.

Run a prompt that is a change in plain words: no model, no steps.

Joints, morph targets and the nodes that hang on the surface follow it, unless `output.rig` is `keep`.
"""

from __future__ import annotations

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
from meshdeform.geometry.mesh import RestMesh
from meshdeform.plain.body import Body, body_of
from meshdeform.plain.change import Done, affine_of, apply_changes, meant
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.words import Sentence
from meshdeform.reading import Reading
from meshdeform.rendering.cameras import Frame
from meshdeform.rendering.studio import preview_png
from meshdeform.requests.choices import GuidanceKind, RigMode
from meshdeform.requests.parameters import SILHOUETTE_PARTS
from meshdeform.runs.base import ArtifactData, JobRun, RunInput, RunLog, load_sent
from meshdeform.runs.changes import asked_changes, check_change, is_change, part_names, part_not_found
from meshdeform.runs.control import WeldedSurface, read_control
from meshdeform.runs.goals import GoalSource, SilhouetteFit, read_goal
from meshdeform.runs.kept_readings import Readings
from meshdeform.runs.last_assets import asset_key, front_again, keep_front, recognised_again
from meshdeform.runs.prompts import read_prompts
from meshdeform.runs.reading import Source, corrected, made
from meshdeform.runs.recognition import Recognition, front_of, known_source, recognise
from meshdeform.runs.strength import AssetPath, write_morph
from meshdeform.runs.surfaces import (
    DeformedSurface,
    Shown,
    affine_surface,
    deformed_surface,
    drawn_triangles,
    prepared,
    read_result,
    shape_id,
    vertex_jacobians,
    welded_surface,
)
from meshdeform.runs.text_deform_kind import resolved_params
from meshdeform.runs.text_report import (
    AssetFacts,
    Held,
    Outcome,
    RunFacts,
    build_report,
    change_report,
    precision_of,
    provenance,
    sees_colours,
)
from meshdeform.support.threads import side_by_side

_GLB = "model/gltf-binary"
_ON_ORIGIN = 0.01
"""Height of the lowest point over the origin, as a share of the asset's, up to which it stands on it."""


def start(job_input: RunInput) -> JobRun:
    """Read the files and start the run; a prompt that is a change in plain words is carried out at once."""
    log = RunLog()
    request, file, limits, device = job_input.request, job_input.files["asset"], job_input.limits, job_input.device
    params = resolved_params(request, job_input.default_model, job_input.resolved)
    sentence = asked_changes(request.prompt, params)
    # A change needs no prior; whether a description is one, only the asset tells.
    prior = load_sent(params.model, job_input) if params.guidance is GuidanceKind.SDS and sentence is None else None
    target = job_input.files.get("target")
    file = replace(file, sha256=file.digest)
    with log.phase("read"):
        asset, division = prepared(load_asset(file.data, file.filename, limits), params, request.output, limits)
        welded = welded_surface(asset, params.backdrop)
    facts = AssetFacts(request, params, file, asset, division, drawn_triangles(asset, params.backdrop), welded, device)
    recognised = None
    if sentence is not None:
        change, recognised = _change(facts, sentence, job_input, log)
        if change is not None:
            return change
        prior = load_sent(params.model, job_input)
    frame = Frame.around(welded.mesh.verts)
    mesh = RestMesh.of(frame.place(welded.mesh))
    shape = shape_id(file.sha256 or "", asset, params, request.output)
    with log.phase("prepare"):
        surface = WeldedSurface(asset, welded)
        control = read_control(params, surface, frame, mesh)
        prompts = read_prompts(request.prompt, params, surface, mesh, control) if params.prompts else None
        pictures = [
            job_input.files[part].data
            for part in SILHOUETTE_PARTS[: len(params.silhouettes)]
            if part in job_input.files
        ]
        silhouettes = SilhouetteFit.of(params, pictures) if params.silhouettes else None
        source = GoalSource(asset, welded.mesh, mesh, prior, target, silhouettes, limits, device, prompts)
        goal = read_goal(request, params, source)
        run = fingerprint(
            params=params.model_dump(mode="json"),
            prompt=request.prompt,
            asset=shape,
            guidance=goal.guidance.identity,
            **({"stand_in": FACES} if mesh.faces.shape[0] > MAX_FACES else {}),
        )
        state = load_checkpoint(job_input.checkpoint, run) if job_input.checkpoint is not None else None
        key, named = asset_key(shape, params, prior), recognised
        recognised = recognised_again(key, lambda: known_source(welded.mesh, prior, params, named, _joints(asset)))
        front, front_key = front_again(key, front_of(recognised, prior, params, request.prompt), recognised)
        deformation = Deformation(
            mesh,
            goal.guidance,
            params,
            device=device,
            checkpoint=state,
            initial=load_shape(job_input.initial, shape) if job_input.initial is not None else None,
            bodies=control.bodies,
            appearance=welded_appearance(asset.appearance(), welded) if sees_colours(params) else None,
            constraints=control.constraints,
            shares=goal.shares,
            front=front,
        )
        if front is not None:
            keep_front(front_key, deformation.orientation)
    known = RunFacts(
        **vars(facts),
        frame=frame,
        shape_id=shape,
        fingerprint=run,
        control=control,
        goal=goal,
        prompts=prompts,
        silhouettes=silhouettes,
        recognised=recognised,
        precision=precision_of(prior, state),
    )
    return TextDeformRun(known, deformation, log)


def _joints(asset: Asset) -> list[str]:
    return [joint["name"] for joint in asset.parts().joints]


def _change(
    facts: AssetFacts, sentence: Sentence, job_input: RunInput, log: RunLog
) -> tuple[JobRun | None, Recognition | None]:
    """Return the run of a change in plain words, or None and what the source was recognised as, if it was asked."""
    if is_change(sentence):
        return start_change(facts, _body(facts, job_input.readings), sentence, None, log), None
    if job_input.initial is not None or job_input.checkpoint is not None:
        return None, None
    recognised = recognise(facts.welded.mesh, facts.params.source_noun, _joints(facts.asset))
    body, called = _body(facts, job_input.readings), replace(recognised, called=sentence.noun or "")
    if recognised.probability < 1:  # neither given nor told by a skeleton
        with log.phase("parts"):
            called = called.with_reading(body.reader.reading)
    # A prompt goes on with what the judge says: what was read of another prompt must not change its result.
    if not called.sure or called.noun != sentence.noun:
        return None, recognised
    return start_change(facts, body, sentence, called, log), recognised


def _body(facts: AssetFacts, readings: Readings) -> Body:
    """Return the source of a change, which can be read."""
    welded = facts.welded
    source = Source(facts.file.digest, facts.file.filename, facts.subdivision is not None, readings)
    body = body_of(facts.asset, welded.vertex_map, welded.first_rows(), welded.mesh.faces.numpy())
    return corrected(body, facts.asset, facts.params, source)


class TextDeformRun(JobRun):
    """A run in progress, created by `start`."""

    def __init__(self, facts: RunFacts, deformation: Deformation, log: RunLog) -> None:
        super().__init__(facts.params.steps, deformation.step, log)
        self._facts, self._deformation = facts, deformation
        self._held: dict[int, float] = {}

    @property
    def orientation(self) -> Orientation:
        """The turn of the cameras, and how it was chosen."""
        return self._deformation.orientation

    def _steps(self) -> Iterator[dict[str, float]]:
        for step in self._deformation:
            checked = step.step % EVERY_STEPS == 0 or self._deformation.done
            if checked and "held_share" in step.losses:
                self._held[step.step] = step.losses["held_share"]
            yield step.losses

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        state = replace(self._deformation.checkpoint(), precision=self._facts.precision or "")
        return dump_checkpoint(state, self._facts.fingerprint, self._facts.shape_id)

    def positions(self) -> NDArray[np.float64]:
        """Return the current world positions (N, 3), float64, of the asset's own vertices."""
        return self._facts.welded.scatter(self._world_verts(), self._facts.asset.surface.positions)

    def snapshot(self) -> ArtifactData:
        """Return the asset with its current shape, in the form of `result.glb`."""
        verts = self._world_verts()
        return ArtifactData(self._written(self._surface(verts), verts), _GLB)

    def finish(self) -> dict[str, ArtifactData]:
        """Return `result.glb`, `report.json` and `preview.png`, and `morph.glb` if requested."""
        facts, verts = self._facts, self._world_verts()
        with self.log.phase("write"):
            surface = self._surface(verts)
            result = self._written(surface, verts)
            # Read the file back, so that the report describes what is in the file.
            written = read_result(result).without(facts.asset.excluded)
            artifacts = {"result.glb": ArtifactData(result, _GLB)}
            if facts.request.output.morph:
                artifacts["morph.glb"] = ArtifactData(self._morph(surface), _GLB)
            # With the normals that the file has now, so that the picture shows what a viewer of the file does.
            shown = Shown.of(facts.asset, written, facts.welded, verts)
            look = facts.asset.appearance().of_triangles(facts.drawn)
        outcome = Outcome(verts, result, written, shown, surface.rebuilt_normals, Held.of(self._held, self.total_steps))
        report, picture = side_by_side(
            lambda: build_report(facts, self._deformation, outcome, self.first_step, self.log),
            lambda: preview_png(look, *shown.poses),
        )
        artifacts["preview.png"] = ArtifactData(picture, "image/png")
        artifacts["report.json"] = ArtifactData(report, "application/json")
        return artifacts

    def _surface(self, verts: Tensor) -> DeformedSurface:
        return deformed_surface(self._facts.asset.surface, self._facts.welded, verts)

    def _written(self, surface: DeformedSurface, verts: Tensor) -> bytes:
        """Return the asset with a new shape as a GLB, with the options of the request."""
        follows = self._facts.request.output.rig is RigMode.FOLLOW
        jacobians = vertex_jacobians(self._facts.welded, verts) if follows else None
        shape = surface.positions, surface.normals, surface.tangents
        return self._facts.asset.replace(*shape, jacobians=jacobians, **self._file_options())

    def _morph(self, surface: DeformedSurface) -> bytes:
        from meshdeform.runs.strength import AssetPath, write_morph

        asset, path = self._facts.asset, self._facts.request.output.morph_path
        way = AssetPath(asset, surface.positions, self._facts.welded)
        return write_morph(asset, way, surface, path, **self._file_options())

    def _file_options(self) -> dict[str, Any]:
        output = self._facts.request.output
        return {
            "compact": output.compact,
            "provenance": provenance(self._facts, self.step) if output.provenance else None,
        }

    @cached_property
    def _keeps_ground(self) -> bool:
        """Whether the result stands where the source stood: by a prompt, if built, on the origin or over a backdrop."""
        structure, heights = self._deformation.structure, self._facts.welded.mesh.verts[:, 1]
        if structure is None:
            return False
        stands = abs(float(heights.min())) <= _ON_ORIGIN * float(heights.max() - heights.min())
        backdrop = self._facts.asset.backdrop
        return structure.level or stands or (backdrop is not None and backdrop.left)

    def _world_verts(self) -> Tensor:
        constraints = self._facts.control.constraints
        verts, kept = self._facts.frame.leave(self._deformation.verts()), constraints.kept
        if kept is None and not constraints.handles and self._keeps_ground:
            verts[:, 1] += self._facts.welded.mesh.verts[:, 1].min() - verts[:, 1].min()
        # The way into the frame and back rounds.
        return (
            verts
            if kept is None
            else torch.where(torch.from_numpy(kept)[:, None], self._facts.welded.mesh.verts, verts)
        )


def start_change(
    facts: AssetFacts, body: Body, sentence: Sentence, recognised: Recognition | None, log: RunLog
) -> PlainChangeRun:
    """Make the changes of a sentence, which may describe what the source was recognised as.

    `body`: the source. `PartNotFoundError`: a part is missing. No guidance makes up for it: it knows no parts, and
    spoils the others.
    """
    check_change(facts.params)
    with log.phase("change"):
        try:
            changed, done = apply_changes(body, meant(body, sentence))
        except PartMissingError as missing:
            taken_for = _taken_for(made(body), recognised) if facts.params.source_noun is None else ""
            raise part_not_found(str(missing), part_names(body, facts.params), taken_for) from missing
        verts = facts.welded.mesh.verts + torch.from_numpy(changed.points - body.points)
    return PlainChangeRun(facts, verts, done, recognised, made(body), sentence.notes, log)


def _taken_for(reading: Reading | None, recognised: Recognition | None) -> str:
    if reading is not None:
        return reading.noun
    return recognised.noun if recognised is not None else ""


class PlainChangeRun(JobRun):
    """A change that was made, created by `start_change`; it has no steps."""

    def __init__(
        self,
        facts: AssetFacts,
        verts: Tensor,
        done: list[Done],
        recognised: Recognition | None,
        reading: Reading | None,
        notes: tuple[str, ...],
        log: RunLog,
    ) -> None:
        super().__init__(0, 0, log)
        self._facts, self._done, self._recognised, self._notes = facts, done, recognised, notes
        self._reading = reading
        self._affine = affine_of(done)
        # Of an affine change, the file's own vertices are moved, not those that were welded.
        self._verts = verts if self._affine is None else facts.welded.gather(self._surface.positions).verts

    def _steps(self) -> Iterator[dict[str, float]]:
        return iter(())

    def checkpoint(self) -> bytes:
        """Return nothing: a run without steps has no state."""
        return b""

    def snapshot(self) -> ArtifactData:
        """Return the changed asset, in the form of `result.glb`."""
        return ArtifactData(self._written, _GLB)

    def finish(self) -> dict[str, ArtifactData]:
        """Return `result.glb`, `report.json` and `preview.png`, and `morph.glb` if requested."""
        facts = self._facts
        with self.log.phase("write"):
            result = self._written
            written = read_result(result).without(facts.asset.excluded)
            artifacts = {"result.glb": ArtifactData(result, _GLB)}
            if facts.request.output.morph:
                way = AssetPath(facts.asset, self._surface.positions, facts.welded)
                path = facts.request.output.morph_path
                artifacts["morph.glb"] = ArtifactData(
                    write_morph(facts.asset, way, self._surface, path, **self._file_options), _GLB
                )
            shown = Shown.of(facts.asset, written, facts.welded, self._verts)
            look = facts.asset.appearance().of_triangles(facts.drawn)
        outcome = Outcome(self._verts, result, written, shown, self._surface.rebuilt_normals, Held())
        report, picture = side_by_side(
            lambda: change_report(
                facts,
                self._done,
                self._notes,
                self._recognised,
                self._reading,
                follows=self._follows,
                outcome=outcome,
                log=self.log,
            ),
            lambda: preview_png(look, *shown.poses),
        )
        artifacts["preview.png"] = ArtifactData(picture, "image/png")
        artifacts["report.json"] = ArtifactData(report, "application/json")
        return artifacts

    @cached_property
    def _surface(self) -> DeformedSurface:
        if self._affine is not None:
            return self._moved_as_one[0]
        return deformed_surface(self._facts.asset.surface, self._facts.welded, self._verts)

    @cached_property
    def _moved_as_one(self) -> tuple[DeformedSurface, NDArray[np.float64]]:
        assert self._affine is not None
        return affine_surface(self._facts.asset.surface, self._facts.welded, self._affine)

    @property
    def _follows(self) -> bool:
        """Whether joints and morph targets follow: a change is of the asset with its rig, unless it is to be kept."""
        output = self._facts.request.output
        return output.rig is RigMode.FOLLOW or "rig" not in output.model_fields_set

    @cached_property
    def _written(self) -> bytes:
        jacobians = None
        if self._follows and self._affine is not None:
            _, jacobians = self._moved_as_one
        elif self._follows:
            jacobians = vertex_jacobians(self._facts.welded, self._verts)
        surface = self._surface
        shape = surface.positions, surface.normals, surface.tangents
        return self._facts.asset.replace(*shape, jacobians=jacobians, **self._file_options)

    @property
    def _file_options(self) -> dict[str, Any]:
        output = self._facts.request.output
        return {
            "compact": output.compact,
            "provenance": provenance(self._facts, 0) if output.provenance else None,
        }
