"""A folder belongs to one run."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

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


@each_case(
    ("changed", "named"),
    [
        ({"learning_rate": 0.02}, r"params\.learning_rate"),
        ({"timestep_min": 0.8}, r"params\.timestep_min"),
        ({"judge": "other"}, r"judge\.id"),
        ({"seed": 3, "checkpoint_every_steps": 7}, ""),
    ],
)
def test_a_manifest_comes_back_and_what_differs_is_refused_by_name(
    tmp_path: Path, changed: dict[str, Any], named: str
) -> None:
    write_manifest(tmp_path, members(tmp_path))
    found = read_manifest(tmp_path)
    assert found is not None
    assert plan_of(tmp_path, found, judge="none", clip="", device="cpu").steps == (10, 600)
    with pytest.raises(ParameterError, match=named) if named else nullcontext():
        check_manifest(tmp_path, found, members(tmp_path, **changed))
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(ParameterError, match="damaged"):
        read_manifest(tmp_path)


def test_the_precision_is_that_of_the_model_and_part_of_the_manifest(tmp_path: Path) -> None:
    half = replace(plan(tmp_path), dtype="bfloat16")
    prior = Evaluator(half).prior
    assert isinstance(prior, BuiltinPrior)
    assert prior.dtype is torch.bfloat16
    stored = manifest(half, PRIOR, {"id": "one"}, {"missing": "none"})
    with pytest.raises(ParameterError, match="dtype"):
        check_manifest(tmp_path, members(tmp_path), stored)
    assert plan_of(tmp_path, stored, judge="none", clip="", device="cpu").dtype == "bfloat16"
