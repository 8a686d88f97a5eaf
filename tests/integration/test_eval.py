"""`python -m training.evaluation` as a person runs it: with the real prior, a judge that stands in, and few steps."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image
from typer.testing import CliRunner, Result

from meshdeform.priors import load_prior
from tests.cases import each_case
from training.evaluation.__main__ import app
from training.evaluation.mesh_file import read_ply

JUDGE = "tests.unit.evaluation.stand_ins:HeightJudge"
FIRST = "sphere--a-mushroom--seed0"
KEEP = ["--set", "orientation=keep"]
"""Without the search for the front, which takes longer than the steps."""
QUICK = ["--steps", "2", "--checkpoint-at", "1", "--jobs", "1", *KEEP]


def evaluated(out: Path, *options: str, judge: str = JUDGE) -> Result:
    return CliRunner().invoke(app, ["--out", str(out), "--judge", judge, *options])


def results(out: Path) -> dict[str, Any]:
    return dict(json.loads((out / "results.json").read_text()))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three items."""
    out = tmp_path_factory.mktemp("eval") / "run"
    done = evaluated(out, *QUICK, "--limit", "3")
    assert done.exit_code == 0, done.output
    assert "3 of 48 done, 0 failed" in done.stdout
    return out


@pytest.fixture(autouse=True)
def _threads() -> Iterator[None]:
    """The command sets torch's threads for its process, which here is the tests'."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_a_run_leaves_records_meshes_pictures_tables_and_a_sheet(finished: Path) -> None:
    document = results(finished)
    assert [row["steps"] for row in document["summary"]] == [1, 2]
    assert document["summary"][1]["overall"]["retrieval"]["count"] == 3
    assert document["manifest"]["params"]["steps"] == 2
    assert document["manifest"]["judge"]["id"] == "height"
    assert document["manifest"]["dtype"] == str(load_prior("builtin", device="cpu").dtype).removeprefix("torch.")
    assert document["manifest"]["clip"] == {"missing": "no folder was given with --clip"}
    assert all(state["clip"] is None for record in document["records"] for state in record["states"])
    assert len(document["records"]) == 3
    place = finished / "items" / FIRST
    rest = read_ply((finished / "sources/sphere.ply").read_bytes())
    one, two = (read_ply((place / f"steps-00000{n}.ply").read_bytes()) for n in (1, 2))
    assert not torch.equal(one.verts, two.verts)
    assert (two.verts - rest.verts).norm(dim=1).max() < 0.3
    with Image.open(place / "steps-000002.png") as picture, Image.open(finished / "sheet.png") as sheet:
        assert picture.size == (192, 192)
        assert sheet.size == (7 * 144, 164)  # three results of twelve: after the four sources, in a row
    assert "By source, after 2 steps" in (finished / "table.md").read_text()


def test_a_failing_item_is_recorded_the_others_go_on_and_the_next_run_tries_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from training.evaluation import evaluator

    real, out = evaluator.measures, tmp_path / "run"

    def broken(rest: Any, *others: Any) -> Any:
        if len(rest.faces) == 2028:
            raise RuntimeError("the cube broke")
        return real(rest, *others)

    monkeypatch.setattr(evaluator, "measures", broken)
    done = evaluated(out, *QUICK, "--limit", "3")
    assert done.exit_code == 0
    assert "2 of 48 done, 1 failed" in done.stdout
    assert "cube, a tall vase, seed 0: RuntimeError: the cube broke" in (out / "table.md").read_text()
    failed = [record for record in results(out)["records"] if record["failed"]]
    assert failed[0]["failed"]["error"] == "RuntimeError"
    monkeypatch.undo()
    assert "3 of 48 done, 0 failed" in evaluated(out, *QUICK, "--limit", "3").stdout


@each_case(
    ("options", "code", "said"),
    [
        (["--suite", "large"], 3, "no suite"),
        (["--suite", "paper"], 3, "shaped"),
        (["--suite", "assets"], 2, "--assets"),
        (["--suite", "assets", "--assets", "."], 3, "CesiumMilkTruck.glb"),
        (["--assets", "."], 3, "Omit --assets"),
        (["--set", "no_such=1"], 3, "no_such"),
        (["--set", "learning_rate=-1"], 3, "learning_rate"),
        (["--set", "learning_rate"], 2, "NAME=VALUE"),
        (["--set", "seed=1"], 2, "--seeds"),
        (["--seeds", "one"], 2, "list of numbers"),
        (["--prior", "dream"], 2, "builtin or sd"),
        (["--model", "/nowhere"], 2, "--prior sd"),
        (["--model", "nowhere.safetensors"], 4, "nowhere.safetensors"),
        (["--steps", "5", "--checkpoint-at", "6"], 3, "after the last step"),
        (["--prior", "sd", "--model", "/nowhere"], 4, "/nowhere"),
        (["--rejudge"], 3, "There is no run"),
        (["folder"], 2, "--compare"),
        (["--compare"], 2, "--compare"),
    ],
)
def test_what_cannot_be_run_is_said_before_anything_is_written(
    tmp_path: Path, options: list[str], code: int, said: str
) -> None:
    refused = evaluated(tmp_path / "run", *options)
    assert refused.exit_code == code, refused.output
    assert said in " ".join(refused.stderr.replace("│", " ").split())
    assert not (tmp_path / "run").exists()
