"""Define the judge's network, a small residual network for one view and an encoder for the prompt; keep its weights.

::

    score(view, prompt) = noun_logit(view)[noun] + <a(view), g(noun, attributes)> / sqrt(width)

estimates log p(view | prompt) up to a constant of the view. The scores of several views are averaged. The weights are
half precision safetensors that record their vocabulary.

Sources: He et al. 2016 (residual networks), van den Oord et al. 2018 (InfoNCE: a score is a log ratio of densities,
eq. 5).
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import ATTRIBUTES, NOUNS, ParsedPrompt

__all__ = [
    "WEIGHTS",
    "JudgeConfig",
    "JudgeNetwork",
    "Prompts",
    "encoded",
    "read_judge",
    "vocabulary_hash",
]

_NOUN_NUMBER = {noun: number for number, noun in enumerate(NOUNS)}
_ATTRIBUTE_NUMBER = {attribute: number for number, attribute in enumerate(ATTRIBUTES)}


@dataclass(frozen=True)
class JudgeConfig:
    """Sizes of the network; the defaults are those of the shipped weights."""

    stem: int = 24
    channels: tuple[int, int, int] = (48, 96, 128)
    width: int = 128


class Prompts(NamedTuple):
    """P prompts: `noun` (P,) int64 and `attributes` (P, A) float32, 1 where the prompt has the attribute."""

    noun: Tensor
    attributes: Tensor


def encoded(prompts: list[ParsedPrompt]) -> Prompts:
    """Encode parsed prompts as tensors."""
    noun = torch.tensor([_NOUN_NUMBER[prompt.noun] for prompt in prompts], dtype=torch.int64)
    attributes = torch.zeros(len(prompts), len(ATTRIBUTES))
    for row, prompt in enumerate(prompts):
        for attribute in prompt.attributes:
            attributes[row, _ATTRIBUTE_NUMBER[attribute]] = 1.0
    return Prompts(noun, attributes)


class _Block(nn.Module):
    """Two 3 x 3 convolutions that halve the picture, with a 1 x 1 convolution as shortcut."""

    def __init__(self, inner: int, outer: int) -> None:
        super().__init__()
        self.conv_in = nn.Conv2d(inner, outer, 3, stride=2, padding=1, bias=False)
        self.norm_in = nn.BatchNorm2d(outer)
        self.conv_out = nn.Conv2d(outer, outer, 3, padding=1, bias=False)
        self.norm_out = nn.BatchNorm2d(outer)
        self.skip = nn.Conv2d(inner, outer, 1, stride=2, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, inner, H, W) to (B, outer, H / 2, W / 2)."""
        h = torch.relu(self.norm_in(self.conv_in(x)))
        return torch.relu(self.skip(x) + self.norm_out(self.conv_out(h)))


class JudgeNetwork(nn.Module):
    """Network that scores prompts for single views."""

    prompt_sharpness: Tensor
    noun_sharpness: Tensor

    def __init__(self, config: JudgeConfig | None = None) -> None:
        super().__init__()
        self.config = config or JudgeConfig()
        c0, c1, c2, width = self.config.stem, *self.config.channels[:2], self.config.width
        c3 = self.config.channels[2]
        self.stem = nn.Sequential(nn.Conv2d(1, c0, 5, stride=2, padding=2, bias=False), nn.BatchNorm2d(c0), nn.ReLU())
        self.blocks = nn.Sequential(_Block(c0, c1), _Block(c1, c2), _Block(c2, c3))
        self.noun_head = nn.Linear(c3, len(NOUNS))
        self.attribute_head = nn.Linear(c3, width)
        self.noun = nn.Embedding(len(NOUNS), width)
        self.attribute = nn.Linear(len(ATTRIBUTES), width, bias=False)
        self.mix = nn.Sequential(nn.Linear(width, 2 * width), nn.SiLU(), nn.Linear(2 * width, width))
        # Factors of the mean over the views: views of one mesh are correlated, so their sum would be overconfident.
        self.register_buffer("prompt_sharpness", torch.ones(()))
        self.register_buffer("noun_sharpness", torch.ones(()))

    def encode_views(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Encode views.

        Parameters
        ----------
        images : (B, 1, 64, 64) float32
            From `draw_views`.

        Returns
        -------
        noun_logits : (B, N) float32
        features : (B, width) float32
        """
        features = self.blocks(self.stem(images * 2.0 - 1.0)).mean((2, 3))
        return self.noun_head(features).float(), self.attribute_head(features).float()

    def encode_prompts(self, prompts: Prompts) -> Tensor:
        """Encode prompts as vectors (P, width)."""
        x = self.noun(prompts.noun) + self.attribute(prompts.attributes)
        text: Tensor = x + self.mix(x)
        return text

    def scores(self, noun_logits: Tensor, features: Tensor, prompts: Prompts) -> Tensor:
        """Return the scores (B, P) of every prompt for every view."""
        match = features @ self.encode_prompts(prompts).float().mT / math.sqrt(self.config.width)
        return noun_logits[:, prompts.noun] + match


WEIGHTS = Path(__file__).parent / "weights" / "judge.safetensors"
_ADVICE = (
    "Install meshdeform again (the weights are part of the package), or train them: python -m training.judge.train."
)


def vocabulary_hash() -> str:
    """Hash the nouns and attributes in the order of their numbers."""
    words = [*NOUNS, *(f"{attribute.degree} {attribute.part}" for attribute in ATTRIBUTES)]
    return hashlib.sha256(",".join(words).encode()).hexdigest()[:16]


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
