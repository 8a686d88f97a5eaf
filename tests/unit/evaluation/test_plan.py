"""A folder belongs to one run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from meshdeform.errors import ParameterError
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.requests.groups import grouped
from tests.cases import each_case
from training.evaluation.evaluator import Evaluator
from training.evaluation.plan import (
    Plan,
    check_manifest,
    manifest,
    plan_of,
    read_manifest,
    write_manifest,
)
from training.evaluation.suite import Suite

SUITE = Suite("tiny", ("sphere", "cube"), ("a fish",), (0, 1), "preview")
PRIOR = {"id": "builtin", "revision": "", "sha256": "ab"}


def plan(folder: Path, **params: object) -> Plan:
    return Plan(SUITE, resolve(DeformParams.model_validate(grouped(params))), (10, 600), folder)


def members(folder: Path, judge: str = "one", **params: object) -> dict[str, object]:
    return manifest(plan(folder, **params), PRIOR, {"id": judge}, {"missing": "none"})


def test_a_manifest_comes_back_and_agrees_with_itself(tmp_path: Path) -> None:
    assert read_manifest(tmp_path) is None
    wanted = members(tmp_path)
    write_manifest(tmp_path, wanted)
    found = read_manifest(tmp_path)
    assert found is not None
    check_manifest(tmp_path, found, wanted)


@each_case(("name", "value"), [("learning_rate", 0.02), ("steps", 601), ("timestep_min", 0.8)])
def test_other_parameters_are_refused_by_name(tmp_path: Path, name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=rf"params\.{name}"):
        check_manifest(tmp_path, members(tmp_path), members(tmp_path, **{name: value}))


def test_the_precision_is_that_of_the_model_and_part_of_the_manifest(tmp_path: Path) -> None:
    half = replace(plan(tmp_path), dtype="bfloat16")
    prior = Evaluator(half).prior
    assert isinstance(prior, BuiltinPrior)
    assert prior.dtype is torch.bfloat16
    stored = manifest(half, PRIOR, {"id": "one"}, {"missing": "none"})
    with pytest.raises(ParameterError, match="dtype"):
        check_manifest(tmp_path, members(tmp_path), stored)
    assert plan_of(tmp_path, stored, judge="none", clip="", device="cpu").dtype == "bfloat16"


def test_the_seed_of_the_parameters_and_their_checkpoints_are_no_difference(tmp_path: Path) -> None:
    check_manifest(tmp_path, members(tmp_path), members(tmp_path, seed=3, checkpoint_every_steps=7))


def test_another_judge_is_refused_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"judge\.id") as refused:
        check_manifest(tmp_path, members(tmp_path), members(tmp_path, judge="other"))
    assert "--rejudge" in refused.value.advice_text


def test_a_damaged_manifest_and_one_of_another_format_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "manifest.json"
    path.write_text("{")
    with pytest.raises(ParameterError, match="damaged"):
        read_manifest(tmp_path)
    path.write_text(json.dumps({"format": 0}))
    with pytest.raises(ParameterError, match="format 0"):
        read_manifest(tmp_path)


def test_the_plan_of_a_manifest_is_the_one_that_wrote_it(tmp_path: Path) -> None:
    again = plan_of(tmp_path, dict(members(tmp_path, preset="preview")), judge="none", clip="", device="cpu")
    assert (again.suite, again.steps) == (SUITE, (10, 600))
    assert again.params.model == "builtin"
