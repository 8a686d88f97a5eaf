"""A prior that knows one picture for each text, so that every residual can be worked out by hand."""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.rendering.cameras import Cameras
from tests.fakes import FakePrior


class PicturesPrior(FakePrior):
    """Its rows say which picture is meant; a text that it was not given is a mistake of the test."""

    def __init__(self, pictures: dict[str, Tensor]) -> None:
        super().__init__(next(iter(pictures.values())))
        self.names, self.pictures = list(pictures), torch.cat(list(pictures.values()))

    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        super().encode_texts(prompt, *others)
        return torch.eye(len(self.names))[[self.names.index(text) for text in (prompt, *others)]]

    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        self.timesteps += timestep.tolist()
        level = self.alphas_cumprod[timestep].view(-1, 1, 1, 1)
        pictures = torch.tensordot(embedding, self.encode_image(self.pictures), dims=1)
        return tuple((z_t - level.sqrt() * picture) / (1 - level).sqrt() for picture in pictures)
