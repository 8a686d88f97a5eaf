"""Step through the training of the builtin prior: draw a batch, and move the network and its average.

Loss: squared error of the clean picture, weighted as in `prior.py`; timesteps stratified within a batch; the prompt
dropped with probability 0.12. AdamW, one cycle of the learning rate, gradients clipped to norm 1. The result
is the exponential moving average of the weights.

Sources: Ho & Salimans 2022 (prompt dropout); Loshchilov & Hutter 2019 (AdamW); Smith & Topin 2019 (one cycle); Kingma
et al. 2021, appendix I (stratified timesteps).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from meshdeform.priors.builtin.network import PriorNetwork
from meshdeform.priors.builtin.prior import NUM_TIMESTEPS, cosine_alphas_cumprod
from training.prior.pictures import PictureSet

_LARGEST_WEIGHT = 5.0
_NOISY_FROM, _NOISY_SHARE = 0.7, 0.75
"""Score distillation uses this prior only at high noise. Uniform timesteps would spend a third of the training there,
and almost none of it where only the azimuth distinguishes front from back."""


def add_noise(clean: Tensor, noise: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """Return x_t of pictures (B, C, H, W) at timesteps (B,)."""
    level = alphas_cumprod[timestep][:, None, None, None]
    return level.sqrt() * clean + (1.0 - level).sqrt() * noise


def loss_weight(timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """Return the weights (B, 1, 1, 1) of the squared error of x0."""
    return (1.0 / (1.0 - alphas_cumprod[timestep])).clamp_max(_LARGEST_WEIGHT)[:, None, None, None]


class Pictures(Protocol):
    """Labelled pictures to draw batches from."""

    def __len__(self) -> int: ...

    def sample(self, size: int, generator: torch.Generator) -> PictureSet:
        """Draw pictures with replacement."""


@dataclass(frozen=True)
class TrainConfig:
    """Settings of a run, except its length."""

    seed: int = 0
    batch: int = 24
    learning_rate: float = 1.5e-3
    weight_decay: float = 1e-3
    warmup: float = 0.05
    text_dropout: float = 0.12
    ema_decay: float = 0.999
    clip_norm: float = 1.0


class Trainer:
    """Training state: a network, its optimiser and its average."""

    def __init__(
        self,
        data: Pictures,
        config: TrainConfig,
        network: PriorNetwork,
        *,
        device: str,
        precision: str,
    ) -> None:
        self.data, self.config, self.device = data, config, torch.device(device)
        self.precision = precision
        self.network: PriorNetwork = network.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.provenance: dict[str, str] = {}
        self.average = {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), config.learning_rate, weight_decay=config.weight_decay, fused=True
        )
        self.generator = torch.Generator().manual_seed(config.seed)
        self.alphas_cumprod = cosine_alphas_cumprod().to(self.device)
        self.step_number, self.total_steps = 0, 0

    def batch(self) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Draw noisy pictures, timesteps, tokens, azimuths, single-view flags and clean pictures from the generator."""
        size, draw = self.config.batch, self.generator
        sampled = self.data.sample(size, draw)
        clean = sampled.images.to(self.device).float() / 127.5 - 1.0
        tokens = sampled.tokens
        tokens[torch.rand(size, generator=draw) < self.config.text_dropout] = 0
        share = (torch.rand(1, generator=draw) + torch.arange(size) / size) % 1.0
        noisy_part = _NOISY_FROM + (1 - _NOISY_FROM) * share / _NOISY_SHARE
        level = noisy_part.where(share < _NOISY_SHARE, _NOISY_FROM * (share - _NOISY_SHARE) / (1 - _NOISY_SHARE))
        timestep = (level * NUM_TIMESTEPS).long().clamp_max(NUM_TIMESTEPS - 1).to(self.device)
        noise = torch.randn(clean.shape, generator=draw).to(self.device)
        noisy = add_noise(clean, noise, timestep, self.alphas_cumprod).contiguous(memory_format=torch.channels_last)
        azimuth_deg, single = sampled.azimuth_deg.to(self.device), sampled.single.to(self.device)
        return noisy, timestep, tokens.to(self.device), azimuth_deg, single, clean

    def learning_rate(self) -> float:
        """Return the learning rate: a linear rise over the warm-up, then half a cosine to zero."""
        done = self.step_number / self.total_steps
        if done < self.config.warmup:
            return self.config.learning_rate * max(done / self.config.warmup, 0.02)
        angle = torch.pi * (done - self.config.warmup) / (1 - self.config.warmup)
        return self.config.learning_rate * 0.5 * (1 + float(torch.cos(torch.tensor(angle))))

    def step(self) -> float:
        """Train on one batch; return its loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = self.learning_rate()
        noisy, timestep, tokens, azimuth_deg, single, clean = self.batch()
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision == "bf16"):
            predicted = self.network(noisy, timestep, self.network.text(tokens), azimuth_deg, single)
        weight = loss_weight(timestep, self.alphas_cumprod)
        loss = (weight * (predicted.float() - clean).square()).mean()
        self.optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip_norm)
        self.optimiser.step()
        self.step_number += 1
        decay = min(self.config.ema_decay, self.step_number / (self.step_number + 10))
        current = self.network.state_dict()
        torch._foreach_lerp_(list(self.average.values()), [current[name] for name in self.average], 1.0 - decay)
        return float(loss.detach())

    def state(self) -> dict[str, Any]:
        """Return the complete state; call only between two steps."""
        return {
            "network": self.network.state_dict(),
            "average": self.average,
            "optimiser": self.optimiser.state_dict(),
            "generator": self.generator.get_state(),
            "step_number": self.step_number,
            "total_steps": self.total_steps,
            "provenance": self.provenance,
        }

    def load_state(self, state_dict: dict[str, Any]) -> None:
        """Restore a `state`."""
        self.network.load_state_dict(state_dict["network"])
        self.average = state_dict["average"]
        self.optimiser.load_state_dict(state_dict["optimiser"])
        self.generator.set_state(state_dict["generator"].cpu())
        self.step_number, self.total_steps = state_dict["step_number"], state_dict["total_steps"]
        self.provenance = state_dict["provenance"]
