"""A drawing on the page: strokes, a way back, the guesses, another slider, and its mesh as the target of a job."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from meshdeform.kinds.sketch.shapes import shape_glb
from tests.acceptance.service import Service
from tests.browser.conftest import Watch
from tests.browser.steps import drag, expect, open_form, open_more, set_steps, start

if TYPE_CHECKING:
    from playwright.sync_api import Page


# The front of a table: its top, and two legs.
STROKES = [
    [(0.1, 0.3), (0.9, 0.3), (0.9, 0.35), (0.1, 0.35), (0.1, 0.3)],
    [(0.15, 0.35), (0.15, 0.8), (0.2, 0.8), (0.2, 0.35)],
    [(0.8, 0.35), (0.8, 0.8), (0.85, 0.8), (0.85, 0.35)],
]


@pytest.mark.without_pictures
def test_a_drawn_table_is_the_target_of_a_job(page: Page, service: Service, watch: Watch) -> None:
    watch.allow("422.*sketches:guess")
    open_form(page)
    open_more(page)
    page.get_by_role("button", name="Draw it").click()
    dialog = page.get_by_role("dialog", name="Draw a shape")
    guess, use = (
        dialog.get_by_role("button", name="Guess what it is"),
        dialog.get_by_role("button", name="Use as target"),
    )
    pad = page.get_by_role("img", name="Drawing")
    expect(guess).to_be_enabled()  # of a sample, which gives way to the first line

    # One line is no drawing, and what is undone is gone.
    drag(page, pad, (0.1, 0.9), (0.9, 0.9))
    guess.click()
    expect(dialog).to_contain_text("single line")
    dialog.get_by_role("button", name="Undo").click()
    expect(guess).to_be_disabled()
    for stroke in STROKES:
        drag(page, pad, *stroke)
    guess.click()
    guesses = dialog.get_by_role("radiogroup", name="Guesses").get_by_role("radio")
    expect(guesses).to_have_count(3)
    expect(dialog.locator(".sketch-guess img[src^='blob:']")).to_have_count(3)
    dialog.get_by_label("What it is", exact=True).fill("table")
    guess.click()
    expect(guesses).to_have_count(1)
    expect(dialog.get_by_role("radio", name="Table")).to_be_checked()
    kind = dialog.get_by_label("Kind", exact=True)
    with page.expect_response("**/v1/sketches:mesh") as made:
        kind.select_option("round-table")
    sent = made.value.request.post_data_json
    assert (sent["noun"], sent["values"]["kind"]) == ("table", "round-table")
    expect(use).to_be_enabled()
    use.click()
    expect(dialog).to_have_count(0)
    expect(page.locator(".guide-head")).to_contain_text("table.glb")
    set_steps(page, 2)
    expect(page.locator("#estimate")).to_contain_text("2 steps")
    job = start(page)
    document = service.job(job)
    # The job has the mesh that was shown, as any other target.
    assert document["params"]["guidance"] == {"kind": "target"}
    assert list(document["files"]) == ["asset", "target"]
    assert service.http.get(f"/v1/jobs/{job}/files/target").content == shape_glb("table", sent["values"])
    expect(page.locator(".guide-head")).to_contain_text("table.glb")
