"""Checkpoint files: round trip, and everything that must be refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import safetensors.torch

from meshdeform.deformation.checkpoint import Checkpoint, dump_checkpoint, fingerprint, load_checkpoint, load_shape
from meshdeform.errors import CheckpointError


def state() -> Checkpoint:
    return Checkpoint(
        7,
        {
            "jacobians": np.random.default_rng(0).normal(size=(5, 3, 3)),
            "jacobians.step": np.array(7.0, np.float32),
            "generator": np.arange(9, dtype=np.uint8),
        },
    )


def test_round_trip() -> None:
    for precision in ("", "bfloat16, float32"):
        found = load_checkpoint(dump_checkpoint(replace(state(), precision=precision), "a"), "a")
        assert (found.step, found.precision) == (7, precision)
        assert all(np.array_equal(found.tensors[k], v) for k, v in state().tensors.items())


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
    assert np.array_equal(load_shape(data, "0f")["jacobians"], state().tensors["jacobians"])
    for wrong, asset, words in ((data, "1e", "another asset"), (data[:-1], "0f", "damaged")):
        with pytest.raises(CheckpointError, match=words):
            load_shape(wrong, asset)
    assert fingerprint(a=1, b=2.5) == fingerprint(b=2.5, a=1) != fingerprint(a=1, b=2.6)


def test_torch_reads_the_same_tensors() -> None:
    read = safetensors.torch.load(dump_checkpoint(state(), "a"))
    assert {name: (value.shape, value.numpy().dtype) for name, value in read.items()} == {
        name: (value.shape, value.dtype) for name, value in state().tensors.items()
    }
    assert all(np.array_equal(read[name], value) for name, value in state().tensors.items())
