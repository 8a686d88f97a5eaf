"""Read and write weights: half precision safetensors that record their vocabulary.

Taught weights (`taught.py`) also contain pictures of what they were taught, for replay: tensors `replay.NOUN.FIELD`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import VOCABULARY
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork
from meshdeform.priors.builtin.taught import MAX_FILE_BYTES, REPLAY, check, words_of
from meshdeform.support.files import write_files

__all__ = [
    "REPLAY",
    "WEIGHTS",
    "file_sha256",
    "pack_weights",
    "read_network",
    "read_tensors",
    "vocabulary_hash",
    "write_weights",
]

WEIGHTS = Path(__file__).parent / "weights" / "prior.safetensors"
_LARGEST = 512
_ADVICE = (
    "Install meshdeform again (the weights are part of the package), or train them: python -m training.prior.train."
)


def vocabulary_hash(words: Sequence[str] | None = None) -> str:
    """Hash a token numbering (by default this grammar's); weights of another numbering misread every prompt."""
    return hashlib.sha256(" ".join(VOCABULARY if words is None else words).encode()).hexdigest()[:16]


def file_sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_weights(path: Path, state: Mapping[str, Tensor], config: ModelConfig, provenance: Mapping[str, str]) -> None:
    """Write a network of the package's vocabulary, atomically; see `pack_weights`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_files({path: pack_weights(state, config, provenance)})


def pack_weights(
    state: Mapping[str, Tensor],
    config: ModelConfig,
    provenance: Mapping[str, str],
    words: Mapping[str, str] | None = None,
) -> bytes:
    """Return a file of weights: floating-point tensors as float16, others as they are.

    Parameters
    ----------
    provenance : mapping of str to str
        Metadata about the training.
    words : mapping of str to str, optional
        The result of `taught.metadata_of`; by default the words are those of the package.
    """
    words = words or {"words": " ".join(VOCABULARY)}
    metadata = {
        **provenance,
        "config": json.dumps(asdict(config)),
        "vocabulary": vocabulary_hash(words["words"].split()),
        **words,
    }
    return _in_order(save({name: _halved(tensor.detach()).contiguous() for name, tensor in state.items()}, metadata))


def _in_order(data: bytes) -> bytes:
    """Return safetensors with the header sorted by name: the library writes metadata in another order each time."""
    length = int.from_bytes(data[:8], "little")
    header = json.dumps(json.loads(data[8 : 8 + length]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)  # tensors begin at a multiple of 8
    return len(header).to_bytes(8, "little") + header + data[8 + length :]


def _config(metadata: Mapping[str, str]) -> ModelConfig:
    """Return the sizes of a network; a file from elsewhere must not make an enormous one."""
    document = json.loads(metadata["config"])
    config = ModelConfig(**{**document, "channels": tuple(document["channels"])})
    sizes = [*config.channels, *(value for name, value in asdict(config).items() if name != "channels")]
    if len(config.channels) != 3 or not all(isinstance(size, int) and 0 < size <= _LARGEST for size in sizes):
        raise ValueError(f"its sizes are not from 1 to {_LARGEST}")
    return config


def _halved(tensor: Tensor) -> Tensor:
    return tensor.to(torch.float16) if tensor.is_floating_point() else tensor


def read_network(path: Path = WEIGHTS) -> tuple[PriorNetwork, dict[str, str]]:
    """Read the network in float32 for inference, and the file's metadata, which names its words (`taught.words_of`).

    Raises
    ------
    ModelError
        The file is missing or too large, not safetensors, of another vocabulary, or its tensors are not those of the
        network, or not finite.
    """
    state, metadata = read_tensors(path)
    check(path)
    words = words_of(metadata, path)
    try:
        network = PriorNetwork(_config(metadata), words=len(words.tokens))
        network.load_state_dict({name: t for name, t in state.items() if not name.startswith(REPLAY)})
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:300]
        raise ModelError(f"The weights in {path} do not fit the network: {reason}", advice=_ADVICE) from error
    if not all(bool(tensor.isfinite().all()) for tensor in network.state_dict().values()):
        raise ModelError(f"The weights in {path} contain numbers that are not finite.", advice=_ADVICE)
    network.eval().requires_grad_(requires_grad=False)
    return network.to(memory_format=torch.channels_last), metadata  # type: ignore[call-overload]


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read the tensors, floating-point ones in float32, and the metadata of a file of weights of any vocabulary.

    Raises
    ------
    ModelError
        The file is missing or not safetensors.
    """
    if not path.is_file():
        raise ModelError(
            f"The builtin prior's weights are missing: there is no {path.name} in {path.parent}.", advice=_ADVICE
        )
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise ModelError(
            f"The file {path} has {size:,} bytes; weights have at most {MAX_FILE_BYTES:,}.", advice=_ADVICE
        )
    try:
        with safe_open(path, framework="pt") as file:
            metadata = dict(file.metadata() or {})
            loaded = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
    except SafetensorError as error:
        raise ModelError(f"The builtin prior's weights in {path} cannot be read: {error}.", advice=_ADVICE) from error
    return {name: t.float() if t.is_floating_point() else t for name, t in loaded.items()}, metadata
