"""Torch computes on one thread inside a block, and has its threads back afterwards."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from meshdeform.geometry.torch_threads import one_torch_thread


@pytest.fixture(autouse=True)
def three_threads() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(threads)


def test_torch_has_its_threads_back_also_after_an_error() -> None:
    with one_torch_thread():
        assert torch.get_num_threads() == 1
    with pytest.raises(ValueError, match="9"), one_torch_thread():
        raise ValueError("9")
    assert torch.get_num_threads() == 3
