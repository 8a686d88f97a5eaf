"""Train the builtin prior: `python -m meshdeform.priors.builtin.training.train`.

Data: members of the families, drawn by `dataset.py` from `--seed`. Loss: squared error of the clean picture,
weighted as in `prior.py`; timesteps stratified within a batch; the prompt dropped with probability 0.12. AdamW, one
cycle of the learning rate, gradients clipped to norm 1. The exponential moving average of the weights is what is
written and shipped. `--steps` sets the length of the run; `--minutes` sets it after timing the first steps. A stopped
run continues from `--state`; a run with `--initial` starts from the weights of another edition, whose vocabulary may be
smaller (`warm_start.py`).

Sources: Ho & Salimans 2022 (prompt dropout); Loshchilov & Hutter 2019
(AdamW); Smith & Topin 2019 (one cycle); Kingma et al. 2021, appendix I (stratified timesteps).
"""

from __future__ import annotations

import argparse
import logging
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from meshdeform.priors.builtin.network import PriorNetwork
from meshdeform.priors.builtin.prior import NUM_TIMESTEPS, add_noise, cosine_alphas_cumprod, loss_weight
from meshdeform.priors.builtin.training.dataset import PictureFolder, PictureSet
from meshdeform.priors.builtin.training.families import FAMILIES
from meshdeform.priors.builtin.training.warm_start import warm_start
from meshdeform.priors.builtin.weights_file import WEIGHTS, file_sha256, write_weights
from meshdeform.support.heaps import keep_freed_memory

__all__ = ["TrainConfig", "Trainer", "main"]

_log = logging.getLogger(__name__)
_TIMED_STEPS = 30
_NOISY_FROM, _NOISY_SHARE = 0.7, 0.75
"""Score distillation uses this prior only at high noise. Uniform timesteps would spend a third of the training there,
and almost none of it where only the azimuth distinguishes front from back."""


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
    """Training state: the network, its optimiser and its average, which start from `initial` or `network` if given."""

    def __init__(
        self,
        data: PictureSet | PictureFolder,
        config: TrainConfig,
        *,
        device: str,
        precision: str,
        initial: Path | None = None,
        network: PriorNetwork | None = None,
    ) -> None:
        torch.manual_seed(config.seed)
        self.data, self.config, self.device = data, config, torch.device(device)
        self.precision = precision
        started = network or PriorNetwork()
        self.network: PriorNetwork = started.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.provenance: dict[str, str] = {}
        if initial:
            new = warm_start(self.network, initial, torch.Generator().manual_seed(config.seed))
            self.provenance["initial"] = file_sha256(initial)
            _log.info("started from %s, without %s", initial, ", ".join(new) or "exception")
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
        drawn = self.data.sample(size, draw)
        clean = drawn.images.to(self.device).float() / 127.5 - 1.0
        tokens = drawn.tokens
        tokens[torch.rand(size, generator=draw) < self.config.text_dropout] = 0
        share = (torch.rand(1, generator=draw) + torch.arange(size) / size) % 1.0
        noisy_part = _NOISY_FROM + (1 - _NOISY_FROM) * share / _NOISY_SHARE
        level = noisy_part.where(share < _NOISY_SHARE, _NOISY_FROM * (share - _NOISY_SHARE) / (1 - _NOISY_SHARE))
        timestep = (level * NUM_TIMESTEPS).long().clamp_max(NUM_TIMESTEPS - 1).to(self.device)
        noise = torch.randn(clean.shape, generator=draw).to(self.device)
        noisy = add_noise(clean, noise, timestep, self.alphas_cumprod).contiguous(memory_format=torch.channels_last)
        azimuth_deg, single = drawn.azimuth_deg.to(self.device), drawn.single.to(self.device)
        return noisy, timestep, tokens.to(self.device), azimuth_deg, single, clean

    def learning_rate(self) -> float:
        """Return the learning rate: a linear rise over the warm-up, then half a cosine to zero."""
        if self.total_steps == 0:  # still being timed
            return self.config.learning_rate * 0.02
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

    def save(self, state: Path, weights: Path) -> None:
        """Write the average as weights, and the state for resuming, each atomically."""
        provenance = {
            "steps": str(self.step_number),
            "total_steps": str(self.total_steps),
            "seed": str(self.config.seed),
            "batch": str(self.config.batch),
            "pictures": str(len(self.data)),
            "precision": self.precision,
            "learning_rate": str(self.config.learning_rate),
            **self.provenance,
        }
        write_weights(weights, self.average, self.network.config, provenance)
        state.parent.mkdir(parents=True, exist_ok=True)
        part = state.with_suffix(".part")
        torch.save(self.state(), part)
        part.replace(state)

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

    def restore(self, state: Path) -> None:
        """Restore the state that `save` wrote."""
        self.load_state(torch.load(state, map_location=self.device, weights_only=True))

    def load_state(self, state_dict: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.network.load_state_dict(state_dict["network"])
        self.average = state_dict["average"]
        self.optimiser.load_state_dict(state_dict["optimiser"])
        self.generator.set_state(state_dict["generator"].cpu())
        self.step_number, self.total_steps = state_dict["step_number"], state_dict["total_steps"]
        self.provenance = state_dict["provenance"]


def _fit(trainer: Trainer, minutes: float, state: Path, weights: Path, save_every: int) -> None:
    """Run the trainer to its end; if the number of steps is not set, time a few steps and set it."""
    keep_freed_memory()
    begun, smooth = time.monotonic(), 0.0
    first = trainer.step_number
    while trainer.total_steps == 0 or trainer.step_number < trainer.total_steps:
        loss = trainer.step()
        done = trainer.step_number - first
        smooth = loss if done == 1 else 0.98 * smooth + 0.02 * loss
        if trainer.total_steps == 0 and done == _TIMED_STEPS:
            per_step = (time.monotonic() - begun) / done
            trainer.total_steps = max(done + 1, int(minutes * 60 / per_step))
        if trainer.step_number % 100 == 0:
            per_step = (time.monotonic() - begun) / done
            left = (trainer.total_steps - trainer.step_number) * per_step / 60
            _log.info(
                "step %d of %d, loss %.4f, %.3f s a step, %.0f minutes left",
                trainer.step_number, trainer.total_steps, smooth, per_step, left,
            )  # fmt: skip
        if trainer.step_number % save_every == 0 or trainer.step_number == trainer.total_steps:
            trainer.save(state, weights)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m meshdeform.priors.builtin.training.train", description=(__doc__ or "").split("\n")[0]
    )
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--steps", type=int, help="optimiser steps (default: 10000)")
    length.add_argument("--minutes", type=float, help="choose the steps so that the run takes about this long")
    parser.add_argument("--nouns", nargs="+", choices=list(FAMILIES), metavar="NOUN", help="default: all of them")
    parser.add_argument(
        "--odds",
        nargs="+",
        default=[],
        type=_odds,
        metavar="NOUN=ODDS",
        help="how often a noun is shown, relative to the others (default: 1)",
    )
    parser.add_argument("--members", type=int, default=150, help="members of each family")
    parser.add_argument("--pictures", type=int, default=4, help="grids of each member, in addition to a single view")
    parser.add_argument("--batch", type=int, help="default: 24 on a CPU, 128 on a GPU")
    parser.add_argument(
        "--learning-rate", type=float, default=TrainConfig.learning_rate, help="at the top of the cycle"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--initial", type=Path, help="weights of another edition to start from")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument(
        "--precision",
        choices=["fp32", "bf16"],
        default="bf16",
        help="precision of the forward pass",
    )
    parser.add_argument("--threads", type=int, help="CPU threads")
    parser.add_argument("--cache", type=Path, required=True, help="folder for the rendered pictures (about 4.5 GB)")
    parser.add_argument("--state", type=Path, help="file to resume a stopped run from (default: next to the cache)")
    parser.add_argument("--output", type=Path, default=WEIGHTS, help="file for the weights (default: in the package)")
    parser.add_argument("--save-every", type=int, default=500, help="steps between two writes")
    return parser.parse_args()


def _odds(text: str) -> tuple[str, float]:
    """Read NOUN=ODDS."""
    noun, _, odds = text.partition("=")
    try:
        if noun in FAMILIES and 0 <= float(odds) < math.inf:
            return noun, float(odds)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r} is not a noun, =, and a number that is not negative")


def main() -> None:
    """Draw the pictures and train."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", force=True)
    arguments = _arguments()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    nouns = arguments.nouns or list(FAMILIES)
    data = PictureFolder.cached(
        arguments.cache, nouns, arguments.members, arguments.pictures, arguments.seed, dict(arguments.odds)
    )
    batch = arguments.batch or (24 if arguments.device == "cpu" else 128)
    trainer = Trainer(
        data,
        TrainConfig(seed=arguments.seed, batch=batch, learning_rate=arguments.learning_rate),
        device=arguments.device,
        precision=arguments.precision,
        initial=arguments.initial,
    )
    state = arguments.state or arguments.cache.with_suffix(".state.pt")
    if state.is_file():
        trainer.restore(state)
        _log.info("continuing from step %d", trainer.step_number)
    elif arguments.minutes is None:
        trainer.total_steps = arguments.steps or 10_000
    parameters = sum(parameter.numel() for parameter in trainer.network.parameters())
    _log.info("%d pictures, %d parameters, batch %d, %s", len(data), parameters, batch, arguments.device)
    _fit(trainer, arguments.minutes or 0.0, state, arguments.output, arguments.save_every)


if __name__ == "__main__":
    main()
