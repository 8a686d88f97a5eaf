"""Distil the guidance of the builtin prior: `python -m meshdeform.priors.builtin.training.distil`.

A step of score distillation asks the prior twice: with the prompt and without. A student that begins as a copy of the
prior, the teacher, learns to predict the guided clean picture in one pass, for one scale s and one rescaling phi::

    u, c   = x0_hat(z_t; nothing), x0_hat(z_t; prompt)      of the teacher
    g      = u + s (c - u)
    target = g (phi std(c) / std(g) + 1 - phi)

Many prompts are those of another picture, because a step shows the prior a shape that is not yet what the prompt says.
The encoder of texts is not trained, so both networks read the same rows.

Sources: Meng et al. 2023, On distillation of guided diffusion models, section 3.1 (the first stage, here for one
scale); `guidance/sds.py` (rescaling).
"""

from __future__ import annotations

import argparse
import copy
import logging
from pathlib import Path

import torch
from torch import Tensor

from meshdeform.priors.builtin.network import null_tokens
from meshdeform.priors.builtin.training.dataset import PictureFolder, PictureSet
from meshdeform.priors.builtin.training.families import FAMILIES
from meshdeform.priors.builtin.training.train import TrainConfig, Trainer, fit
from meshdeform.priors.builtin.weights_file import GUIDED, WEIGHTS, file_sha256, read_network
from meshdeform.requests.presets import OVERRIDES

__all__ = ["Distillation", "guided_clean", "main"]

_OTHER_PROMPTS = 0.6
"""Share of the pictures with the prompt of another picture."""


def guided_clean(prompted: Tensor, unprompted: Tensor, scale: float, rescale: float) -> Tensor:
    """Guide predictions of the clean picture, (B, C, H, W) float32, as the module's docstring says."""
    guided = unprompted + scale * (prompted - unprompted)
    spread, wanted = guided.std((1, 2, 3), keepdim=True), prompted.std((1, 2, 3), keepdim=True)
    return guided * (rescale * wanted / spread.clamp_min(1e-8) + 1 - rescale)


class Distillation(Trainer):
    """Training state of a student, which begins as a copy of the teacher in `teacher`."""

    def __init__(
        self,
        data: PictureSet | PictureFolder,
        config: TrainConfig,
        *,
        teacher: Path,
        scale: float,
        rescale: float,
        device: str,
        precision: str,
    ) -> None:
        network, _ = read_network(teacher)
        student = copy.deepcopy(network).requires_grad_(requires_grad=True)
        student.text.requires_grad_(requires_grad=False)
        super().__init__(data, config, device=device, precision=precision, network=student)
        self.teacher = network.to(self.device)
        self.scale, self.rescale = scale, rescale
        self.provenance |= {
            "guidance_scale": repr(scale),
            "guidance_rescale": repr(rescale),
            "teacher": file_sha256(teacher),
        }

    def batch(self) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Draw noisy pictures, timesteps, tokens, azimuths, single-view flags and the teacher's guided pictures."""
        noisy, timestep, tokens, azimuth_deg, single, _ = super().batch()
        count = len(tokens)
        other = self.data.sample(count, self.generator).tokens.to(self.device)
        swapped = torch.rand(count, generator=self.generator) < _OTHER_PROMPTS
        tokens = torch.where(swapped[:, None].to(self.device), other, tokens)
        both = torch.cat([tokens, null_tokens(count).to(self.device)])
        with torch.no_grad():
            inputs = noisy.repeat(2, 1, 1, 1).contiguous(memory_format=torch.channels_last)
            texts = self.teacher.text(both)
            clean = self.teacher(inputs, timestep.repeat(2), texts, azimuth_deg.repeat(2), single.repeat(2))
            prompted, unprompted = clean.chunk(2)
        return (
            noisy,
            timestep,
            tokens,
            azimuth_deg,
            single,
            guided_clean(prompted, unprompted, self.scale, self.rescale),
        )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m meshdeform.priors.builtin.training.distil", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--steps", type=int, default=1500, help="optimiser steps")
    parser.add_argument("--members", type=int, default=32, help="members of each family")
    parser.add_argument("--pictures", type=int, default=3, help="grids of each member, in addition to a single view")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="at the top of the cycle")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--teacher", type=Path, default=WEIGHTS, help="default: the package's weights")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--precision", choices=["fp32", "bf16"], default="fp32", help="precision of the forward pass")
    parser.add_argument("--threads", type=int, help="CPU threads")
    parser.add_argument("--cache", type=Path, required=True, help="folder for the rendered pictures (about 0.8 GB)")
    parser.add_argument("--state", type=Path, help="file to resume a stopped run from (default: next to the cache)")
    parser.add_argument("--output", type=Path, default=GUIDED, help="file for the weights (default: in the package)")
    parser.add_argument("--save-every", type=int, default=500, help="steps between two writes")
    return parser.parse_args()


def main() -> None:
    """Draw the pictures and distil."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", force=True)
    arguments = _arguments()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    data = PictureFolder.cached(arguments.cache, list(FAMILIES), arguments.members, arguments.pictures, arguments.seed)
    preset = OVERRIDES["builtin", "balanced"]
    config = TrainConfig(
        seed=arguments.seed,
        batch=arguments.batch,
        learning_rate=arguments.learning_rate,
        text_dropout=0.0,
        ema_decay=0.997,
    )
    trainer = Distillation(
        data,
        config,
        teacher=arguments.teacher,
        scale=preset["guidance_scale"],
        rescale=preset["guidance_rescale"],
        device=arguments.device,
        precision=arguments.precision,
    )
    state = arguments.state or arguments.cache.with_suffix(".distil.pt")
    trainer.total_steps = arguments.steps
    if state.is_file():
        trainer.restore(state)
    fit(trainer, 0.0, state, arguments.output, arguments.save_every)


if __name__ == "__main__":
    main()
