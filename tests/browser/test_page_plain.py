"""The page speaks in the words of people: what only programs name is seen under *Details* alone, in every state."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from meshdeform.requests.document import DeformParams, OutputParams
from tests.acceptance.service import Service
from tests.browser.conftest import Watch
from tests.browser.steps import badge, choose, expect, open_form, open_more

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

pytestmark = pytest.mark.without_3d

SEEN = """() => {
  const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const { parentElement: place, data } = walker.currentNode;
    if (data.trim() && place.checkVisibility() && !place.closest("script, style")) found.push(data.trim());
  }
  return found;
}"""
CODE = "`exclude` names no node. Set output.rig, a larger max_run_s, or MESHDEFORM_MAX_RUN_S."
PROBLEM = {"status": 422, "code": "invalid_request", "title": "Invalid request", "detail": f"That is too much. {CODE}"}


def names() -> set[str]:
    """The names of parameters that are no words."""
    schemas = [DeformParams.model_json_schema(), OutputParams.model_json_schema()]
    parts = [part for schema in schemas for part in [schema, *schema.get("$defs", {}).values()]]
    return {name for part in parts for name in part.get("properties", {}) if "_" in name}


def code(page: Page) -> list[str]:
    """The texts on the page that only programs understand."""
    pattern = re.compile(
        r"`|MESHDEFORM_|\b(?:output|params|guidance|control)\.[a-z]|\b(?:" + "|".join(names()) + r")\b"
    )
    return [text for text in page.evaluate(SEEN) if pattern.search(text)]


def test_no_state_of_the_page_speaks_as_programs_do(
    page: Page, watch: Watch, service: Service, small_sphere: Path
) -> None:
    watch.allow(r"status of 422 ")
    open_form(page)
    choose(page, small_sphere)
    assert code(page) == []

    # Refused: what people can do is said, the rest is one click away.
    page.route("**/v1/jobs:validate", lambda route: route.fulfill(status=422, json=PROBLEM))
    page.get_by_label("Prompt", exact=True).fill("a vase")
    problem = page.get_by_role("alert").filter(has_text="That is too much.")
    expect(problem).to_be_visible()
    assert code(page) == []
    problem.locator("summary").click()
    assert any("MESHDEFORM_MAX_RUN_S" in text for text in code(page))
    page.unroute_all()

    # A file with something to tell.
    def told(route: Route) -> None:
        found = route.fetch().json()
        route.fulfill(json={**found, "asset": {**found["asset"], "warnings": [f"It has no colours. {CODE}"]}})

    page.route("**/v1/jobs:validate", told)
    page.get_by_label("Prompt", exact=True).fill("a tall vase")
    expect(page.locator("#asset-facts")).to_contain_text("It has no colours.")
    assert code(page) == []

    job = service.submit(small_sphere, {"prompt": "a vase", "params": {"preset": "preview", "steps": 1}})
    assert service.finished(job)["state"] == "succeeded"
    verdict = {"value": "keep_source", "reasons": ["It looks like a ball.", CODE], "advice": [CODE, "Ask for less."]}
    page.route(
        "**/artifacts/report.json",
        lambda route: route.fulfill(json={**route.fetch().json(), "verdict": verdict, "warnings": [CODE]}),
    )
    page.goto(f"/#/jobs/{job}")
    expect(page.locator(".verdict")).to_contain_text("It looks like a ball.")
    expect(page.locator(".verdict")).to_contain_text("Ask for less.")
    assert code(page) == []
    open_more(page)
    page.get_by_role("heading", name="All settings").click()
    assert code(page) != []

    # Failed, as the worker and the record say it.
    error = {"code": "timeout", "title": "The job took too long", "detail": f"It was ended. {CODE}", "advice": CODE}

    def failed(route: Route) -> None:
        document: dict[str, Any] = route.fetch().json()
        route.fulfill(json={**document, "state": "failed", "error": error})

    def ended(route: Route) -> None:
        event = {"seq": 99, "job_id": job, "type": "failed", "at": "2026-01-01T00:00:00Z", "attempt": 1}
        body = f"data: {json.dumps({**event, 'data': {'error': error}})}\n\n"
        route.fulfill(body=body, content_type="text/event-stream")

    page.goto("/#/jobs")
    page.route(f"**/v1/jobs/{job}", failed)
    page.route(f"**/v1/jobs/{job}/events*", ended)
    page.goto(f"/#/jobs/{job}")
    expect(badge(page)).to_have_text("Failed")
    expect(page.get_by_role("alert")).to_contain_text("It was ended.")
    assert code(page) == []
