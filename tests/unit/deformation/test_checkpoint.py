"""Checkpoint files: round trip, and everything that must be refused."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from meshdeform.deformation.checkpoint import Checkpoint, dump_checkpoint, fingerprint, load_checkpoint, load_shape
from meshdeform.errors import CheckpointError


def state() -> Checkpoint:
    return Checkpoint(
        7,
        {
            "jacobians": torch.randn(5, 3, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0)),
            "jacobians.step": torch.tensor(7.0),
            "generator": torch.Generator().get_state(),
        },
    )


def test_round_trip() -> None:
    for precision in ("", "bfloat16, float32"):
        found = load_checkpoint(dump_checkpoint(replace(state(), precision=precision), "a"), "a")
        assert (found.step, found.precision) == (7, precision)
        assert all(torch.equal(found.tensors[k], v) for k, v in state().tensors.items())


def test_another_run_and_torn_files_are_refused() -> None:
    data = dump_checkpoint(state(), "a")
    with pytest.raises(CheckpointError, match="other parameters"):
        load_checkpoint(data, "b")
    for cut in (0, 3, 8, 100, -1):
        with pytest.raises(CheckpointError, match="damaged"):
            load_checkpoint(data[:cut], "a")
    with pytest.raises(CheckpointError):
        load_checkpoint(b"not a checkpoint at all, but long enough to have a header", "a")


def test_a_shape_is_for_any_run_with_the_same_asset() -> None:
    data = dump_checkpoint(state(), "a", asset="0f")
    assert torch.equal(load_shape(data, "0f")["jacobians"], state().tensors["jacobians"])
    for wrong, asset, words in ((data, "1e", "another asset"), (data[:-1], "0f", "damaged")):
        with pytest.raises(CheckpointError, match=words):
            load_shape(wrong, asset)
    assert fingerprint(a=1, b=2.5) == fingerprint(b=2.5, a=1) != fingerprint(a=1, b=2.6)
