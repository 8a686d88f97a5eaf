"""Find text-to-3D models on this machine and load them; they make target meshes. Importing this needs no torch.

A model is a folder in diffusers' layout whose `model_index.json` names a pipeline that `PIPELINES` knows::

    model_index.json          names ShapEPipeline
    prior/  shap_e_renderer/  text_encoder/    config.json and *.safetensors
    tokenizer/  scheduler/

To add a pipeline, write a class with the interface `TextTo3D` and name it in `PIPELINES`.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from meshdeform.errors import DependencyError, ModelError, install_command

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["GeneratedMesh", "TextTo3D", "check_generator", "is_generator", "load_generator", "model_state"]

PIPELINES = {"ShapEPipeline": "meshdeform.priors.shap_e:ShapE"}
"""The class that runs each kind of pipeline, as module and name."""

_PARTS = ("prior", "text_encoder", "shap_e_renderer")
_ADVICE = (
    "Name a folder in diffusers' layout with safetensors weights, as `hf download openai/shap-e --local-dir FOLDER` "
    "writes it; the operator of a service adds it to MESHDEFORM_ALLOWED_MODELS."
)


@dataclass(frozen=True)
class GeneratedMesh:
    """A generated mesh with +Y up: verts (V, 3) float64, faces (F, 3) int64 and, if known, linear colours (V, 3)."""

    verts: NDArray[np.float64]
    faces: NDArray[np.int64]
    colors: NDArray[np.float64] | None = None


class TextTo3D(Protocol):
    """A model that makes meshes of prompts."""

    def generate(self, prompt: str, *, seed: int, steps: int, guidance_scale: float) -> GeneratedMesh:
        """Return a mesh, upright; the same for the same arguments on the same machine on the CPU.

        Raises
        ------
        PromptError
            The model cannot read all of the prompt.
        ModelError
            What it made is empty.
        """


def is_generator(model: str) -> bool:
    """Return whether a folder holds a text-to-3D model that we know."""
    return _pipeline(Path(model).expanduser()) in PIPELINES


def check_generator(model: str) -> None:
    """Check cheaply whether `load_generator` would find a model; without torch, nothing is checked.

    Raises
    ------
    ModelError
        There is no such folder, or it is incomplete or of another kind.
    DependencyError
        diffusers or transformers is not installed.
    """
    if importlib.util.find_spec("torch") is None:
        return
    missing = [name for name in ("diffusers", "transformers") if importlib.util.find_spec(name) is None]
    if missing:
        raise DependencyError(
            f"The model {model!r} needs {' and '.join(missing)}.",
            advice=f"Install the extra on the machine that runs the worker: {install_command('sd')}.",
        )
    folder = Path(model).expanduser()
    if not folder.is_dir():
        raise ModelError(f"There is no folder {model!r} on the machine that runs the worker.", advice=_ADVICE)
    kind = _pipeline(folder)
    if kind not in PIPELINES:
        what = f"a {kind}" if kind else "no pipeline of diffusers"
        raise ModelError(
            f"The model {model!r} is {what}, not a text-to-3D model that Meshdeform knows.", advice=_ADVICE
        )
    for part in _PARTS:
        if not any((folder / part).glob("*.safetensors")):
            raise ModelError(f"The model {model!r} has no safetensors weights in {part}/.", advice=_ADVICE)


def load_generator(model: str, *, device: str) -> TextTo3D:
    """Load a model from its folder; nothing is downloaded.

    Raises
    ------
    ModelError, DependencyError
        As for `check_generator`, or a file of the model is damaged.
    """
    check_generator(model)
    folder = Path(model).expanduser()
    module, _, name = PIPELINES[_pipeline(folder)].partition(":")
    made: TextTo3D = getattr(importlib.import_module(module), name)(folder, device=device)
    return made


def model_state(model: str) -> str:
    """Return a hash of the names, sizes and times of a model's files, which changes when the model does."""
    folder = Path(model).expanduser().resolve()
    digest = hashlib.sha256(str(folder).encode())
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            about = path.stat()
            digest.update(f"{path.relative_to(folder)}\0{about.st_size}\0{about.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def _pipeline(folder: Path) -> str:
    """Return the name of a folder's pipeline; empty if there is none."""
    try:
        index: Any = json.loads((folder / "model_index.json").read_bytes())
    except (OSError, ValueError):
        return ""
    name = index.get("_class_name") if isinstance(index, dict) else None
    return name if isinstance(name, str) else ""
