"""Find the shape from which an optimisation starts: the asset, or its fit to what the prompt's noun stands for.

The fit is the mesh at rest: the variables, the regularisers and the safeguard are relative to it, and the cameras see
it in the middle. Where the run ends is compared with the asset, as in every run. A checkpoint holds the fit, since its
variables mean nothing without it: a run that resumes, or branches off, fits nothing again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.deformation.checkpoint import load_shape
from meshdeform.deformation.orientation import Orientation
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.requests.choices import GuidanceKind, OrientationMode, StartMode
from meshdeform.runs.base import RunInput, RunLog

if TYPE_CHECKING:
    from meshdeform.runs.facts import AssetFacts

__all__ = ["Start", "start_of"]

_VERTS, _TOLD = "start", "start.told"
"""The tensors of a checkpoint with the vertices of a fit, in world space, and with what the report says of it."""


@dataclass(frozen=True)
class Start:
    """The shape from which an optimisation starts."""

    world: TriangleMesh  # the welded mesh of the asset in this shape, in world space
    told: list[dict[str, Any]] | None = None
    """`start` of the report, an entry for each prompt: to what the asset was fitted; None of the asset as it is."""
    turn_deg: float = 0.0  # azimuth at which the front of a new fit is, from that of the asset

    @classmethod
    def of_state(cls, state: Mapping[str, NDArray[Any]], welded: WeldedMesh) -> Self:
        """Return the start that a checkpoint's tensors are relative to."""
        if _VERTS not in state:
            return cls(welded.mesh)
        return cls(TriangleMesh(state[_VERTS], welded.mesh.faces), json.loads(bytes(state[_TOLD])))

    @property
    def state(self) -> dict[str, NDArray[Any]]:
        """The tensors of it in a checkpoint; none of the asset as it is."""
        if self.told is None:
            return {}
        told = np.frombuffer(json.dumps(self.told, sort_keys=True).encode(), np.uint8)
        return {_VERTS: self.world.verts, _TOLD: told}

    def turned(self, front: Orientation) -> Orientation:
        """Return the front of the fit by that of the asset."""
        return replace(front, turn_deg=180 - (180 - front.turn_deg - self.turn_deg) % 360) if self.turn_deg else front

    @cached_property
    def frame(self) -> CameraFrame:
        """The cameras' frame."""
        return CameraFrame.around(self.world.verts)

    @cached_property
    def mesh(self) -> RestMesh:
        """The mesh at rest, in the cameras' frame."""
        return RestMesh.of(self.frame.place(self.world))


def start_of(facts: AssetFacts, shape: str, job_input: RunInput, log: RunLog) -> Start:
    """Return the start of a run: that of the checkpoint that it goes on from, or the one that it asks for.

    `shape`: the id of the mesh.
    """
    stored = job_input.initial if job_input.checkpoint is None else job_input.checkpoint
    if stored is not None:
        return Start.of_state(load_shape(stored, shape), facts.welded)
    params = facts.params
    if params.guidance is not GuidanceKind.SDS or params.start is not StartMode.EXEMPLAR:
        return Start(facts.welded.mesh)
    from meshdeform.runs.exemplar import start_exemplar

    if "orientation" not in facts.request.params.flat():  # a preset for a model says nothing of the asset's front
        params = params.model_copy(update={"orientation": OrientationMode.AUTO})
    with log.phase("start"):
        run = start_exemplar(replace(facts, params=params), job_input, RunLog())
        for _ in run:
            job_input.on_wait()
        return run.as_start()
