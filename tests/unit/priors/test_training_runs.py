"""The programs that train the builtin prior and the judge still run; what they learn is tested by `-m training`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch

from meshdeform.errors import ModelError
from meshdeform.judge.network import JudgeNetwork, read_judge
from meshdeform.judge.training import train as judge_training
from meshdeform.priors.builtin import weights_file
from meshdeform.priors.builtin.grammar import NOUNS
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.priors.builtin.training import distil, train
from tests.cases import each_case

TWO_NOUNS = {noun: NOUNS[noun] for noun in ("bowl", "heart")}


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
    network, metadata = weights_file.read_network(weights)
    assert network.config == small
    assert metadata["steps"] == "1"
    assert sorted(path.name for path in cache.iterdir()) == ["bowl.safetensors", "heart.safetensors"]


def test_the_guidance_is_distilled_for_a_step_and_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(0)
    network = PriorNetwork(ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16))
    teacher, student = tmp_path / "prior.safetensors", tmp_path / "guided.safetensors"
    state = network.state_dict()
    for tensor in state.values():
        if not tensor.any():  # with these at zero it would predict the same for every prompt
            tensor.normal_(std=0.2)
    weights_file.write_weights(teacher, state, network.config, {"steps": "7"})
    monkeypatch.setattr(distil, "FAMILIES", ["bowl", "heart"])
    options = "--steps 2 --members 1 --pictures 1 --batch 2 --device cpu --save-every 1"
    files = ["--cache", str(tmp_path / "pictures"), "--teacher", str(teacher), "--output", str(student)]
    monkeypatch.setattr(sys, "argv", ["distil", *options.split(), *files])
    distil.main()
    prior = BuiltinPrior(weights=teacher, guided=student)
    assert prior.one_pass == (7.5, 0.7)
    taught, _ = weights_file.read_network(teacher)
    learned, metadata = weights_file.read_network(student)
    assert metadata["teacher"] == prior.identity["sha256"]
    assert all(torch.equal(a, b) for a, b in zip(taught.text.parameters(), learned.text.parameters(), strict=True))
    assert not torch.equal(taught.out.weight, learned.out.weight)
    with pytest.raises(ModelError, match="distilled from others"):
        BuiltinPrior(guided=student)


@each_case("odds", ["dragonfly=1", "bowl", "bowl=-1", "bowl=often"])
def test_odds_that_are_no_noun_and_number_are_refused(odds: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["train", "--cache", "nowhere", "--odds", odds])
    with pytest.raises(SystemExit, match="2"):
        train.main()


def test_the_judge_is_trained_for_a_step_calibrated_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache, weights = tmp_path / "views", tmp_path / "judge.safetensors"
    options = "--steps 1 --nouns bowl heart --members 1 --others 1 --nothings 1 --calibration 1"
    arguments = ["train", *options.split(), "--cache", str(cache), "--output", str(weights)]
    monkeypatch.setattr(sys, "argv", arguments)
    judge_training.main()
    network, metadata = read_judge(weights)
    assert isinstance(network, JudgeNetwork)
    assert metadata["steps"] == "1"
