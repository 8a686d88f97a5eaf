"""The documentation becomes a site in which every link leads somewhere, and which asks no other host for anything."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def site(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(
        command,
        cwd=repository,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_is_there_and_says_something(site: Path, repository: Path) -> None:
    for page in (repository / "docs").glob("*.md"):
        built = site / f"{page.stem}.html"
        assert built.exists(), page.name
        assert len(re.findall(r"<h1", built.read_text())) == 1, page.name
    assert "Unreleased" in (site / "changes.html").read_text()


def test_the_site_loads_nothing_from_other_hosts(site: Path) -> None:
    loading = re.compile(r'<(?:script|img|link|iframe)\b[^>]*?\b(?:src|href)="?((?:https?:)?//[^\s">]+)')
    for built in site.glob("*.html"):
        assert loading.findall(built.read_text()) == [], built.name


def test_llms_txt_leads_to_every_page_that_it_names(site: Path) -> None:
    text = (site / "llms.txt").read_text()
    assert text.startswith("# Meshdeform\n")
    named = re.findall(r"\]\(([^)]+)\): \S", text)
    assert {"quickstart.html", "mcp.html", "http.html"} <= set(named)
    assert all((site / name).exists() for name in named)
