"""The tests that the documentation names exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from tests.cases import each_case

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs/testing.md").read_text()
PROMISES = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", TEXT)))


@each_case(("file", "test"), PROMISES)
def test_a_test_that_holds_a_promise_exists_and_is_in_the_suite(file: str, test: str) -> None:
    tree = ast.parse((ROOT / file).read_text())
    found = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    assert test in found
    marks = {ast.unparse(mark) for mark in found[test].decorator_list}
    assert "pytest.mark.training" not in marks


def test_every_test_file_that_a_page_names_exists() -> None:
    files = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    for page in sorted((ROOT / "docs").glob("*.md")):
        named = set(re.findall(r"`(?:tests/[\w/]*/)?(test_\w+\.py)`", page.read_text()))
        assert named <= files, f"{page.name} names {sorted(named - files)}"
