"""Hold the texts of score distillation: one prompt, or several with weights and groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["Texts", "WeightedPrompt"]


@dataclass(frozen=True)
class WeightedPrompt:
    """One of several prompts.

    Attributes
    ----------
    text : str
    weight : float
        Factor of its gradient.
    group : int
        Prompts of one group share a loss. Groups count from 0, in the order of their first prompts.
    """

    text: str
    weight: float = 1.0
    group: int = 0


class Texts:
    """The encoded texts of a job.

    Parameters
    ----------
    prior : Prior
    prompts : sequence of WeightedPrompt
        At least one.
    negative_prompt : str

    Attributes
    ----------
    rows : (N, ...)
        Rows for `Prior.predict_noise`: what guidance points away from, then the prompts.
    pairs : list of (int, int)
        For each prompt, its row of the first kind and its own. The builtin model reads attributes alone, such as
        "fat", as those of the prompt's object, so that two prompts may point away from different texts.

    Raises
    ------
    PromptError, ParameterError
        The prior cannot use one of the texts.
    """

    def __init__(self, prior: Prior, prompts: Sequence[WeightedPrompt], negative_prompt: str) -> None:
        self._prompts = prompts
        away: list[Tensor] = []
        texts: list[Tensor] = []
        bases = []
        for each in prompts:
            prompted, unprompted = prior.encode_texts(each.text, negative_prompt)
            known = (number for number, other in enumerate(away) if torch.equal(other, unprompted))
            base = next(known, len(away))
            if base == len(away):
                away.append(unprompted)
            texts.append(prompted)
            bases.append(base)
        self.rows = torch.stack([*away, *texts])
        self.pairs = [(base, len(away) + number) for number, base in enumerate(bases)]

    @property
    def first(self) -> Tensor:
        """The row (1, ...) of the first prompt."""
        text = self.pairs[0][1]
        return self.rows[text : text + 1]

    def grouped(self, values: Sequence[Tensor]) -> list[Tensor]:
        """Return, for each group, the sum of its prompts' values with their weights."""
        found: list[Tensor] = []
        for each, value in zip(self._prompts, values, strict=True):
            weighted = each.weight * value
            if each.group < len(found):
                found[each.group] = found[each.group] + weighted
            else:
                found.append(weighted)
        return found
