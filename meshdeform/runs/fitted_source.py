"""Make a mesh of an asset without triangles, so that a job of kind `text_deform` can deform it.

A field is fitted to the points, the grid or the network as a job of kind `surface_fit` does, with few faces and steps,
and unfolded. The mesh stands for the asset from then on: it is the artifact `source.glb`, and every checkpoint holds
it, so that a resumed run and a branch deform the very same mesh.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import safetensors.torch
import torch
from safetensors import SafetensorError

from meshdeform.assets.surface_files import read_surface_file, warnings_about
from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.errors import AssetTooLargeError, CheckpointError
from meshdeform.fields.base_mesh import base_of
from meshdeform.fields.container import encode_base
from meshdeform.fields.fitting import FieldFit, FieldFrame, FitOptions
from meshdeform.fields.level_files import level_glb
from meshdeform.fields.measures import distances
from meshdeform.fields.patches import level_of
from meshdeform.fields.surface_sources import surface_of
from meshdeform.runs.base import FITTED_SOURCE, ArtifactData, RunInput
from meshdeform.runs.report import sha256_hex

__all__ = ["FittedSource", "fitted_source"]

BASE_FACES = 500
STEPS = 300
BATCH_FACES = 48
LEVEL = 2
"""Divisions of each face of the base; 16 triangles for each."""

_SEED = 0
"""That of every fit, so that variations of a job deform the same mesh."""
_MESH, _FACTS = "source.glb", "source.facts"
_BEAT_STEPS = 10


@dataclass(frozen=True)
class FittedSource:
    """The mesh that stands for an asset without triangles.

    Attributes
    ----------
    data : bytes
        A GLB.
    facts : dict
        What it was fitted to, how, and how far off it is: `surface` of the report.
    """

    data: bytes
    facts: dict[str, Any]

    @property
    def sha256(self) -> str:
        """SHA-256 of the GLB, hexadecimal."""
        return sha256_hex(self.data)

    def kept_in(self, checkpoint: Checkpoint) -> Checkpoint:
        """Return a checkpoint with the mesh."""
        facts = json.dumps(self.facts).encode()
        more = {_MESH: _as_tensor(self.data), _FACTS: _as_tensor(facts)}
        return Checkpoint(checkpoint.step, {**checkpoint.tensors, **more})


def fitted_source(given: RunInput) -> FittedSource:
    """Return the mesh that stands for an asset without triangles: that of the checkpoint, or a new one.

    Parameters
    ----------
    given : RunInput
        A run that resumes or branches has the mesh of its checkpoint. The mesh is shown as the artifact `source.glb`.

    Raises
    ------
    AssetError
        The surface cannot be read or fitted, or a limit on triangles leaves no room for its mesh.
    CheckpointError
        The checkpoint to resume from has no mesh.
    NumericalError
        The fit diverged.
    """
    if given.checkpoint is not None or given.initial is not None:
        source = _kept(given.checkpoint or given.initial or b"")
    else:
        given.on_phase("surface")
        source = _fit(given)
    given.on_artifact(FITTED_SOURCE.name, ArtifactData(source.data, FITTED_SOURCE.media_type))
    return source


def _fit(given: RunInput) -> FittedSource:
    file = given.files["asset"]
    found = read_surface_file(file.data, file.filename, given.limits)
    assert found is not None
    surface = surface_of(found)
    given.on_wait()
    frame = FieldFrame.around(surface.reference.verts)
    verts, faces = base_of(surface.reference, BASE_FACES)
    triangles = len(faces) * 4**LEVEL
    if given.limits is not None and triangles > given.limits.max_triangles:
        raise AssetTooLargeError(
            f"The surface becomes a mesh of {triangles} triangles; the limit is {given.limits.max_triangles} "
            "(MESHDEFORM_MAX_TRIANGLES)."
        )
    base = encode_base(np.clip(frame.enter(verts), -1, 1), faces)
    options = FitOptions(steps=STEPS, seed=_SEED, batch_faces=BATCH_FACES, rounding=False)
    fit = FieldFit(surface, frame, base.verts, base.faces, options)
    for step in fit:
        if step.step % _BEAT_STEPS == 0:
            given.on_wait()
    level = level_of(base.faces, len(base.verts), LEVEL)
    unfolded = frame.leave(fit.positions(level.corners, level.weights))
    facts = {
        "described_by": surface.kind,
        "base_faces": len(base.faces),
        "steps": fit.step,
        "seed": _SEED,
        "vertices": len(unfolded),
        "triangles": len(level.faces),
        "components": surface.reference.topology.components,
        "genus": surface.reference.topology.genus,
        "distance": distances(surface, unfolded, level.faces),
        "warnings": list(warnings_about(found)),
    }
    data = level_glb(unfolded, level.faces)
    return FittedSource(data, {**facts, "bytes": len(data), "sha256": sha256_hex(data)})


def _kept(checkpoint: bytes) -> FittedSource:
    """Return the mesh that a checkpoint holds."""
    try:
        tensors = safetensors.torch.load(checkpoint)
        data = tensors[_MESH].numpy().tobytes()
        return FittedSource(data, json.loads(tensors[_FACTS].numpy().tobytes()))
    except (SafetensorError, KeyError, ValueError) as error:
        raise CheckpointError("The checkpoint does not hold the mesh that was fitted to the asset.") from error


def _as_tensor(data: bytes) -> torch.Tensor:
    return torch.frombuffer(bytearray(data), dtype=torch.uint8)
