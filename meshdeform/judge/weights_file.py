"""Read and write the judge's weights: half precision safetensors that record their vocabulary."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from meshdeform.errors import ModelError
from meshdeform.judge.network import JudgeConfig, JudgeNetwork
from meshdeform.priors.builtin.grammar import ATTRIBUTES, NOUNS

__all__ = ["WEIGHTS", "read_judge", "vocabulary_hash", "write_judge"]

WEIGHTS = Path(__file__).parent / "weights" / "judge.safetensors"
_ADVICE = (
    "Install meshdeform again (the weights are part of the package), or train them: "
    "python -m meshdeform.judge.training.train."
)


def vocabulary_hash() -> str:
    """Hash the nouns and attributes in the order of their numbers."""
    words = [*NOUNS, *(f"{attribute.degree} {attribute.part}" for attribute in ATTRIBUTES)]
    return hashlib.sha256(",".join(words).encode()).hexdigest()[:16]


def write_judge(path: Path, network: JudgeNetwork, provenance: Mapping[str, str]) -> None:
    """Write the network as float16, atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {**provenance, "config": json.dumps(asdict(network.config)), "vocabulary": vocabulary_hash()}
    state = {
        name: tensor.detach().to(torch.float16).contiguous()
        for name, tensor in network.state_dict().items()
        if not name.endswith("num_batches_tracked")
    }
    part = path.with_suffix(".part")
    save_file(state, part, metadata)
    part.chmod(0o644)
    part.replace(path)


def read_judge(path: Path = WEIGHTS) -> tuple[JudgeNetwork, dict[str, str]]:
    """Read the network in float32 for inference, and the file's metadata.

    Raises
    ------
    ModelError
        The file is missing, not safetensors, or of another vocabulary or network.
    """
    if not path.is_file():
        raise ModelError(f"The judge's weights are missing: there is no {path.name} in {path.parent}.", advice=_ADVICE)
    try:
        with safe_open(path, framework="pt") as file:
            metadata = dict(file.metadata() or {})
            state = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118 (not a dict)
    except SafetensorError as error:
        raise ModelError(f"The judge's weights in {path} cannot be read: {error}.", advice=_ADVICE) from error
    if metadata.get("vocabulary") != vocabulary_hash():
        raise ModelError(f"The judge's weights in {path} were trained for another vocabulary.", advice=_ADVICE)
    try:
        config = json.loads(metadata["config"])
        network = JudgeNetwork(JudgeConfig(**{**config, "channels": tuple(config["channels"])}))
        missing, strange = network.load_state_dict(state, strict=False)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise ModelError(f"The judge's weights in {path} are of another network.", advice=_ADVICE) from error
    if strange or [name for name in missing if not name.endswith("num_batches_tracked")]:
        raise ModelError(f"The judge's weights in {path} are of another network.", advice=_ADVICE)
    network.eval().requires_grad_(requires_grad=False)
    return network, metadata
