"""The tests that the documentation names exist."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

from tests.cases import each_case

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs/testing.md").read_text()
PROMISES = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", TEXT)))


@functools.cache
def _functions(file: str) -> dict[str, ast.FunctionDef]:
    """Return the functions of a file, which holds several promises."""
    tree = ast.parse((ROOT / file).read_text())
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@each_case(("file", "test"), PROMISES)
def test_a_test_that_holds_a_promise_exists_and_is_in_the_suite_or_said_to_be_long(file: str, test: str) -> None:
    found = _functions(file)
    assert test in found
    marks = {ast.unparse(mark) for mark in found[test].decorator_list}
    left_out = bool(marks & {"pytest.mark.long", "pytest.mark.training"})
    assert (f"`{file}::{test}` (long)" in TEXT) is left_out


def test_every_test_file_that_a_page_names_exists() -> None:
    files = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    for page in sorted((ROOT / "docs").glob("*.md")):
        named = set(re.findall(r"`(?:tests/[\w/]*/)?(test_\w+\.py)`", page.read_text()))
        assert named <= files, f"{page.name} names {sorted(named - files)}"


def test_every_file_on_the_walk_of_a_job_exists() -> None:
    walk = (ROOT / "docs/architecture.md").read_text().partition("## The walk of one job")[2]
    named = re.findall(r"`((?:service|meshdeform|worker|bench|tests)/[\w/.]+)`", walk)
    assert len(named) > 40
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_what_the_page_says_where_to_look_is_there() -> None:
    section = (ROOT / "docs/architecture.md").read_text().partition("## Where to look")[2].partition("\n## ")[0]
    named = re.findall(r"`([\w/]+\.py)` \(`(\w+)`\)", section)
    assert len(named) > 8
    for path, name in named:
        tree = ast.parse((ROOT / path).read_text())
        assert name in {node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)}, path
