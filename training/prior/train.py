"""Train the builtin prior: `python -m training.prior.train`.

Data: members of the families, drawn by `dataset.py` from `--seed`; the loss and the optimiser are those of
`trainer.py`. A stopped run continues from `--state`; a run with `--initial` starts from
the weights of another edition, whose vocabulary may be smaller (`warm_start.py`).
"""

from __future__ import annotations

import argparse
import logging
import math
import time
from pathlib import Path

import torch

from meshdeform.priors.builtin.network import WEIGHTS, PriorNetwork, write_weights
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.support.files import file_sha256
from meshdeform.support.memory import keep_freed_memory
from training.collections.members import RealShapes
from training.collections.sources import PRIOR
from training.prior.dataset import PictureFolder
from training.prior.trainer import Pictures, TrainConfig, Trainer
from training.prior.warm_start import warm_start

_log = logging.getLogger(__name__)


class PriorTrainer(Trainer):
    """The training of a whole prior, whose network starts anew or from `initial`; written to files."""

    def __init__(
        self, data: Pictures, config: TrainConfig, *, device: str, precision: str, initial: Path | None = None
    ) -> None:
        torch.manual_seed(config.seed)
        network = PriorNetwork()
        super().__init__(data, config, network, device=device, precision=precision)
        if initial:
            new = warm_start(self.network, initial, torch.Generator().manual_seed(config.seed))
            self.average = {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}
            self.provenance["initial"] = file_sha256(initial)
            _log.info("started from %s, without %s", initial, ", ".join(new) or "exception")

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

    def restore(self, state: Path) -> None:
        """Restore the state that `save` wrote."""
        self.load_state(torch.load(state, map_location=self.device, weights_only=True))


def _fit(trainer: PriorTrainer, state: Path, weights: Path, save_every: int) -> None:
    """Run the trainer to its end."""
    keep_freed_memory()
    begun, smooth = time.monotonic(), 0.0
    first = trainer.step_number
    while trainer.step_number < trainer.total_steps:
        loss = trainer.step()
        done = trainer.step_number - first
        smooth = loss if done == 1 else 0.98 * smooth + 0.02 * loss
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
    parser = argparse.ArgumentParser(prog="python -m training.prior.train", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--steps", type=int, default=10_000, help="optimiser steps")
    parser.add_argument("--nouns", nargs="+", choices=list(NOUNS), metavar="NOUN", help="default: all of them")
    parser.add_argument(
        "--odds",
        nargs="+",
        default=[],
        type=_odds,
        metavar="NOUN=ODDS",
        help="how often a noun is shown, relative to the others (default: 1)",
    )
    parser.add_argument("--members", type=int, default=150, help="members of each noun")
    parser.add_argument("--collections", type=Path, help="what training.collections.scan wrote")
    parser.add_argument("--pictures", type=int, default=4, help="grids of each member, in addition to a single view")
    parser.add_argument("--batch", type=int, help="default: 24 on a CPU, 128 on a GPU")
    parser.add_argument(
        "--learning-rate", type=float, default=TrainConfig.learning_rate, help="at the top of the cycle"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--initial", type=Path, help="weights of another edition to start from")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--precision", choices=["fp32", "bf16"], default="bf16", help="precision of the forward pass")
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
        if noun in NOUNS and 0 <= float(odds) < math.inf:
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
    nouns = arguments.nouns or list(NOUNS)
    data = PictureFolder.cached(
        arguments.cache,
        nouns,
        arguments.members,
        arguments.pictures,
        arguments.seed,
        dict(arguments.odds),
        RealShapes(arguments.collections, PRIOR) if arguments.collections else None,
    )
    batch = arguments.batch or (24 if arguments.device == "cpu" else 128)
    trainer = PriorTrainer(
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
    else:
        trainer.total_steps = arguments.steps
    parameters = sum(parameter.numel() for parameter in trainer.network.parameters())
    _log.info("%d pictures, %d parameters, batch %d, %s", len(data), parameters, batch, arguments.device)
    _fit(trainer, state, arguments.output, arguments.save_every)


if __name__ == "__main__":
    main()
