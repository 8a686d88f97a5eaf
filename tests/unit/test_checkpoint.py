"""Checkpoint files: round trip, and everything that must be refused."""

from __future__ import annotations

import pytest
import torch

from meshdeform.checkpoint import Checkpoint, dump_checkpoint, fingerprint, load_checkpoint
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
    found = load_checkpoint(dump_checkpoint(state(), "a"), "a")
    assert found.step == 7
    assert all(torch.equal(found.tensors[k], v) for k, v in state().tensors.items())


def test_another_run_is_refused() -> None:
    with pytest.raises(CheckpointError, match="other parameters"):
        load_checkpoint(dump_checkpoint(state(), "a"), "b")


@pytest.mark.parametrize("cut", [0, 3, 8, 100, -1])
def test_torn_files_are_refused(cut: int) -> None:
    with pytest.raises(CheckpointError, match="torn"):
        load_checkpoint(dump_checkpoint(state(), "a")[:cut], "a")


def test_something_else_is_refused() -> None:
    with pytest.raises(CheckpointError):
        load_checkpoint(b"not a checkpoint at all, but long enough to have a header", "a")


def test_the_fingerprint_covers_values_and_ignores_their_order() -> None:
    assert fingerprint(a=1, b=2.5) == fingerprint(b=2.5, a=1)
    assert fingerprint(a=1, b=2.5) != fingerprint(a=1, b=2.6)
