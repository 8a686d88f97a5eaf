"""Save the state of an optimisation as safetensors bytes, and load it again.

The file holds tensors only (nothing that executes on load), the step, and a fingerprint of everything that the state
depends on: the parameters, the asset's bytes, the prompt and the model. A checkpoint of another job is refused.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from meshdeform.errors import CheckpointError

_FORMAT = "meshdeform-checkpoint-1"


@dataclass(frozen=True)
class Checkpoint:
    """A state from which an optimisation can continue."""

    step: int  # number of completed steps
    tensors: dict[str, NDArray[Any]]  # jacobians, Adam's moments and the random generator's state
    precision: str = ""
    """Precision of the diffusion prior up to this step; several, in order, such as `bfloat16, float32`, if the run
    was resumed in another one. Empty if there was no prior."""


def fingerprint(**facts: Any) -> str:
    """Return the SHA-256 of what a run depends on, serialised as JSON with sorted keys."""
    text = json.dumps(facts, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def dump_checkpoint(checkpoint: Checkpoint, run: str, asset: str = "") -> bytes:
    """Serialise a checkpoint of the run with fingerprint `run` and of the mesh with id `asset`."""
    metadata = {"format": _FORMAT, "step": str(checkpoint.step), "run": run, "asset": asset}
    if checkpoint.precision:
        metadata["precision"] = checkpoint.precision
    return safetensors.numpy.save({k: np.asarray(v, order="C") for k, v in checkpoint.tensors.items()}, metadata)


def load_checkpoint(data: bytes, run: str) -> Checkpoint:
    """Load a checkpoint of the run with fingerprint `run`.

    Raises CheckpointError: the bytes are incomplete or damaged, or belong to another run.
    """
    checkpoint, metadata = _read(data)
    if metadata.get("run") != run:
        raise CheckpointError(
            "The checkpoint was made with other parameters, another asset or another model, or a word of your own has "
            "changed since."
        )
    return checkpoint


def load_shape(data: bytes, asset: str) -> dict[str, NDArray[Any]]:
    """Load the tensors of a checkpoint of any run that deformed the mesh with this id: the SHA-256 of its asset.

    Raises CheckpointError: the bytes are incomplete or damaged, or belong to another asset.
    """
    checkpoint, metadata = _read(data)
    if metadata.get("asset") != asset:
        raise CheckpointError(
            "The checkpoint was made with another asset, or other params.control.exclude, "
            "params.control.backdrop or output.subdivide."
        )
    return checkpoint.tensors


def _read(data: bytes) -> tuple[Checkpoint, dict[str, str]]:
    try:
        metadata = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
        tensors = safetensors.numpy.load(data)
        step = int(metadata["step"])
    except (SafetensorError, ValueError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise CheckpointError("The checkpoint is damaged, or the file is not a checkpoint.") from error
    if metadata.get("format") != _FORMAT:
        raise CheckpointError("The checkpoint was made by another version of meshdeform.")
    return Checkpoint(step, tensors, metadata.get("precision", "")), metadata
