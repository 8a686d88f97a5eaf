"""Many files on one wall: each is read, one sentence changes all, and what is kept comes back."""

from __future__ import annotations

import base64
import csv
import io
import re
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from meshdeform.assets import load_asset
from tests.acceptance.service import Service
from tests.browser.conftest import Watch
from tests.browser.steps import barriers, expect, open_form

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page


def until_text(place: Locator, text: str) -> None:
    """Wait until files that a busy machine reads one after the other are at something."""
    expect(place).to_have_text(text, timeout=240_000)


_DROP = """(files) => {
  const carried = new DataTransfer();
  for (const [name, content] of files) {
    carried.items.add(new File([Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0))], name));
  }
  for (const kind of ["dragover", "drop"]) {
    const event = new DragEvent(kind, { bubbles: true, cancelable: true, dataTransfer: carried });
    document.querySelector("h1").dispatchEvent(event);
  }
}"""


def drop(page: Page, files: dict[str, bytes]) -> None:
    """Drop files on the page."""
    page.evaluate(_DROP, [[name, base64.b64encode(data).decode()] for name, data in files.items()])


def packed(files: dict[str, bytes]) -> bytes:
    """A ZIP."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def archive_of(page: Page) -> dict[str, bytes]:
    """What the ZIP has that the page gives."""
    with page.expect_download() as download:
        page.get_by_role("button", name="Download ZIP").click()
    assert download.value.suggested_filename == "20-taller.zip"
    with zipfile.ZipFile(download.value.path()) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.mark.live
@pytest.mark.without_pictures
def test_a_folder_is_changed_by_one_sentence_and_what_is_kept_comes_back(
    page: Page, watch: Watch, service: Service, small_sphere: Path, axe: str
) -> None:
    watch.allow("status of 4")  # a file that is none, and a prompt that says nothing
    page.goto("/")
    page.get_by_role("link", name="Many files").click()
    cards = page.get_by_role("list", name="Before and after").locator(":scope > li")
    expect(cards).to_have_count(6)  # samples, which files of one's own take the place of
    sphere = small_sphere.read_bytes()
    zipped = packed({"pets/a.obj": sphere, "pets/b.obj": sphere, "pets/notes.txt": b"-", ".hidden/c.obj": sphere})
    page.get_by_label("Asset files").set_input_files({"name": "ball.obj", "mimeType": "", "buffer": sphere})
    expect(cards).to_have_count(1)
    open_form(page)  # where several files are too many
    drop(page, {"ball.obj": sphere, "broken.glb": b"glTF no more", "all.zip": zipped})
    expect(cards).to_have_count(4)
    expect(page.get_by_text("1 other file left out.")).to_be_visible()
    broken, tally = cards.filter(has_text="broken.glb"), page.locator("#many-tally")
    until_text(tally, "4 files: 3 read, 1 not possible")
    expect(broken.locator(".field-problem")).not_to_be_empty()
    with page.expect_request("**/v1/jobs:parts"):
        broken.get_by_role("button", name="Try again").click()
    until_text(tally, "4 files: 3 read, 1 not possible")

    page.get_by_label("What all should become").fill("20 % taller")
    until_text(tally, "4 files: 3 ready to keep, 1 not possible")
    assert barriers(page, axe) == []
    assert watch.posted() == []
    ready = archive_of(page)
    assert sorted(ready) == ["all/pets/a.glb", "all/pets/b.glb", "ball.glb", "summary.csv"]
    assets = [load_asset(sphere, "ball.obj"), load_asset(ready["ball.glb"])]
    heights = [np.ptp(asset.surface.positions[:, 1]) for asset in assets]
    np.testing.assert_allclose(heights[1] / heights[0], 1.2, rtol=1e-3)
    rows = list(csv.DictReader(io.StringIO(ready["summary.csv"].decode())))
    assert {row["file"]: row["state"] for row in rows}["broken.glb"] == "Not possible"
    assert all(row["why"] if row["file"] == "broken.glb" else not row["why"] for row in rows)

    page.get_by_role("button", name="Keep 3").click()
    until_text(tally, "4 files: 3 kept, 1 not possible")
    expect(page).to_have_url(re.compile(r"#/many/m\w+$"))
    page.reload()
    until_text(tally, "3 files: 3 kept")
    expect(page.get_by_label("What all should become")).to_have_value("20 % taller")
    expect(cards.first.get_by_role("link", name="Open")).to_be_visible()
    kept = archive_of(page)
    assert {name: data for name, data in kept.items() if name != "summary.csv"} == {
        name: data for name, data in ready.items() if name != "summary.csv"
    }, "a job makes what its preview showed"

    # Other words for the same files, without sending them anew; and what they do not know.
    page.get_by_label("What all should become").fill("a blorptwist")
    until_text(tally, "3 files: 3 not possible")
    page.get_by_label("What all should become").fill("20 % taller")
    until_text(tally, "3 files: 3 kept")
    page.get_by_role("button", name="Take ball.obj off the wall").click()
    expect(cards).to_have_count(2)
    assert len(watch.posted()) == 3
