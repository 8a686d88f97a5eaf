"""Write what a run delivers of an asset with its new shape: the file, a morph, the picture and the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.rendering.studio import preview_png
from meshdeform.requests.choices import RigMode
from meshdeform.runs.base import ArtifactData, RunLog
from meshdeform.runs.facts import AssetFacts, Held, Outcome
from meshdeform.runs.strength import AssetPath, write_morph
from meshdeform.runs.surfaces import DeformedSurface, Shown, deformed_surface, read_result, vertex_jacobians
from meshdeform.runs.text_report import provenance
from meshdeform.support.threads import side_by_side

__all__ = ["GLB", "NewShape"]

GLB = "model/gltf-binary"


@dataclass(frozen=True)
class NewShape:
    """A new shape of an asset.

    `verts`, (V, 3) float64: its welded vertices, in world space; `jacobians`, (N, 3, 3): the linear map around each of
    the asset's vertices, which joints and morph targets follow, None if they stay; `step`: number of steps done.
    """

    facts: AssetFacts
    verts: NDArray[np.float64]
    surface: DeformedSurface
    jacobians: NDArray[np.float64] | None
    step: int

    @classmethod
    def of(cls, facts: AssetFacts, verts: NDArray[np.float64], step: int) -> NewShape:
        """Give the asset the shape of deformed welded vertices (V, 3) float64; its rig follows, unless it is kept."""
        follows = facts.request.output.rig is RigMode.FOLLOW
        jacobians = vertex_jacobians(facts.welded, verts) if follows else None
        return cls(facts, verts, deformed_surface(facts.asset.surface, facts.welded, verts), jacobians, step)

    def written(self) -> bytes:
        """Return the asset with this shape as a GLB, with the options of the request."""
        surface = self.surface
        shape = surface.positions, surface.normals, surface.tangents
        return self.facts.asset.replace(*shape, jacobians=self.jacobians, **self._file_options())

    def delivered(
        self, report: Callable[[Outcome], bytes], log: RunLog, held: Held | None = None
    ) -> dict[str, ArtifactData]:
        """Return `result.glb`, `preview.png` and `report.json`, and `morph.glb` if requested.

        `report`: makes the report of what was written; `held`: what the safeguard held back.
        """
        facts = self.facts
        with log.phase("write"):
            result = self.written()
            # Read the file back, so that the report describes what is in the file.
            written = read_result(result).without(facts.asset.excluded)
            artifacts = {"result.glb": ArtifactData(result, GLB)}
            if facts.request.output.morph:
                artifacts["morph.glb"] = ArtifactData(self._morph(), GLB)
            # With the normals that the file has now, so that the picture shows what a viewer of the file does.
            shown = Shown.of(facts.asset, written, facts.welded, self.verts)
            look = facts.asset.appearance().of_triangles(facts.drawn)
        outcome = Outcome(self.verts, result, written, shown, self.surface.rebuilt_normals, held or Held())
        told, picture = side_by_side(lambda: report(outcome), lambda: preview_png(look, *shown.poses))
        artifacts["preview.png"] = ArtifactData(picture, "image/png")
        artifacts["report.json"] = ArtifactData(told, "application/json")
        return artifacts

    def _morph(self) -> bytes:
        asset, path = self.facts.asset, self.facts.request.output.morph_path
        way = AssetPath(asset, self.surface.positions, self.facts.welded)
        return write_morph(asset, way, self.surface, path, **self._file_options())

    def _file_options(self) -> dict[str, Any]:
        output = self.facts.request.output
        return {
            "compact": output.compact,
            "provenance": provenance(self.facts, self.step) if output.provenance else None,
        }
