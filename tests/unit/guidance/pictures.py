"""A prior that knows one picture for each text, so that every residual can be worked out by hand."""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.rendering.cameras import Cameras
from meshdeform.testing import FakePrior


class PicturesPrior(FakePrior):
    """Its rows say how much of each picture; a text that it was not given is a mistake of the test."""

    def __init__(self, pictures: dict[str, Tensor], *, unwanted: str = "") -> None:
        super().__init__(next(iter(pictures.values())))
        self.names, self.pictures, self.unwanted = list(pictures), torch.cat(list(pictures.values())), unwanted
        self.asked: list[Tensor] = []

    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        super().encode_texts(prompt, *others)
        return torch.eye(len(self.names))[[self.names.index(text) for text in (prompt, *others)]]

    def noise(self, text: str, z_t: Tensor, timestep: int) -> Tensor:
        """What it finds in z_t."""
        level = self.alphas_cumprod[timestep]
        picture = self.encode_image(self.pictures[self.names.index(text)])
        return (z_t - level.sqrt() * picture) / (1 - level).sqrt()

    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        self.timesteps += timestep.tolist()
        self.asked.append(embedding)
        self.z_t = z_t
        level = self.alphas_cumprod[timestep].view(-1, 1, 1, 1)
        each = embedding if embedding.ndim == 3 else embedding[:, None].expand(-1, len(z_t), -1)
        pictures = torch.tensordot(each, self.encode_image(self.pictures), dims=1)
        return tuple((z_t - level.sqrt() * picture) / (1 - level).sqrt() for picture in pictures)
