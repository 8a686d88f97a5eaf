"""The watch over pages sees what it is there for: a test of the tests."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.service import until
from tests.browser.conftest import Watch

if TYPE_CHECKING:
    from playwright.sync_api import Page


FAULTS = {
    "console.error('no')": "the console says: no",
    "setTimeout(() => { throw new Error('broken') })": "a script failed: .*broken",
    "fetch('http://localhost:9/').catch(() => {})": "the policy refused: connect-src",
    "document.body.append(Object.assign(document.createElement('script'), {src: '/a.js'}))": "refused: script",
    "document.body.append(Object.assign(document.createElement('img'), {src: 'http://127.0.0.1:9/a.png'}))": "img-src",
}


@pytest.mark.long  # tests the tests
def test_every_fault_is_seen_and_nothing_else_is_one(page: Page, watch: Watch) -> None:
    """Guard the browser tests: a watch that sees nothing would let all of them pass."""
    page.goto("/healthz")
    assert watch.faults(page.context) == []
    for script in FAULTS:
        page.evaluate(f"() => {{ {script} }}")
    for fault in FAULTS.values():
        until(fault, lambda fault=fault: any(re.search(fault, found) for found in watch.faults(page.context)))
    watch.allow("")
