"""The running service keeps to its own description, whatever Schemathesis makes up (tests/contract.py)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.contract import run, service_under_test


@pytest.mark.slow
def test_the_service_is_what_its_description_says(redis_url: str, tmp_path: Path) -> None:
    """By requests at random, right and wrong, to each operation, and by chains of requests."""
    with service_under_test(tmp_path, redis_url) as (url, key):
        done = run(url, key, examples=3, chains=20, phases="examples,fuzzing,stateful")
    assert done.returncode == 0, done.stdout[:20_000] + done.stderr[-2000:]
    selected, tested = re.findall(r"Selected: \d+/(\d+)\n +Tested: (\d+)", done.stdout)[0]
    assert int(selected) == int(tested) >= 25
    # Chains are made by the links of the document; on a busy machine fewer of them lead on.
    covered = re.findall(r"API Links: +(\d+) covered", done.stdout)
    assert int(covered[0]) >= 1
