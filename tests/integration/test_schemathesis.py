"""The running service keeps to its own description, whatever Schemathesis makes up (tests/contract.py)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from tests.contract import run, service_under_test


def checked(folder: Path, redis_url: str, **options: Any) -> str:
    """Return what Schemathesis prints when it has found nothing wrong with any operation."""
    with service_under_test(folder, redis_url) as (url, key):
        done = run(url, key, **options)
    assert done.returncode == 0, done.stdout[:20_000] + done.stderr[-2000:]
    selected, tested = re.findall(r"Selected: \d+/(\d+)\n +Tested: (\d+)", done.stdout)[0]
    assert int(selected) == int(tested) >= 25
    return done.stdout


@pytest.mark.slow
def test_the_service_is_what_its_description_says(redis_url: str, tmp_path: Path) -> None:
    """By requests at random, right and wrong, to each operation, and by chains of requests."""
    shown = checked(tmp_path, redis_url, examples=3, chains=20, phases="examples,fuzzing,stateful")
    # Chains are made by the links of the document; on a busy machine fewer of them lead on.
    covered = re.findall(r"API Links: +(\d+) covered", shown)
    assert int(covered[0]) >= 1


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_every_bound_of_the_description_is_kept(redis_url: str, tmp_path: Path) -> None:
    """Each value of each parameter at, below and above its bounds, of each wrong type, and by each wrong method."""
    checked(tmp_path, redis_url, examples=1, phases="coverage")
