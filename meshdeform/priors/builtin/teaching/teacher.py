"""Continue the training of the builtin prior on the pictures of a lesson.

The loss on held-out pictures of the new nouns is measured every few steps. The best weights so far are kept, and the
training stops when they have not become better for a while. The state can be saved after any step, and a teacher that
is restored from it goes on as if it had not stopped.

Loss: squared error of the clean picture, weighted as in `prior.py`; timesteps stratified within a batch; the prompt
dropped with probability 0.12. AdamW, one cycle of the learning rate, gradients clipped to norm 1. The result
is the exponential moving average of the weights.

Sources: Ho & Salimans 2022 (prompt dropout); Loshchilov & Hutter 2019 (AdamW); Smith & Topin 2019 (one cycle); Kingma
et al. 2021, appendix I (stratified timesteps).

Measure the knowledge of a network: its loss on held-out pictures, and which noun it takes a picture for.

::

    noun(x) = argmin over nouns of  mean over draws of ||x0_hat(z_t; noun) - x||^2

Noise and timestep of a draw are the same for all nouns.

Source: Li et al. 2023, Your diffusion model is secretly a zero-shot classifier, eq. 9.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from meshdeform.errors import CheckpointError
from meshdeform.priors.builtin.grammar import ParsedPrompt, Words, tokenise
from meshdeform.priors.builtin.network import PriorNetwork
from meshdeform.priors.builtin.prior import NUM_TIMESTEPS, add_noise, cosine_alphas_cumprod, loss_weight
from meshdeform.priors.builtin.teaching.lesson import STATE_MAGIC, NewNoun
from meshdeform.priors.builtin.teaching.pictures import LessonPictures
from meshdeform.priors.builtin.teaching.views import PictureSet
from meshdeform.priors.precision import is_fast_in_bfloat16

_WORDS = "text.word.weight"
_NOISE = 0.3
"""Standard deviation of the noise on a new word, relative to that of its kind."""
_LEAST_BETWEEN = 50
"""Least steps between two measurements."""
_RESTART = "Repeat the command that wrote it, or start again without it."

_NOISY_FROM, _NOISY_SHARE = 0.7, 0.75
"""Score distillation uses this prior only at high noise. Uniform timesteps would spend a third of the training there,
and almost none of it where only the azimuth distinguishes front from back."""


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


@dataclass(frozen=True)
class TeachConfig:
    """Settings of a lesson."""

    steps: int = 600  # most optimiser steps
    batch: int = 16
    learning_rate: float = 5e-4  # at the top of the cycle
    ema_decay: float = 0.99  # decay of the average of the weights, which is what is written
    measurements: int = 12  # of the held-out losses, evenly spaced
    patience: int = 4  # measurements without a smaller held-out loss after which the training stops
    seed: int = 0


@dataclass(frozen=True)
class TeachStep:
    """The position of a lesson after a step; held-out losses of the new and the old nouns where they were measured."""

    step: int
    total_steps: int
    loss: float
    held_new: float | None = None
    held_old: float | None = None


def fastest_precision(device: str) -> str:
    """Return `bf16` where the processor computes in bfloat16, else `fp32`."""
    return "bf16" if is_fast_in_bfloat16(device) else "fp32"


def extended(network: PriorNetwork, known: Words, new: NewNoun, seed: int) -> PriorNetwork:
    """Return a copy of a network with a row for the new noun, near the mean of the nouns that it knows."""
    words = new.words
    copy = PriorNetwork(network.config, words=len(words.tokens))
    state = {name: tensor for name, tensor in network.state_dict().items() if name != _WORDS}
    rows = network.state_dict()[_WORDS]
    numbers = [known.tokens.index(noun) for noun in known.nouns]
    rows_new = new_rows(rows[numbers], 1, torch.Generator().manual_seed(seed))
    if new.replaces:
        rows = rows.clone()
        rows[known.tokens.index(new.noun)] = rows_new[0]
    else:
        rows = torch.cat([rows, rows_new])
    copy.load_state_dict({**state, _WORDS: rows})
    return copy


def new_rows(peers: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """Return rows (count, width) of new words: the mean of the rows (P, width) of their kind, with a little noise."""
    noise = torch.randn(count, peers.shape[1], generator=generator)
    return peers.mean(0) + _NOISE * peers.std(0) * noise


class Teacher:
    """The training of a lesson.

    `network`: the result of `extended`. `identity`: names the lesson; a state of another one is refused.
    """

    def __init__(
        self,
        network: PriorNetwork,
        pictures: LessonPictures,
        config: TeachConfig,
        *,
        device: str,
        precision: str,
        identity: str,
    ) -> None:
        self.config, self.pictures, self.identity = config, pictures, identity
        training = TrainConfig(
            seed=config.seed,
            batch=config.batch,
            learning_rate=config.learning_rate,
            ema_decay=config.ema_decay,
        )
        self._trainer = Trainer(pictures.training, training, network, device=device, precision=precision)
        self._trainer.total_steps = config.steps
        self._between = max(config.steps // config.measurements, _LEAST_BETWEEN)
        self.measured: list[tuple[int, float, float]] = []
        self.best_step = 0
        self._best: dict[str, Tensor] | None = None

    @property
    def step(self) -> int:
        """Number of steps done."""
        return self._trainer.step_number

    @property
    def stopped_early(self) -> bool:
        """Whether the held-out loss has stopped to fall before the last step."""
        return len(self.measured) - 1 - self._best_measurement() >= self.config.patience

    def _best_measurement(self) -> int:
        return min(range(len(self.measured)), key=lambda k: self.measured[k][1], default=0)

    def __iter__(self) -> Iterator[TeachStep]:
        """Run the remaining steps."""
        if not self.measured:
            self._measure()
        while self.step < self.config.steps and not self.stopped_early:
            loss = self._trainer.step()
            held: tuple[float, float] | tuple[None, None] = (None, None)
            if self.step % self._between == 0 or self.step == self.config.steps:
                held = self._measure()
            yield TeachStep(self.step, self.config.steps, loss, *held)

    def _measure(self) -> tuple[float, float]:
        network = self._averaged(self._trainer.average)
        new, old = (held_out_loss(network, held) for held in (self.pictures.held_new, self.pictures.held_old))
        self.measured.append((self.step, new, old))
        if self._best_measurement() == len(self.measured) - 1:
            self.best_step = self.step
            self._best = {name: tensor.detach().clone() for name, tensor in self._trainer.average.items()}
        return new, old

    def _averaged(self, state: dict[str, Tensor]) -> PriorNetwork:
        trained = self._trainer.network
        network = PriorNetwork(trained.config, words=trained.text.word.num_embeddings)
        network.load_state_dict(state)
        network.eval().requires_grad_(requires_grad=False)
        placed: PriorNetwork = network.to(self._trainer.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        return placed

    def network(self) -> PriorNetwork:
        """Return the average of the weights at the step with the smallest held-out loss, for inference."""
        return self._averaged(self._trainer.average if self._best is None else self._best)

    def state(self) -> bytes:
        """Return the complete state; call only between two steps."""
        document: dict[str, Any] = {
            "identity": self.identity,
            "trainer": self._trainer.state(),
            "measured": self.measured,
            "best_step": self.best_step,
            "best": self._best,
        }
        buffer = io.BytesIO()
        torch.save(document, buffer)
        return STATE_MAGIC + buffer.getvalue()

    def restore(self, document: dict[str, Any]) -> None:
        """Go on from what `read_state` returned for this lesson.

        Raises CheckpointError: it does not fit.
        """
        try:
            self._trainer.load_state(document["trainer"])
            self.measured = [tuple(entry) for entry in document["measured"]]
            self.best_step, self._best = document["best_step"], document["best"]
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise CheckpointError(f"The saved state cannot be read: {error}", advice=_RESTART) from error


def read_state(data: bytes, identity: str, device: str) -> dict[str, Any]:
    """Read a saved state.

    Raises CheckpointError: it is unreadable, or of another lesson.
    """
    try:
        content = io.BytesIO(data.removeprefix(STATE_MAGIC))
        document: dict[str, Any] = torch.load(content, map_location=device, weights_only=True)
        mine = document["identity"] == identity
    except Exception as error:  # torch.load raises anything for a damaged file
        raise CheckpointError(f"The saved state cannot be read: {error}", advice=_RESTART) from error
    if not mine:
        raise CheckpointError(
            "The saved state is of another lesson: other meshes, words, steps, seed or weights.", advice=_RESTART
        )
    return document


_LOSS_FRACTIONS = (0.35, 0.6, 0.8, 0.93)
_CLASS_FRACTIONS = (0.86,)
"""Timesteps of the draws, as fractions of T. At lower noise every noun predicts the picture that is still visible."""
_BATCH = 24


@torch.no_grad()
def held_out_loss(network: PriorNetwork, pictures: PictureSet) -> float:
    """Return the loss of the training on held-out pictures, with fixed noise at four timesteps."""
    device = network.place.device
    levels = cosine_alphas_cumprod().to(device)
    generator = torch.Generator().manual_seed(0)
    total, count = 0.0, 0
    for rows in torch.split(torch.arange(len(pictures)), _BATCH):
        clean = pictures.images[rows].to(device).float() / 127.5 - 1.0
        text = network.text(pictures.tokens[rows].to(device))
        for fraction in _LOSS_FRACTIONS:
            timestep = torch.full((len(rows),), round(fraction * (NUM_TIMESTEPS - 1)), device=device)
            noise = torch.randn(clean.shape, generator=generator).to(device)
            noisy = add_noise(clean, noise, timestep, levels).contiguous(memory_format=torch.channels_last)
            azimuth, single = pictures.azimuth_deg[rows].to(device), pictures.single[rows].to(device)
            error = (network(noisy, timestep, text, azimuth, single) - clean).square()
            total += float((loss_weight(timestep, levels) * error).mean()) * len(rows)
            count += len(rows)
    return total / count


@torch.no_grad()
def retrieved(
    network: PriorNetwork,
    words: Words,
    pictures: PictureSet,
    candidates: Sequence[str],
) -> list[str]:
    """Return the noun that the network takes each picture for.

    `pictures`: their labels are not used, except the azimuths.
    """
    device = network.place.device
    levels = cosine_alphas_cumprod().to(device)
    generator = torch.Generator().manual_seed(0)
    tokens = torch.tensor([tokenise(ParsedPrompt(noun), words) for noun in candidates], device=device)
    texts = network.text(tokens)
    nouns = []
    for row in range(len(pictures)):
        clean = pictures.images[row : row + 1].to(device).float() / 127.5 - 1.0
        errors = torch.zeros(len(candidates), device=device)
        for fraction in _CLASS_FRACTIONS:
            timestep = torch.full((1,), round(fraction * (NUM_TIMESTEPS - 1)), device=device)
            noise = torch.randn(clean.shape, generator=generator).to(device)
            noisy = add_noise(clean, noise, timestep, levels)
            for some in torch.split(torch.arange(len(candidates), device=device), _BATCH):
                inputs = noisy.expand(len(some), -1, -1, -1).contiguous(memory_format=torch.channels_last)
                azimuth = pictures.azimuth_deg[row].to(device).expand(len(some))
                single = pictures.single[row].to(device).expand(len(some))
                predicted = network(inputs, timestep.expand(len(some)), texts[some], azimuth, single)
                errors[some] += (predicted - clean).square().mean((1, 2, 3))
        nouns.append(candidates[int(errors.argmin())])
    return nouns


def interval(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    z = 1.96
    share = hits / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return max(0.0, middle - half), min(1.0, middle + half)
