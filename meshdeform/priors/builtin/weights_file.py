"""Read and write the shipped weights: half precision safetensors that record their vocabulary."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import VOCABULARY
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork

__all__ = ["WEIGHTS", "file_sha256", "read_network", "read_tensors", "vocabulary_hash", "write_weights"]

WEIGHTS = Path(__file__).parent / "weights" / "prior.safetensors"
_ADVICE = (
    "Install meshdeform again (the weights are part of the package), or train them: "
    "python -m meshdeform.priors.builtin.training.train."
)


def vocabulary_hash(words: Sequence[str] | None = None) -> str:
    """Hash a token numbering (by default this grammar's); weights of another numbering misread every prompt."""
    return hashlib.sha256(" ".join(VOCABULARY if words is None else words).encode()).hexdigest()[:16]


def file_sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_weights(path: Path, state: Mapping[str, Tensor], config: ModelConfig, provenance: Mapping[str, str]) -> None:
    """Write a network's tensors as float16, atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {
        **provenance,
        "config": json.dumps(asdict(config)),
        "vocabulary": vocabulary_hash(),
        "words": " ".join(VOCABULARY),
    }
    part = path.with_suffix(".part")
    save_file({name: tensor.detach().to(torch.float16).contiguous() for name, tensor in state.items()}, part, metadata)
    part.chmod(0o644)
    part.replace(path)


def read_network(path: Path = WEIGHTS) -> tuple[PriorNetwork, dict[str, str]]:
    """Read the network in float32 for inference, and the file's metadata.

    Raises
    ------
    ModelError
        The file is missing, not safetensors, or of another vocabulary.
    """
    state, metadata = read_tensors(path)
    if metadata.get("vocabulary") != vocabulary_hash():
        raise ModelError(f"The weights in {path} were trained for another vocabulary.", advice=_ADVICE)
    config = json.loads(metadata["config"])
    network = PriorNetwork(ModelConfig(**{**config, "channels": tuple(config["channels"])}))
    network.load_state_dict(state)
    network.eval().requires_grad_(requires_grad=False)
    return network.to(memory_format=torch.channels_last), metadata  # type: ignore[call-overload]


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read the tensors in float32 and the metadata of a file of weights of any vocabulary.

    Raises
    ------
    ModelError
        The file is missing or not safetensors.
    """
    if not path.is_file():
        raise ModelError(
            f"The builtin prior's weights are missing: there is no {path.name} in {path.parent}.", advice=_ADVICE
        )
    try:
        with safe_open(path, framework="pt") as file:
            metadata = dict(file.metadata() or {})
            state = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118 (not a dict)
    except SafetensorError as error:
        raise ModelError(f"The builtin prior's weights in {path} cannot be read: {error}.", advice=_ADVICE) from error
    return state, metadata
