"""What docs/webhooks.md shows receivers works on what the sender sends."""

from __future__ import annotations

import base64
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from meshdeform.api.webhooks import WebhookEvent
from meshdeform.record.deliveries import RETRY_AFTER_S
from meshdeform.webhooks.sender import signed_headers

SECRET = "whsec_" + base64.b64encode(b"s" * 32).decode()
OTHER = "whsec_" + base64.b64encode(b"o" * 32).decode()
BODY = '{"type":"job.succeeded"}'


@pytest.fixture(scope="module")
def page(repository: Path) -> str:
    return (repository / "docs/webhooks.md").read_text()


@pytest.fixture(scope="module")
def shown(page: str) -> dict[str, Any]:
    """What the page's Python defines."""
    names: dict[str, Any] = {}
    for block in re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
        exec(compile(block, "docs/webhooks.md", "exec"), names)
    return names


def headers(*secrets: str, ago_s: float = 0.0) -> dict[str, str]:
    return signed_headers("msg_1", BODY, secrets, datetime.now(UTC) - timedelta(seconds=ago_s))


def test_both_ways_to_verify_take_what_is_sent_and_nothing_else(shown: dict[str, Any]) -> None:
    def verdicts(body: str, sent: dict[str, str]) -> list[bool]:
        return [
            shown["receive"](body.encode(), sent, SECRET) is not None,
            shown["is_genuine"](body.encode(), sent, SECRET),
        ]

    assert verdicts(BODY, headers(SECRET)) == verdicts(BODY, headers(OTHER, SECRET)) == [True, True]
    assert verdicts(BODY + " ", headers(SECRET)) == [False, False]
    assert verdicts(BODY, headers(OTHER)) == [False, False]
    assert verdicts(BODY, headers(SECRET, ago_s=400)) == [False, False]
    assert verdicts(BODY, {**headers(SECRET), "webhook-id": "msg_2"}) == [False, False]


def test_every_type_is_on_the_page_and_no_other(page: str) -> None:
    assert set(re.findall(r"`(job\.[a-z]+)`", page)) == {event.value for event in WebhookEvent}


def test_the_schedule_on_the_page_is_the_schedule(page: str) -> None:
    assert "5 seconds, 5 minutes, 30 minutes, 2, 5, 10, 14, 20 and 24 hours" in " ".join(page.split())
    assert (5, 5 * 60, 30 * 60, *(3600 * hours for hours in (2, 5, 10, 14, 20, 24))) == RETRY_AFTER_S
