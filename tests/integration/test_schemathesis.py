"""The running service keeps to its own description, whatever Schemathesis makes up (tests/contract.py)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.contract import run, service_under_test


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_service_is_what_its_description_says(redis_url: str, tmp_path: Path) -> None:
    with service_under_test(tmp_path, redis_url) as (url, key):
        done = run(url, key, examples=1, chains=20)
    assert done.returncode == 0, done.stdout[:20_000] + done.stderr[-2000:]
    # It ran: every operation, and chains of them by the links of the document.
    selected, tested = re.findall(r"Selected: \d+/(\d+)\n +Tested: (\d+)", done.stdout)[0]
    assert int(selected) == int(tested) >= 25
    covered = re.findall(r"API Links: +(\d+) covered", done.stdout)
    assert int(covered[0]) >= 5
