"""Continue the training of the builtin prior on the pictures of a lesson.

The loss on held-out pictures of the new noun is measured every few steps. The best weights so far are kept, and the
training stops when they have not become better for a while. The state can be saved after any step, and a teacher that
is restored from it goes on as if it had not stopped.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from meshdeform.errors import CheckpointError
from meshdeform.priors.builtin.grammar import Words
from meshdeform.priors.builtin.network import PriorNetwork
from meshdeform.priors.builtin.teaching.lesson import STATE_MAGIC, NewNoun
from meshdeform.priors.builtin.teaching.measure import held_out_loss
from meshdeform.priors.builtin.teaching.pictures import LessonPictures
from meshdeform.priors.builtin.teaching.trainer import TrainConfig, Trainer
from meshdeform.priors.native_precision import is_fast_in_bfloat16

_WORDS = "text.word.weight"
_NOISE = 0.3
"""Standard deviation of the noise on a new word, relative to that of its kind."""
_RESTART = "Repeat the command that wrote it, or start again without it."


@dataclass(frozen=True)
class TeachConfig:
    """Settings of a lesson."""

    steps: int = 600  # most optimiser steps
    batch: int = 16
    learning_rate: float = 5e-4  # at the top of the cycle
    ema_decay: float = 0.99  # decay of the average of the weights, which is what is written
    measure_every: int = 50  # steps between two measurements of the held-out losses
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
    made = new_rows(rows[numbers], 1, torch.Generator().manual_seed(seed))
    if new.replaces:
        rows = rows.clone()
        rows[known.tokens.index(new.noun)] = made[0]
    else:
        rows = torch.cat([rows, made])
    copy.load_state_dict({**state, _WORDS: rows})
    return copy


def new_rows(peers: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """Return rows (count, width) of new words: the mean of the rows (P, width) of their kind, with a little noise."""
    noise = torch.randn(count, peers.shape[1], generator=generator)
    return peers.mean(0) + _NOISE * peers.std(0) * noise


class Teacher:
    """The training of a lesson.

    Parameters
    ----------
    network : PriorNetwork
        The result of `extended`.
    precision : "fp32" or "bf16"
    identity : str
        Names the lesson; a state of another one is refused.
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
            if self.step % self.config.measure_every == 0 or self.step == self.config.steps:
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

        Raises
        ------
        CheckpointError
            It does not fit.
        """
        try:
            self._trainer.load_state(document["trainer"])
            self.measured = [tuple(entry) for entry in document["measured"]]
            self.best_step, self._best = document["best_step"], document["best"]
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise CheckpointError(f"The saved state cannot be read: {error}", advice=_RESTART) from error


def read_state(data: bytes, identity: str, device: str) -> dict[str, Any]:
    """Read a saved state.

    Raises
    ------
    CheckpointError
        It is unreadable, or of another lesson.
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
