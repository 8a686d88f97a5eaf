"""What the prior is told: which texts, to which picture, and how strongly others are kept away from."""

from __future__ import annotations

import math

import pytest
import torch

from meshdeform.errors import ParameterError
from meshdeform.guidance.texts import VIEWS, Texts, view_name
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.requests.document import Distillation, NegativePrompt
from meshdeform.testing import FakePrior

FOUR = fixed_cameras(0.0, 15.0)
PERPENDICULAR = NegativePrompt.PERPENDICULAR


class NamingPrior(FakePrior):
    """One-hot rows, whose places `names` says."""

    unwanted = "bad"

    def encode_texts(self, prompt: str, *others: str) -> torch.Tensor:
        self.names = [prompt, *others]
        return torch.eye(len(self.names))


def names(prior: NamingPrior, rows: torch.Tensor) -> list[str]:
    assert torch.equal(rows.sum(-1), torch.ones(len(rows)))
    return [prior.names[int(row.argmax())] for row in rows]


@pytest.mark.parametrize(
    ("azimuth", "elevation", "view"),
    [
        (0, 0, "front view"), (44, 0, "front view"), (-44, 30, "front view"), (360, 0, "front view"),
        (46, 0, "side view"), (90, 0, "side view"), (-90, 0, "side view"), (270, 0, "side view"), (134, 0, "side view"),
        (136, 0, "back view"), (180, 0, "back view"), (-180, 0, "back view"), (-140, 0, "back view"),
        (0, 60, "overhead view"), (180, 89, "overhead view"), (0, 59, "front view"),
    ],
)  # fmt: skip
def test_where_a_camera_stands(azimuth: float, elevation: float, view: str) -> None:
    assert view_name(azimuth, elevation) == view


def test_unless_told_otherwise_the_negative_prompt_stands_in_for_nothing() -> None:
    prior = NamingPrior()
    told = Texts(prior, "a vase", negative_prompt="blurry").told(FOUR)
    assert names(prior, told.embedding) == ["blurry", "a vase"]
    assert told.weights.shape == (0, 1)


def test_perpendicular_asks_for_nothing_the_prompt_and_the_negative_prompt() -> None:
    prior = NamingPrior()
    told = Texts(prior, "a vase", negative_prompt="blurry", negative=PERPENDICULAR, negative_weight=2.5).told(FOUR)
    assert names(prior, told.embedding) == ["", "a vase", "blurry"]
    assert told.weights.tolist() == [[2.5]]
    with pytest.raises(ParameterError, match="nothing to keep away from"):
        Texts(prior, "a vase", negative=PERPENDICULAR)


def test_noise_free_has_the_users_bad_pictures_or_the_priors() -> None:
    prior = NamingPrior()
    for written, used in (("", "bad"), ("dull", "dull")):
        told = Texts(prior, "a vase", negative_prompt=written, distillation=Distillation.NFSD).told(FOUR)
        assert names(prior, told.embedding) == ["", "a vase", used]
    prior.unwanted = ""
    told = Texts(prior, "a vase", distillation=Distillation.NFSD).told(FOUR)
    assert names(prior, told.embedding) == ["", "a vase"]


def test_view_prompts_tell_each_picture_its_own_view() -> None:
    prior = NamingPrior()
    texts = Texts(prior, "a dog", negative_prompt="blurry", view_prompts=True)
    told = texts.told(fixed_cameras((10.0, -100.0, 170.0, 30.0), (0.0, 0.0, 0.0, 70.0)))
    assert names(prior, told.embedding[0]) == ["blurry"] * 4
    assert names(prior, told.embedding[1]) == [f"a dog, {view}" for view in VIEWS]
    assert len(told.embedding) == 2


@pytest.mark.parametrize(
    ("azimuth", "shares", "away"),
    [
        (0.0, {"front": 1.0}, {"front": 0.0, "side": 4 - 2.426}),
        (90.0, {"side": 1.0}, {"side": 0.0, "front": math.exp(-0.5) + 0.967}),
        (-45.0, {"front": 0.5, "side": 0.5}, dict.fromkeys(("front", "side"), 4 * math.exp(-0.25) - 2.426)),
        (180.0, {"back": 1.0}, {"side": 1 - 0.606, "front": 1 + 0.967}),
        (135.0, {"side": 0.5, "back": 0.5}, {"side": math.exp(-0.25) - 0.606, "front": math.exp(-0.25) + 0.967}),
    ],
)  # fmt: skip
def test_with_perp_neg_views_are_mixed_and_the_others_kept_away_from(
    azimuth: float, shares: dict[str, float], away: dict[str, float]
) -> None:
    prior = NamingPrior()
    told = Texts(prior, "a dog", negative=PERPENDICULAR, view_prompts=True).told(fixed_cameras((azimuth,), 10.0))
    place = {text.removeprefix("a dog, ").removesuffix(" view"): k for k, text in enumerate(prior.names)}
    expected = torch.zeros(len(prior.names))
    for view, share in shares.items():
        expected[place[view]] = share
    torch.testing.assert_close(told.embedding[1, 0], expected)
    found = {prior.names[int(row[0].argmax())]: float(weight[0]) for row, weight in zip(
        told.embedding[2:], told.weights, strict=True)}  # fmt: skip
    assert found == {f"a dog, {view} view": pytest.approx(weight, abs=1e-3) for view, weight in away.items()}


def test_the_weights_do_not_jump_at_the_side() -> None:
    """What is kept away from changes continuously where the two halves meet, and from above nothing is."""
    texts = Texts(NamingPrior(), "a dog", negative=PERPENDICULAR, view_prompts=True)

    def pull(azimuth: float, elevation: float = 10.0) -> torch.Tensor:
        told = texts.told(fixed_cameras((azimuth,), elevation))
        return torch.einsum("kb,kbt->t", told.weights, told.embedding[2:])

    torch.testing.assert_close(pull(89.99), pull(90.01), atol=1e-3, rtol=0)
    torch.testing.assert_close(pull(-60.0), pull(60.0))
    assert not pull(0.0, 75.0).any()


def test_a_written_negative_prompt_joins_the_views() -> None:
    prior = NamingPrior()
    texts = Texts(
        prior, "a dog", negative_prompt="ugly", negative=PERPENDICULAR, negative_weight=2.0, view_prompts=True
    )
    told = texts.told(FOUR)
    assert told.embedding.shape[:2] == (5, 4)
    assert names(prior, told.embedding[2]) == ["ugly"] * 4
    assert told.weights[0].tolist() == [2.0] * 4
    assert float(told.weights[2, 0]) == pytest.approx(2 * (4 - 2.426), abs=1e-4)
