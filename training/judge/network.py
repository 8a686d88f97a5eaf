"""The judge's network in torch, for training; `meshdeform.judge.network` runs it in numpy."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from meshdeform.judge.network import WEIGHTS, JudgeConfig, read_weights


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
    """Network that classifies single views."""

    sharpness: Tensor
    commonness: Tensor

    def __init__(self, config: JudgeConfig) -> None:
        super().__init__()
        self.config = config
        c0, (c1, c2, c3) = self.config.stem, self.config.channels
        self.stem = nn.Sequential(nn.Conv2d(1, c0, 5, stride=2, padding=2, bias=False), nn.BatchNorm2d(c0), nn.ReLU())
        self.blocks = nn.Sequential(_Block(c0, c1), _Block(c1, c2), _Block(c2, c3))
        self.noun_head = nn.Linear(c3, len(config.nouns))
        # A factor of the mean over the views: views of one mesh are correlated, so their sum would be overconfident.
        self.register_buffer("sharpness", torch.ones(()))
        self.register_buffer("commonness", torch.zeros(len(config.nouns)))

    def forward(self, images: Tensor) -> Tensor:
        """Return the logits (B, N) float32 of the nouns for views (B, 1, 64, 64) float32 from `draw_views`."""
        features = self.blocks(self.stem(images * 2.0 - 1.0)).mean((2, 3))
        logits: Tensor = self.noun_head(features).float()
        return logits


def read_judge(path: Path = WEIGHTS) -> tuple[JudgeNetwork, dict[str, str]]:
    """Read the network in float32 for inference, and the file's metadata.

    Raises
    ------
    ModelError
        The file is missing, not safetensors, or of another network.
    """
    found = read_weights(path)
    network = JudgeNetwork(found.config)
    network.load_state_dict({name: torch.from_numpy(each) for name, each in found.state.items()}, strict=False)
    network.eval().requires_grad_(requires_grad=False)
    return network, found.metadata
