"""The notebook, the example programs and every snippet of docs/client.md are run, against a real service and worker."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.acceptance.service import Service
from tests.cases import each_case

pytestmark = pytest.mark.slow

QUICK = {"preset": "preview", "steps": 4, "seed": 7, "guidance": {"orientation": "keep"}}


@pytest.fixture
def folder(tmp_path: Path, repository: Path) -> Path:
    """A folder with the examples, to work in."""
    (tmp_path / "examples").symlink_to(repository / "examples")
    return tmp_path


def run(service: Service, folder: Path, *arguments: str) -> str:
    environment = {**os.environ, "MESHDEFORM_URL": str(service.http.base_url)}
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}\n{service.log[-3000:]}"
    return done.stdout


def notebook(repository: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((repository / "examples" / "client.ipynb").read_text())
    return document


def shown(cell: str, names: dict[str, Any]) -> Any:
    """Run a cell and return what a notebook would show: the value of its last expression."""
    tree = ast.parse(cell)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "<cell>", "exec"), names)
    return eval(compile(ast.Expression(last.value), "<cell>", "eval"), names) if isinstance(last, ast.Expr) else None


def test_the_notebook_runs_from_its_first_cell_to_its_last(
    service: Service,
    folder: Path,
    repository: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(repository / "examples")
    monkeypatch.setenv("MESHDEFORM_URL", str(service.http.base_url))
    names: dict[str, Any] = {"__name__": "__main__"}
    values: dict[str, Any] = {}
    pictures: dict[str, int] = {}
    for cell in notebook(repository)["cells"]:
        if cell["cell_type"] != "code":
            continue
        values[cell["id"]] = value = shown("".join(cell["source"]), names)
        if hasattr(value, "_repr_html_"):
            pictures[cell["id"]] = value._repr_html_().count("data:image/png;base64,")
        if "parameters" in cell["metadata"].get("tags", ()):
            names["params"] = QUICK
    printed = capsys.readouterr().out
    assert "builtin knows" in printed
    assert "prompt_unknown_words" in printed
    assert "step 4 of 4" in printed
    assert "succeeded" in printed
    assert values["run"]._repr_png_().startswith(b"\x89PNG")
    assert pictures == {"run": 1, "other": 2}
    assert "4 steps" in values["validate"]
    assert values["save"] == ["preview.png", "report.json", "result.glb"]


def snippets(repository: Path) -> list[str]:
    text = (repository / "docs" / "client.md").read_text()
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


@each_case("number", range(5))
def test_a_snippet_of_the_page_does_what_it_says(service: Service, folder: Path, repository: Path, number: int) -> None:
    blocks = snippets(repository)
    assert len(blocks) == 5
    printed = run(service, folder, "-c", blocks[number])
    if number == 0:
        assert sorted(path.name for path in (folder / "mushroom").iterdir()) == [
            "preview.png",
            "report.json",
            "result.glb",
        ]
    if number == 1:
        assert "5120 triangles; 20 steps" in printed
        assert "100%" in printed
        assert "succeeded" in printed
    if number == 3:
        assert "quixotic" in printed


def test_the_example_programs_run(service: Service, folder: Path) -> None:
    printed = run(service, folder, "examples/client.py", "examples/sphere.glb", "a mushroom", "one", "--seed", "1")
    assert sorted(printed.split()) == ["one/preview.png", "one/report.json", "one/result.glb"]
    prompts = ["a mushroom", "a vase", "a quixotic zeitgeist"]
    printed = run(service, folder, "examples/client_async.py", "examples/cube.glb", "many", *prompts)
    assert "a quixotic zeitgeist: prompt_unknown_words" in printed
    assert (folder / "many" / "a_vase" / "result.glb").stat().st_size > 1000
    assert (folder / "many" / "a_mushroom" / "result.glb").exists()
