"""What a result is worth comes first, on the job's page and on its card; only a good one is marked as good."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.acceptance.service import Service
from tests.browser.steps import badge, expect, open_more
from tests.cases import each_case

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

GOOD = {"value": "good", "reasons": ["It looks like a vase (97%)."], "advice": []}
DOUBTFUL = {
    "value": "doubtful",
    "reasons": ["It looks only a little like a vase (40%)."],
    "advice": ["Ask for the change alone, “taller”: it is made on the asset itself, which stays whole."],
}
BAD = {
    "value": "keep_source",
    "reasons": ["It looks no more like a vase than before (number 9 of 474 nouns, where the source was 9)."],
    "advice": ["Try another variation: each goes its own way."],
}
EARLIER = {"value": "keep_result", "reasons": []}


@pytest.fixture(scope="module")
def finished(service: Service, small_sphere: Path) -> str:
    """The id of a job that has succeeded."""
    job = service.submit(small_sphere, {"prompt": "a vase", "params": {"preset": "preview", "steps": 1}})
    assert service.finished(job)["state"] == "succeeded"
    return job


@each_case(
    "verdict, title, mark",
    [
        (GOOD, "Good", "good"),
        (DOUBTFUL, "Doubtful", "doubtful"),
        (BAD, "Better keep your asset", "keep_source"),
        (EARLIER, "Doubtful", "doubtful"),
    ],
)
@pytest.mark.without_3d
def test_a_page_and_a_card_lead_with_the_verdict(
    page: Page, service: Service, finished: str, verdict: dict[str, Any], title: str, mark: str
) -> None:
    def reported(route: Route) -> None:
        report = route.fetch().json()
        route.fulfill(json={**report, "verdict": verdict})

    page.route("**/artifacts/report.json", reported)
    page.goto("/#/jobs")
    card = page.locator(".card", has=page.locator(f'a[href="#/jobs/{finished}"]'))
    expect(card.locator(".badge")).to_have_text(title)
    expect(card.locator(f".badge-{mark}")).to_have_count(1)
    page.goto(f"/#/jobs/{finished}")
    expect(badge(page)).to_have_text(title)
    # First of all, in sentences; what was measured is under Details.
    first = page.locator(".verdict")
    expect(first.locator("strong")).to_have_text(f"{title}.")
    for text in [*verdict["reasons"], *verdict.get("advice", [])]:
        expect(first).to_contain_text(text)
    quality = page.get_by_role("region", name="Quality")
    expect(quality).to_be_hidden()
    open_more(page)
    expect(quality).to_be_visible()
    assert bool(quality.locator(".finding-good").count()) is (mark == "good")
