"""`python -m training.evaluation` as a person runs it: with the real prior, a judge that stands in, and few steps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cases import each_case
from training.evaluation.__main__ import main

pytestmark = pytest.mark.training

JUDGE = "tests.unit.evaluation.stand_ins:HeightJudge"
FIRST = "sphere--a-mushroom--seed0"
QUICK = ["--kind", "sds", "--set", "steps=2", "--set", "orientation=keep"]
"""Without the search for the front, which takes longer than the steps."""


def results(out: Path) -> dict[str, Any]:
    return dict(json.loads((out / "results.json").read_text()))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two items."""
    out = tmp_path_factory.mktemp("eval") / "run"
    main(["--out", str(out), "--judge", JUDGE, "--limit", "2", *QUICK])
    return out


def test_a_run_leaves_files_rows_tables_and_a_sheet(finished: Path) -> None:
    document = results(finished)
    assert document["manifest"]["kind"] == "sds"
    assert document["manifest"]["judge"]["id"] == "height"
    assert document["manifest"]["clip"] is None
    assert document["summary"]["retrieval"]["count"] == 2
    assert [row["name"] for row in document["rows"]] == [FIRST, "cube--a-tall-vase--seed0"]
    assert all(row["state"] == "succeeded" and row["steps"] == 2 and row["clip"] is None for row in document["rows"])
    assert {path.name for path in (finished / FIRST).iterdir()} == {"result.glb", "report.json", "preview.png"}
    assert (finished / "sheet.png").stat().st_size > 0
    assert "| a tall vase" in (finished / "table.md").read_text()


def test_results_are_judged_again_and_compared(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["--out", str(finished), "--judge", "none", "--rejudge"])
    assert results(finished)["manifest"]["judge"] is None
    assert results(finished)["summary"]["retrieval"] is None
    main(["--out", str(finished), "--judge", JUDGE, "--rejudge"])
    assert results(finished)["summary"]["retrieval"]["count"] == 2
    capsys.readouterr()
    main(["--compare", str(finished), str(finished)])
    assert capsys.readouterr().out.count("run: small, sds") == 1


def test_the_folder_of_another_run_is_refused(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="other params"):
        main(["--out", str(finished), "--judge", JUDGE, *QUICK, "--set", "learning_rate=0.02"])


@each_case(
    ("options", "said"),
    [
        (["--suite", "paper"], "shaped"),
        (["--suite", "assets"], "--assets"),
        (["--suite", "assets", "--assets", "."], "CesiumMilkTruck.glb"),
        (["--rejudge"], "There is no run"),
        (["--compare", "nowhere"], "no results"),
        (["--clip", "nowhere"], "no CLIP model"),
    ],
)
def test_what_cannot_be_run_is_said_before_anything_is_written(tmp_path: Path, options: list[str], said: str) -> None:
    with pytest.raises(SystemExit, match=said):
        main(["--out", str(tmp_path / "run"), "--judge", JUDGE, *options])
    assert not (tmp_path / "run").exists()
