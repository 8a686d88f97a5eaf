"""`/docs`: a page with contents, links that lead somewhere, and colours that can be read in light and dark."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from service.documentation.reference import reference_page
from tests.cases import each_case


@pytest.fixture(scope="module")
def document(repository: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((repository / "openapi" / "openapi.json").read_text())
    return found


class Links(HTMLParser):
    """Collects the ids and links of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.ids, self.hrefs, self.tags = list[str](), list[str](), set[str]()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        found = dict(attrs)
        self.ids += [found["id"] or ""] if "id" in found else []
        self.hrefs += [found["href"] or ""] if "href" in found else []


def test_the_contents_lead_to_every_operation(document: dict[str, Any]) -> None:
    page = reference_page(document)
    contents = Links(page[page.index("<nav") : page.index("</nav>")])
    operations = {each["operationId"] for methods in document["paths"].values() for each in methods.values()}
    assert len(operations) > 30
    assert operations | {f"tag-{tag['name']}" for tag in document["tags"]} <= {each[1:] for each in contents.hrefs}
    whole = Links(page)
    assert len(whole.ids) == len(set(whole.ids))
    assert {each[1:] for each in whole.hrefs if each.startswith("#")} <= set(whole.ids)
    assert {each for each in whole.hrefs if not each.startswith("#")} == {"./", "openapi.json"}
    assert "script" not in whole.tags
    assert "svg" in whole.tags


def test_the_page_is_rendered_once(document: dict[str, Any]) -> None:
    assert reference_page(document) is reference_page(document)
    other = {**document, "info": {**document["info"], "title": "Another"}}
    assert "Another API" in reference_page(other)


def luminance(colour: str) -> float:
    parts = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@each_case("scheme", ["light", "dark"])
def test_every_text_can_be_read(scheme: str, document: dict[str, Any]) -> None:
    """Compute the contrast by WCAG 2.2: at least 4.5."""
    style = re.search(r"<style>(.*)</style>", reference_page(document), re.DOTALL)
    assert style is not None
    block = re.search(rf"color-scheme: {scheme};(.*?)\}}", style[1], re.DOTALL)
    assert block is not None
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", block[1]))
    for text, ground in (("accent", "ground"), ("accent-strong", "ground"), ("ink", "ground"), ("ink", "sunken")) + (
        ("muted", "ground"),
        ("good", "ground"),
    ):
        low, high = sorted([luminance(colours[text]), luminance(colours[ground])])
        assert (high + 0.05) / (low + 0.05) >= 4.5, (text, ground)
    assert "a { color: var(--accent) }" in style[1]
