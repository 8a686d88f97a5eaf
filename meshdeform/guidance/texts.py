"""What the prior is told: the texts of a job, encoded once, and which of them each picture gets at each step.

Every step asks for the prediction of a base, of the prompt, and of whatever is to be kept away from::

    negative          base              prompt          kept away from, with weights
    `unconditional`   negative prompt   prompt          -
    `perpendicular`   nothing           prompt          negative prompt (w); with view prompts, two other views
    (nfsd)            nothing           prompt          bad pictures (its own use of them)

With view prompts, which are for pictures of one view each, the prompt is followed by where its camera stands:
", front view" within 45 degrees of azimuth 0, ", back view" within 45 of 180, ", side view" between them and
", overhead view" from 60 degrees of elevation. With `perpendicular` the texts are interpolated instead, and the views
that a camera is not at are kept away from, by the published weights, so that not every side grows a face::

    |azimuth| < 90, r = 1 - |azimuth| / 90     r front + (1 - r) side    not front: 4 exp(-r / 2) - 2.426
                                                                         not side:  4 exp((r - 1) / 2) - 2.426
    else            r = 2 - |azimuth| / 90     r side + (1 - r) back     not side:  exp(-r / 2) - 0.606
                                                                         not front: exp(-r / 2) + 0.967

Sources: Poole et al. 2023, DreamFusion, section 3.2 (view-dependent prompts); Armandpour et al. 2023, Re-imagine the
negative prompt algorithm (perp-neg, its interpolation between views and the weights of its public code).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import Distillation, NegativePrompt

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior
    from meshdeform.rendering.cameras import Cameras

__all__ = ["VIEWS", "Texts", "Told", "view_name"]

VIEWS = ("front view", "side view", "back view", "overhead view")
_FRONT, _SIDE, _BACK, _OVERHEAD = range(4)
_SECTOR_DEG = 45.0
_OVERHEAD_DEG = 60.0


def view_name(azimuth_deg: float, elevation_deg: float) -> str:
    """Which of `VIEWS` a camera sees; azimuth 0 looks at the front."""
    if elevation_deg >= _OVERHEAD_DEG:
        return VIEWS[_OVERHEAD]
    turned = _turned(azimuth_deg)
    return VIEWS[_FRONT if turned < _SECTOR_DEG else _BACK if turned > 180 - _SECTOR_DEG else _SIDE]


def _turned(azimuth_deg: float) -> float:
    """How far a camera stands from the front, 0 .. 180 degrees."""
    return abs((azimuth_deg + 180) % 360 - 180)


@dataclass(frozen=True)
class Told:
    """What the prior is told at one step.

    Attributes
    ----------
    embedding : (2 + K, ...) or (2 + K, B, ...)
        Rows of the prior's text embeddings: the base, the prompt, and K texts besides; with B of each where every
        picture is told something else.
    weights : (K, B) or (K, 1) float32
        How strongly each of the K is kept away from.
    """

    embedding: Tensor
    weights: Tensor


class Texts:
    """The texts of one job.

    Parameters
    ----------
    prior : Prior
        Encodes them, here, once.
    prompt, negative_prompt : str
    negative : NegativePrompt
    negative_weight : float
        w of `perpendicular`.
    view_prompts : bool
    distillation : Distillation

    Raises
    ------
    PromptError, ParameterError
        The prior cannot use one of them, or there is nothing that `perpendicular` could keep away from.
    """

    def __init__(
        self,
        prior: Prior,
        prompt: str,
        *,
        negative_prompt: str = "",
        negative: NegativePrompt = NegativePrompt.UNCONDITIONAL,
        negative_weight: float = 1.0,
        view_prompts: bool = False,
        distillation: Distillation = Distillation.SDS,
    ) -> None:
        noise_free = distillation is Distillation.NFSD
        self._perpendicular = negative is NegativePrompt.PERPENDICULAR
        self._views = view_prompts
        self._weight = negative_weight
        self._own = 0
        if self._perpendicular or noise_free:
            others = [""]
            unwanted = negative_prompt or (prior.unwanted if noise_free else "")
            if unwanted.strip():
                self._own = 1
                others.append(unwanted)
            elif self._perpendicular and not view_prompts:
                raise ParameterError(
                    "`negative: perpendicular` has nothing to keep away from.",
                    advice="Give a negative_prompt, or leave `negative` out.",
                )
        else:
            others = [negative_prompt]
        views = [f"{prompt}, {view}" for view in VIEWS] if view_prompts else []
        self._first_view = 1 + len(others)
        self._table = prior.encode_texts(prompt, *others, *views)

    def told(self, cameras: Cameras) -> Told:
        """What the pictures of these cameras are told."""
        base = [1, 0, *range(2, 2 + self._own)]
        weights = torch.full((self._own, 1), self._weight)
        if not self._views:
            return Told(self._table[base], weights)
        placed = list(zip(cameras.azimuths_deg, cameras.elevation_deg, strict=True))
        rows = torch.zeros(len(base), len(placed), len(self._table))
        for row, text in enumerate(base):
            rows[row, :, text] = 1.0
        kept_away = self._view_rows(rows, placed)
        if kept_away is not None:
            rows = torch.cat([rows, kept_away[0]])
            weights = torch.cat([weights.expand(-1, len(placed)), self._weight * kept_away[1]])
        mixed = torch.tensordot(rows.to(self._table), self._table, dims=1)
        return Told(mixed, weights)

    def _view_rows(self, rows: Tensor, placed: list[tuple[float, float]]) -> tuple[Tensor, Tensor] | None:
        """Put the views into the prompt's row; give the rows and weights of the views that are kept away from."""
        away, weights = torch.zeros(2, *rows.shape[1:]), torch.zeros(2, len(placed))
        for picture, (azimuth, elevation) in enumerate(placed):
            rows[1, picture] = 0.0
            if not self._perpendicular:
                rows[1, picture, self._first_view + VIEWS.index(view_name(azimuth, elevation))] = 1.0
                continue
            shares, others = _interpolated(azimuth, elevation)
            for view, share in shares:
                rows[1, picture, self._first_view + view] = share
            for number, (view, weight) in enumerate(others):
                away[number, picture, self._first_view + view] = 1.0
                weights[number, picture] = weight
        return (away, weights) if self._perpendicular else None


def _interpolated(azimuth_deg: float, elevation_deg: float) -> tuple[list[tuple[int, float]], list[tuple[int, float]]]:
    """Shares of the views that a camera sees, and weights of those that it does not."""
    turned = _turned(azimuth_deg)
    if elevation_deg >= _OVERHEAD_DEG:
        return [(_OVERHEAD, 1.0)], [(_FRONT, 0.0), (_SIDE, 0.0)]
    if turned < 90:
        r = 1 - turned / 90
        away = [(_FRONT, 4 * math.exp(-r / 2) - 2.426), (_SIDE, 4 * math.exp((r - 1) / 2) - 2.426)]
        return [(_FRONT, r), (_SIDE, 1 - r)], [(view, max(weight, 0.0)) for view, weight in away]
    r = 2 - turned / 90
    away = [(_SIDE, math.exp(-r / 2) - 0.606), (_FRONT, math.exp(-r / 2) + 0.967)]
    return [(_SIDE, r), (_BACK, 1 - r)], [(view, max(weight, 0.0)) for view, weight in away]
