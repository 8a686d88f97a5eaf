"""Train the judge: ``python -m training.judge.train --cache views --threads 1``.

The loss of a batch of M meshes with four views each is the mean of three cross entropies: of the mesh's prompt among
candidates from a single view, of the same from the mean over the views, and of the noun from a single view.
Candidates are the prompts of the batch and others about the same nouns. Each occurs once, with the logarithm of its
frequency added to its score, so that the score itself learns log p(view | prompt) and not the posterior, which favours
frequent prompts. For shapes that are no noun, the target distribution is the frequency of the prompts. Members by the
judge's own code are not compared with other prompts about their noun, whose truth is not known.

Sources: van den Oord et al. 2018 (InfoNCE), Menon et al. 2021 (logit adjustment), Hendrycks et al. 2019 (outlier
exposure with the uniform distribution), Guo et al. 2017 (temperature scaling on held-out examples).
"""

from __future__ import annotations

import argparse
import json
import logging
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.nn import functional

from meshdeform.judge.scoring import WEIGHTS, JudgeNetwork, Prompts, vocabulary_hash
from meshdeform.priors.builtin.vocabulary import NOUNS
from training.collections.members import RealShapes
from training.collections.sources import JUDGE
from training.judge.augment import augmented
from training.judge.members import CALIBRATION, ViewSet, counts_of

_log = logging.getLogger(__name__)

_OTHERS = 6
"""Further candidates per mesh: prompts of other meshes of the same noun."""


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
        self.network = JudgeNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        decayed = [p for p in self.network.parameters() if p.ndim > 1]
        plain = [p for p in self.network.parameters() if p.ndim <= 1]
        groups = [{"params": decayed, "weight_decay": config.weight_decay}, {"params": plain, "weight_decay": 0.0}]
        self.optimiser = torch.optim.AdamW(groups, lr=config.learning_rate)
        self.schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser, config.learning_rate, total_steps=config.steps, pct_start=0.15
        )
        self.average = {name: tensor.detach().clone() for name, tensor in self.network.state_dict().items()}
        labels, self.prompt = torch.unique(
            torch.cat([data.noun[:, None], data.attributes.long()], 1), dim=0, return_inverse=True
        )
        self.prompts = Prompts(labels[:, 0], labels[:, 1:].float())
        self.rows_of = [(data.noun == noun).nonzero()[:, 0] for noun in range(len(NOUNS))]
        self.order = torch.empty(0, dtype=torch.int64)
        self.done = 0

    def _next_rows(self) -> Tensor:
        if len(self.order) < self.config.batch:
            self.order = torch.randperm(len(self.data), generator=self.generator)
        rows, self.order = self.order[: self.config.batch], self.order[self.config.batch :]
        return rows

    def _candidates(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return the numbers of the batch's prompts and of others about its nouns, and their frequencies."""
        shown = rows[self.data.noun[rows] >= 0]
        prompts = [self.prompt[shown]]
        for noun in self.data.noun[shown].tolist():
            pool = self.rows_of[noun]
            prompts.append(self.prompt[pool[torch.randint(len(pool), (_OTHERS,), generator=self.generator)]])
        number, count = torch.unique(torch.cat(prompts), return_counts=True)
        return number, count

    def step(self) -> Tensor:
        """Run one optimiser step; return the three losses."""
        self.network.train()
        rows = self._next_rows()
        number, count = self._candidates(rows)
        views = self.data.images.shape[1]
        images = augmented(self.data.images[rows].flatten(0, 1)[:, None].float() / 255.0, self.generator)
        with torch.autocast("cpu", torch.bfloat16):
            noun_logits, features = self.network.encode_views(images.contiguous(memory_format=torch.channels_last))
        candidates = Prompts(self.prompts.noun[number], self.prompts.attributes[number])
        scores = self.network.scores(noun_logits, features, candidates)
        scores = scores - _unknown(self.data, rows, candidates).repeat_interleave(views, 0)
        pooled = scores.view(-1, views, len(number)).mean(1) * 2.0
        shown = self.data.noun[rows] >= 0
        # One-hot for the prompt; for a shape that is no noun, the frequencies of the candidates.
        target = functional.one_hot(
            torch.searchsorted(number, self.prompt[rows]).clamp_max(len(number) - 1), len(number)
        )
        target = torch.where(shown[:, None], target.float(), count / count.sum())
        noun_target = functional.one_hot(self.data.noun[rows].clamp_min(0), len(NOUNS)).float()
        noun_target = torch.where(shown[:, None], noun_target, 1.0 / len(NOUNS))
        offered = count.log()
        losses = torch.stack(
            [
                functional.cross_entropy(scores + offered, target.repeat_interleave(views, 0)),
                functional.cross_entropy(pooled + offered, target),
                functional.cross_entropy(noun_logits, noun_target.repeat_interleave(views, 0)),
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


@torch.no_grad()
def calibrate(network: JudgeNetwork, view_set: ViewSet) -> None:
    """Set the sharpness of the mean over the eight views, so that probabilities are calibrated.

    Minimises the cross entropy over a fine grid, of the noun among the nouns and of the prompt among all prompts of
    the set. For shapes that are no noun, the target is uniform, which prevents overconfidence.
    """
    count, views = view_set.images.shape[:2]
    shown = view_set.noun >= 0
    noun_logits, features = network.encode_views(view_set.images.flatten(0, 1)[:, None].float() / 255.0)
    labels = torch.cat([view_set.noun[:, None], view_set.attributes.long()], 1)
    labels, of_label = torch.unique(labels[shown], dim=0, return_inverse=True)
    candidates = Prompts(labels[:, 0], labels[:, 1:].float())
    scores = network.scores(noun_logits, features, candidates)
    unknown = _unknown(view_set, torch.arange(count), candidates)
    sharpness = torch.logspace(-1.0, 1.0, 101)

    def best(logits: Tensor, right: Tensor, penalty: Tensor) -> Tensor:
        mean = logits.view(count, views, -1).mean(1)
        target = torch.full_like(mean, 1.0 / mean.shape[1])
        target[shown] = functional.one_hot(right, mean.shape[1]).float()
        tried = [functional.cross_entropy(s * mean - penalty, target) for s in sharpness]
        return sharpness[torch.stack(tried).argmin()]

    network.noun_sharpness.copy_(best(noun_logits, view_set.noun[shown], torch.zeros(())))
    network.prompt_sharpness.copy_(best(scores, of_label, unknown))


def _unknown(data: ViewSet, rows: Tensor, candidates: Prompts) -> Tensor:
    """Return a penalty (rows, P) that takes prompts out of the comparison whose truth is not known.

    Members by the judge's own code are compared with prompts of other nouns only. They vary as kinds do: one without
    attributes may well be true of "a deer with long horns", or of "a tall deer".
    """
    same = candidates.noun[None] == data.noun[rows][:, None]
    own = (candidates.attributes[None] == data.attributes[rows][:, None].float()).all(2)
    return 1e4 * (data.other[rows][:, None] & same & ~own).float()


def _start_from(trainer: Trainer, path: Path) -> None:
    """Copy from a file of weights what has the same shape: all but the nouns' own rows, if the vocabulary grew."""
    state = trainer.network.state_dict()
    for name, tensor in load_file(path).items():
        if name in state and state[name].shape == tensor.shape and not name.endswith("sharpness"):
            state[name].copy_(tensor)
            trainer.average[name].copy_(tensor)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m training.judge.train", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--cache", type=Path, required=True, help="folder for the rendered views (about 520 MB)")
    parser.add_argument("--steps", type=int, default=TrainConfig.steps)
    parser.add_argument("--nouns", nargs="+", choices=list(NOUNS), default=list(NOUNS), help="nouns to learn")
    parser.add_argument("--members", type=int, default=170, help="members of each family")
    parser.add_argument("--others", type=int, default=80, help="members of each noun by the judge's own code")
    parser.add_argument("--nothings", type=int, default=500, help="shapes that are no noun")
    parser.add_argument("--collections", type=Path, help="what training.collections.scan wrote")
    parser.add_argument("--calibration", type=int, default=3, help="further members of each kind, for calibration")
    parser.add_argument("--initial", type=Path, help="weights to start from, possibly for another vocabulary")
    parser.add_argument("--seed", type=int, default=0, help="seed of the training; the seeds of the members are fixed")
    parser.add_argument("--threads", type=int, help="CPU threads")
    parser.add_argument("--output", type=Path, default=WEIGHTS, help="file for the weights (default: in the package)")
    return parser.parse_args()


def write_judge(path: Path, network: JudgeNetwork, provenance: Mapping[str, str]) -> None:
    """Write the network as float16, atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {**provenance, "config": json.dumps(asdict(network.config)), "vocabulary": vocabulary_hash()}
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
    """Draw the views, train, calibrate and write the weights."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", force=True)
    arguments = _arguments()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    real = RealShapes(arguments.collections, JUDGE) if arguments.collections else None
    counts = counts_of(arguments.nouns, arguments.members, arguments.others, arguments.nothings, real)
    data = ViewSet.cached(arguments.cache, counts, real)
    trainer = Trainer(data, TrainConfig(steps=arguments.steps, seed=arguments.seed))
    if arguments.initial:
        _start_from(trainer, arguments.initial)
    begun, smooth = time.monotonic(), torch.zeros(3)
    while trainer.done < arguments.steps:
        losses = trainer.step()
        smooth = losses if trainer.done == 1 else 0.97 * smooth + 0.03 * losses
        if trainer.done % 50 == 0:
            named = "prompt {:.3f}, prompt of four views {:.3f}, noun {:.3f}".format(*smooth.tolist())
            per_step = (time.monotonic() - begun) / trainer.done
            _log.info("step %d of %d, %s, %.3f s a step", trainer.done, arguments.steps, named, per_step)
    network = trainer.averaged()
    # As in training, one shape that is no noun per sixty others.
    nothings = len(arguments.nouns) * arguments.calibration // 30
    each = arguments.calibration
    calibrate(network, ViewSet.of_all(CALIBRATION, counts_of(arguments.nouns, each, each, nothings, real), real))
    provenance = {"steps": trainer.done, "seed": arguments.seed, "members": arguments.members,
                  "others": arguments.others, "meshes": len(data)}  # fmt: skip
    write_judge(arguments.output, network, {name: str(value) for name, value in provenance.items()})
    _log.info(
        "sharpness of nouns %.2f, of prompts %.2f", float(network.noun_sharpness), float(network.prompt_sharpness)
    )


if __name__ == "__main__":
    main()
