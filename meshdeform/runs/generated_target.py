"""Make the target mesh of a job with a text-to-3D model, show it before the fit begins, and keep it for the next job.

Targets are kept in a folder of the user's caches, by prompt, seed, settings and model: the same request again, another
variation of the fit, and a resumed job do not load the model. The model is released once its mesh is made.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from meshdeform.assets.build import build_glb
from meshdeform.errors import ParameterError
from meshdeform.priors.public_names import hidden_folders
from meshdeform.priors.text_to_3d import GeneratedMesh, load_generator, model_state
from meshdeform.requests.stages import GeneratedTarget
from meshdeform.runs.base import ArtifactData, RunInput
from meshdeform.support.files import write_files

__all__ = ["KEPT", "GenerateTarget", "cannot_generate", "generated_target"]

_log = logging.getLogger(__name__)

KEPT = 64
"""Number of targets that are kept; the ones used least recently are removed."""

_EDITION = 1
"""Changes when the same model, prompt and seed would give another file."""

GenerateTarget = Callable[[GeneratedTarget, str], bytes]
"""Returns the GLB of a target, and shows it as the artifact of that name."""


def cannot_generate(_target: GeneratedTarget, _name: str) -> bytes:
    """Refuse a generated target where nobody makes one.

    Raises
    ------
    ParameterError
    """
    raise ParameterError("params.target needs a text-to-3D model, and none was given.")


def generated_target(wanted: GeneratedTarget, name: str, seed: int, given: RunInput) -> bytes:
    """Return the GLB of a generated target: a kept one, or a new one.

    Parameters
    ----------
    wanted : GeneratedTarget
        Its model is a folder of this machine.
    name : str
        The artifact as which it is shown.
    seed : int
    given : RunInput
        The device, and who is told.

    Raises
    ------
    ModelError, DependencyError
        The model cannot be loaded, or its mesh is empty.
    PromptError
        The model cannot read the prompt.
    """
    given.on_phase("target")
    with hidden_folders([wanted.model]):
        kept = _cache() / f"{_key(wanted, seed)}.glb"
        data = _read(kept)
        if data is None:
            _log.info("making a target with %s", Path(wanted.model).name)
            generator = load_generator(wanted.model, device=given.device)
            mesh = generator.generate(
                wanted.prompt, seed=seed, steps=wanted.steps, guidance_scale=wanted.guidance_scale
            )
            data = _glb(mesh)
            _keep(kept, data)
    given.on_artifact(name, ArtifactData(data, "model/gltf-binary"))
    return data


def _glb(mesh: GeneratedMesh) -> bytes:
    verts, faces = mesh.verts, mesh.faces
    corners = verts[faces]
    if np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0:
        faces = faces[:, ::-1]  # inside out
        corners = corners[:, ::-1]
    normals = np.zeros_like(verts)
    np.add.at(
        normals, faces.ravel(), np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), 3, 0)
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    return build_glb(verts, faces, normals=normals, colors=mesh.colors, name="target")


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "meshdeform" / "targets"


def _key(wanted: GeneratedTarget, seed: int) -> str:
    about = {**wanted.model_dump(mode="json"), "model": model_state(wanted.model), "seed": seed, "edition": _EDITION}
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()


def _read(path: Path) -> bytes | None:
    try:
        data = path.read_bytes()
        path.touch()
    except OSError:
        return None
    return data


def _keep(path: Path, data: bytes) -> None:
    """Keep a target, and remove old ones; without a writable folder, none is kept."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_files({path: data})
        newest = sorted(path.parent.glob("*.glb"), key=lambda each: each.stat().st_mtime, reverse=True)
        for old in newest[KEPT:]:
            old.unlink(missing_ok=True)
    except OSError as error:
        _log.warning("the generated target is not kept: %s", error)
