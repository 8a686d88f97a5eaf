"""The page's scripts that need no browser: the tests of tests/web, as `node --test` runs them."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.cases import each_case

ROOT = Path(__file__).parents[2]
WEB = ROOT / "service" / "web"
OWN = [WEB / "index.html", *sorted((WEB / "app").rglob("*.js")), *sorted((WEB / "style").rglob("*.css"))]
CLIENT = sorted((WEB / "client").glob("*.js"))


def test_the_scripts_do_what_their_tests_say() -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    tests = sorted(str(path) for path in (ROOT / "tests" / "web").glob("*.test.js"))
    assert tests
    # One process for all files: `node --test` starts one for each, which takes longer than what it tests.
    every = "for (const file of process.argv.slice(1)) await import(file);"
    command = [node, "--input-type=module", "--eval", every, *tests]
    found = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    passed = re.search(r"pass (\d+)", found.stdout)
    assert passed is not None
    assert int(passed[1]) >= len(tests)


@each_case("path", [*OWN, *CLIENT], ids=lambda path: str(path.relative_to(WEB)))
def test_nothing_that_the_policy_forbids_and_nothing_that_reads_data_as_html(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert not re.search(r"\b(?:innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(|new Function)", text)
    if path in CLIENT:  # compiled; its defaults and examples name hosts, the page's tests watch what is asked
        return
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)[\w.]+", text), "another host"
    if path.suffix == ".html":
        assert " style=" not in text
        assert not re.search(r"\son\w+=", text)
        assert not re.search(r"<script(?![^>]*\ssrc=)", text)
    if path.suffix == ".js" and path.name != "early.js":
        assert text.startswith("// @ts-check\n")


def test_every_file_that_the_page_names_is_there() -> None:
    named = re.findall(r'(?:src|href)="(web/[^"]+)"', (WEB / "index.html").read_text(encoding="utf-8"))
    named += [f"web/examples/{name}" for name in re.findall(r'name: "(\w+\.glb)"', _script("create/asset-panel.js"))]
    assert len(named) > 8
    for name in named:
        assert (WEB / name.removeprefix("web/")).is_file(), name
    for path in sorted((WEB / "style").glob("*.css")):
        for name in re.findall(r'url\("([^"]+)"\)', path.read_text(encoding="utf-8")):
            assert (path.parent / name).is_file(), name


def test_the_examples_are_small_and_every_one_is_deformable() -> None:
    from meshdeform.assets import inspect_asset

    files = sorted((WEB / "examples").glob("*.glb"))
    assert sum(path.stat().st_size for path in files) < 400_000
    for path in files:
        assert inspect_asset(path.read_bytes(), path.name).triangles > 1000


def _script(name: str) -> str:
    return (WEB / "app" / name).read_text(encoding="utf-8")
