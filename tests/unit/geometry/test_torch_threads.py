"""Work is shared among threads that compute alone, and torch has its threads back afterwards."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from meshdeform.geometry.torch_threads import one_torch_thread, share_work


@pytest.fixture(autouse=True)
def three_threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr("meshdeform.support.threads._chosen", 3)
    threads = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(threads)


def test_each_thread_computes_alone_and_all_of_the_work_is_done() -> None:
    ranges = share_work(lambda begin, end: (list(range(begin, end)), torch.get_num_threads()), 7)
    assert [number for numbers, _ in ranges for number in numbers] == list(range(7))
    assert [threads for _, threads in ranges] == [1, 1, 1]
    assert torch.get_num_threads() == 3


def test_torch_has_its_threads_back_after_an_error() -> None:
    seen = []

    def fail(begin: int, _: int) -> None:
        seen.append(torch.get_num_threads())
        raise ValueError(str(begin))

    with pytest.raises(ValueError, match=r"[012]"):
        share_work(fail, 3)
    with pytest.raises(ValueError, match="9"), one_torch_thread():
        fail(9, 10)
    # Shares that have not begun when another one fails are left out.
    assert set(seen) == {1}
    assert 2 <= len(seen) <= 4
    assert torch.get_num_threads() == 3
