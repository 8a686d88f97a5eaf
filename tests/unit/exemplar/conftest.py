"""Few members, which are drawn in a third of the time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from meshdeform.reading import banks


@pytest.fixture
def few_members(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(banks, "_WISHED", 48)
    monkeypatch.setattr(banks, "_WISHED_WITH_ATTRIBUTES", 24)
    banks._bank_of.cache_clear()
    yield
    banks._bank_of.cache_clear()
