"""Train the judge: ``python -m training.judge.train --cache VIEWS --collections SCAN --assets FOLDER --threads 1``.

The loss of a batch of M meshes with four views each is the mean of two cross entropies: of the noun from a single view,
and from the mean over the views. The logarithm of how many meshes show a noun is added to its logit, so that frequent
nouns are not favoured. For shapes that are no noun, the target is uniform. The sharpness is fitted on the real assets
of bench/keep/assets.json that may be tuned on.

The weights that ship came of four runs, .26 CPU seconds a step: of the 282 assets that docs/judge.md names, 43 % were
found after 2,800 steps, 51 % after 6,950. Two of the packs of `training/collections/sources.py` could not be had.

    python -m training.collections.scan COLLECTIONS -o scan --leave-out ASSETS
    ... --cache views --assets FILES --others 24 --reals 0 --steps 500 --threads 1 --output first.safetensors
    ... --cache views --collections scan --assets FILES --others 24 --reals 36 --threads 1 and, in turn,
        --steps 2300 --seed 1 --initial first.safetensors --output second.safetensors
        --steps 1150 --seed 2 --initial second.safetensors --output third.safetensors
        --steps 3000 --seed 3 --initial third.safetensors

The weights are an exponential moving average (0.995). `ASSETS` are those that results are measured on, left out by
their shape: of bench/keep, bench/parts, bench/recognition.json and bench/nouns.

Sources: Menon et al. 2021 (logit adjustment), Hendrycks et al. 2019 (outlier exposure with the uniform distribution),
Guo et al. 2017 (temperature scaling on held-out examples).
"""

from __future__ import annotations

import argparse
import json
import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional

from meshdeform.judge.network import WEIGHTS, JudgeConfig
from meshdeform.priors.builtin.vocabulary import NOUNS as FIRST_NOUNS
from meshdeform.vocabulary.nouns import NOUNS
from training.collections.count import packs_of_nouns
from training.collections.members import RealShapes
from training.collections.sources import JUDGE, PRIOR
from training.judge.assets import TUNED, listed, views_of_assets
from training.judge.augment import augmented
from training.judge.members import ViewSet, counts_of
from training.judge.network import JudgeNetwork, read_judge

_log = logging.getLogger(__name__)
_KEPT_EVERY = 250
"""Steps after which the weights are written, in case that the run is stopped."""


@dataclass(frozen=True)
class TrainConfig:
    """Settings of a run; the defaults are those of the shipped weights."""

    steps: int = 2400
    batch: int = 48
    learning_rate: float = 2.5e-3
    weight_decay: float = 2e-2
    ema_decay: float = 0.995
    seed: int = 0


class Trainer:
    """Training run on the CPU: network, optimiser, running average and position in the data."""

    def __init__(self, data: ViewSet, config: TrainConfig) -> None:
        torch.manual_seed(config.seed)
        self.data, self.config = data, config
        self.generator = torch.Generator().manual_seed(config.seed)
        self.network = JudgeNetwork(JudgeConfig(tuple(NOUNS))).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        decayed = [p for p in self.network.parameters() if p.ndim > 1]
        plain = [p for p in self.network.parameters() if p.ndim <= 1]
        groups = [{"params": decayed, "weight_decay": config.weight_decay}, {"params": plain, "weight_decay": 0.0}]
        self.optimiser = torch.optim.AdamW(groups, lr=config.learning_rate)
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser, config.learning_rate, total_steps=config.steps, pct_start=0.15
        )
        self.average = {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}
        shown = torch.bincount(data.noun[data.noun >= 0], minlength=len(NOUNS))
        self.offered = shown.clamp_min(1).log()
        self.order = torch.empty(0, dtype=torch.int64)
        self.done = 0

    def start_from(self, network: JudgeNetwork) -> None:
        """Continue another run."""
        self.network.load_state_dict(network.state_dict())
        self.average = {name: tensor.clone() for name, tensor in network.state_dict().items()}

    def _next_rows(self) -> Tensor:
        if len(self.order) < self.config.batch:
            self.order = torch.randperm(len(self.data), generator=self.generator)
        rows, self.order = self.order[: self.config.batch], self.order[self.config.batch :]
        return rows

    def step(self) -> Tensor:
        """Run one optimiser step; return the losses of single views and of the mean over the views."""
        self.network.train()
        data = self.data.rows(self._next_rows())
        views = data.images.shape[1]
        images = augmented(data.images.flatten(0, 1)[:, None].float() / 255.0, self.generator)
        with torch.autocast("cpu", torch.bfloat16):
            logits = self.network(images.contiguous(memory_format=torch.channels_last))
        # Views of one mesh agree in part: four tell about twice as much as one.
        pooled = logits.view(-1, views, len(NOUNS)).mean(1) * 2.0
        target = targets(data.noun, torch.softmax(self.offered, 0))
        losses = torch.stack(
            [
                functional.cross_entropy(logits + self.offered, target.repeat_interleave(views, 0)),
                functional.cross_entropy(pooled + self.offered, target),
            ]
        )
        self.optimiser.zero_grad()
        losses.mean().backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimiser.step()
        self.schedule.step()
        self.done += 1
        self._update_average()
        return losses.detach()

    def _update_average(self) -> None:
        decay = min(self.config.ema_decay, self.done / (self.done + 10))
        for name, tensor in self.network.state_dict().items():
            if tensor.is_floating_point():
                self.average[name].lerp_(tensor, 1.0 - decay)

    def averaged(self) -> JudgeNetwork:
        """Return the network with the running average of all steps, for inference."""
        network = JudgeNetwork(self.network.config)
        network.load_state_dict(self.average)
        return network.eval()


def targets(noun: Tensor, unknown: Tensor) -> Tensor:
    """Return the distribution (M, N) that each mesh should get: its noun (M,), or `unknown` (N,) where that is -1."""
    certain = functional.one_hot(noun.clamp_min(0), len(NOUNS)).float()
    return torch.where((noun >= 0)[:, None], certain, unknown)


def commonness(nouns: Sequence[str]) -> Tensor:
    """Return how much likelier each noun is of somebody's asset (N,), as a logarithm.

    Half the logarithm of how many packs of public collections have it, and 1 for the nouns that came first, because
    people asked for them first.
    """
    packs = packs_of_nouns()
    of_packs = torch.tensor([float(packs.get(noun, 1)) for noun in nouns]).log()
    return 0.5 * of_packs + torch.tensor([float(noun in FIRST_NOUNS) for noun in nouns])


@torch.no_grad()
def calibrate(network: JudgeNetwork, view_set: ViewSet) -> None:
    """Set the sharpness of the mean over the views that gives the least cross entropy, over a fine grid."""
    logits = network(view_set.images.flatten(0, 1)[:, None].float() / 255.0)
    mean = logits.view(*view_set.images.shape[:2], -1).mean(1)
    sharpness = torch.logspace(-1.0, 1.0, 101)
    tried = [functional.cross_entropy(each * mean, view_set.noun) for each in sharpness]
    network.sharpness.copy_(sharpness[torch.stack(tried).argmin()])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m training.judge.train", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--cache", type=Path, required=True, help="folder for the rendered views")
    parser.add_argument("--assets", type=Path, required=True, help="has the files of bench/keep/assets.json")
    parser.add_argument("--collections", type=Path, help="what training.collections.scan wrote")
    parser.add_argument("--steps", type=int, default=TrainConfig.steps)
    parser.add_argument("--nouns", nargs="+", choices=list(NOUNS), default=list(NOUNS), help="nouns to learn")
    parser.add_argument("--others", type=int, default=40, help="members of each noun by the judge's own code")
    parser.add_argument("--reals", type=int, default=60, help="most members of each noun from collections")
    parser.add_argument("--nothings", type=int, default=400, help="shapes that are no noun")
    parser.add_argument("--initial", type=Path, help="weights to go on with")
    parser.add_argument("--seed", type=int, default=0, help="seed of the training; the seeds of the members are fixed")
    parser.add_argument("--threads", type=int, help="CPU threads")
    parser.add_argument("--output", type=Path, default=WEIGHTS, help="file for the weights (default: in the package)")
    return parser.parse_args()


def write_judge(path: Path, network: JudgeNetwork, provenance: Mapping[str, str]) -> None:
    """Write the network as float16, atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {**provenance, "config": json.dumps(asdict(network.config))}
    state = {
        name: tensor.detach().to(torch.float16).contiguous()
        for name, tensor in network.state_dict().items()
        if not name.endswith("num_batches_tracked")
    }
    part = path.with_suffix(".part")
    save_file(state, part, metadata)
    part.chmod(0o644)
    part.replace(path)


def main() -> None:
    """Draw the views, train, calibrate and write the weights, also on the way."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", force=True)
    arguments = _arguments()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    tuned = views_of_assets(arguments.assets, listed()[TUNED])
    real = RealShapes(arguments.collections, PRIOR, JUDGE) if arguments.collections else None
    counts = counts_of(arguments.nouns, arguments.others, arguments.reals, arguments.nothings, real)
    data = ViewSet.cached(arguments.cache, counts, real)
    trainer = Trainer(data, TrainConfig(steps=arguments.steps, seed=arguments.seed))
    before = 0
    if arguments.initial:
        network, metadata = read_judge(arguments.initial)
        trainer.start_from(network)
        before = int(metadata["steps"])
    begun, smooth = time.monotonic(), torch.zeros(2)
    while trainer.done < arguments.steps:
        losses = trainer.step()
        smooth = losses if trainer.done == 1 else 0.97 * smooth + 0.03 * losses
        if trainer.done % 50 == 0:
            named = "one view {:.3f}, four views {:.3f}".format(*smooth.tolist())
            per_step = (time.monotonic() - begun) / trainer.done
            _log.info("step %d of %d, %s, %.3f s a step", trainer.done, arguments.steps, named, per_step)
        if trainer.done % _KEPT_EVERY == 0 or trainer.done == arguments.steps:
            network = trainer.averaged()
            calibrate(network, tuned)
            network.commonness.copy_(commonness(network.config.nouns))
            provenance = {"steps": before + trainer.done, "seed": arguments.seed, "meshes": len(data)}
            write_judge(arguments.output, network, {name: str(value) for name, value in provenance.items()})
            _log.info("wrote weights of sharpness %.2f", float(network.sharpness))


if __name__ == "__main__":
    main()
