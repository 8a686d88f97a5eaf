"""The programs that train the builtin prior and the judge still run; what they learn is tested by `-m training`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from meshdeform.priors.builtin import network as weights_network
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork
from training.judge import train as judge_training
from training.judge.members import HELD_OUT, ViewSet
from training.judge.network import JudgeNetwork, read_judge
from training.prior import train


@pytest.fixture(autouse=True)
def _logs_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the programs from taking over the log of the tests that follow."""
    monkeypatch.setattr("logging.basicConfig", lambda **_: None)


def test_the_prior_is_trained_for_a_step_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16)
    monkeypatch.setattr(train, "PriorNetwork", lambda: PriorNetwork(small))
    cache, weights = tmp_path / "pictures", tmp_path / "prior.safetensors"
    options = (
        "--nouns bowl heart --odds bowl=2 --steps 1 --members 1 --pictures 1 --batch 2 --device cpu --precision fp32"
    )
    monkeypatch.setattr(sys, "argv", ["train", *options.split(), "--cache", str(cache), "--output", str(weights)])
    train.main()
    network, metadata = weights_network.read_network(weights)
    assert network.config == small
    assert metadata["steps"] == "1"
    assert sorted(path.name for path in cache.iterdir()) == ["bowl.safetensors", "heart.safetensors"]


def test_the_judge_is_trained_for_a_step_calibrated_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache, weights = tmp_path / "views", tmp_path / "judge.safetensors"
    assets = ViewSet.drawn(HELD_OUT, "other bowl", 1)
    monkeypatch.setattr(judge_training, "views_of_assets", lambda *_: assets)
    options = "--steps 1 --nouns bowl heart --others 1 --nothings 1"
    arguments = ["train", *options.split(), "--cache", str(cache), "--assets", "-", "--output", str(weights)]
    monkeypatch.setattr(sys, "argv", arguments)
    judge_training.main()
    network, metadata = read_judge(weights)
    assert isinstance(network, JudgeNetwork)
    assert metadata["steps"] == "1"
