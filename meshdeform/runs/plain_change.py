"""Run a prompt that is a change in plain words: no model, no steps.

The change is made in the pose that viewers show and taken back to the bind pose of skins vertex by vertex; joints and
morph targets follow it, unless `output.rig` is `keep`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from meshdeform.plain.body import bind_moves, body_of
from meshdeform.plain.change import Done, apply_changes, meant
from meshdeform.plain.parts import PartMissingError
from meshdeform.plain.words import Sentence
from meshdeform.rendering.studio import preview_png
from meshdeform.requests.choices import RigMode
from meshdeform.runs.base import ArtifactData, JobRun, RunLog
from meshdeform.runs.changes import check_change, part_names, part_not_found
from meshdeform.runs.strength import AssetPath, write_morph
from meshdeform.runs.surfaces import DeformedSurface, Shown, deformed_surface, read_result, vertex_jacobians
from meshdeform.runs.text_report import AssetFacts, Outcome, change_report, provenance
from meshdeform.runs.verdict import Recognition

_GLB = "model/gltf-binary"


def start_change(
    facts: AssetFacts, sentence: Sentence, recognised: Recognition | None, log: RunLog
) -> PlainChangeRun | None:
    """Make the changes of a sentence; None if it describes what the source was recognised as, and a part is missing."""
    check_change(facts.params)
    welded = facts.welded
    with log.phase("change"):
        body = body_of(facts.asset, welded.vertex_map, welded.first_rows(), welded.mesh.faces.numpy())
        try:
            changed, done = apply_changes(body, meant(body, sentence))
        except PartMissingError as missing:
            if recognised is not None:
                return None
            raise part_not_found(str(missing), part_names(body, facts.params)) from missing
        verts = welded.mesh.verts + torch.from_numpy(bind_moves(facts.asset, body, changed))
    return PlainChangeRun(facts, verts, done, recognised, log)


class PlainChangeRun(JobRun):
    """A change that was made, created by `start_change`; it has no steps."""

    def __init__(
        self, facts: AssetFacts, verts: Tensor, done: list[Done], recognised: Recognition | None, log: RunLog
    ) -> None:
        super().__init__(0, 0, log)
        self._facts, self._verts, self._done, self._recognised = facts, verts, done, recognised

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
            artifacts["preview.png"] = ArtifactData(preview_png(look, *shown.poses), "image/png")
        outcome = Outcome(self._verts, result, written, shown, self._surface.rebuilt_normals, 0.0)
        report = change_report(facts, self._done, self._recognised, self._follows, outcome, self.log)
        artifacts["report.json"] = ArtifactData(report, "application/json")
        return artifacts

    @cached_property
    def _surface(self) -> DeformedSurface:
        return deformed_surface(self._facts.asset.surface, self._facts.welded, self._verts)

    @property
    def _follows(self) -> bool:
        """Whether joints and morph targets follow: a change is of the asset with its rig, unless it is to be kept."""
        output = self._facts.request.output
        return output.rig is RigMode.FOLLOW or "rig" not in output.model_fields_set

    @cached_property
    def _written(self) -> bytes:
        jacobians = vertex_jacobians(self._facts.welded, self._verts) if self._follows else None
        surface = self._surface
        shape = surface.positions, surface.normals, surface.tangents
        return self._facts.asset.replace(*shape, jacobians=jacobians, posed=True, **self._file_options)

    @property
    def _file_options(self) -> dict[str, Any]:
        output = self._facts.request.output
        return {
            "compact": output.compact,
            "provenance": provenance(self._facts, 0) if output.provenance else None,
        }
