"""Whole jobs on files, compared with doing nothing."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from meshdeform.assets import load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.requests.document import DeformParams, resolve
from tests.unit.runs.test_text_deform import glb
from training.evaluation import runner
from training.evaluation.plan import Plan
from training.evaluation.suite import Suite

JUDGE = "tests.unit.evaluation.stand_ins:HeightJudge"


def two_balls() -> bytes:
    return glb(join(icosphere(2), TriangleMesh(icosphere(2).verts + 1.5, icosphere(2).faces)))


def test_a_suite_of_files_measures_what_is_delivered(tmp_path: Path) -> None:
    source = tmp_path / "balls.glb"
    source.write_bytes(two_balls())
    pairs: Sequence[tuple[str, str]] = ((str(source), "a vase"),)
    suite = Suite("keep", (str(source),), ("a vase",), (0,), "preview", tuple(pairs), delivered=True)
    params = resolve(
        DeformParams.model_validate({"preset": "preview", "steps": 2, "guidance": {"orientation": "keep"}})
    )
    document = runner.run(Plan(suite, params, (1, 2), tmp_path / "run", judge=JUDGE), jobs=1, say=lambda line: None)
    (record,) = document["records"]
    assert record["failed"] is None
    assert [state["steps"] for state in record["states"]] == [1, 2]
    kept = record["states"][-1]["kept"]
    assert kept["structure"]["components"] == 2
    assert set(kept["noun_ranks"]) == {"source", "stretch", "result"}
    assert document["summary"][-1]["kept"]["count"] == 1
    folder = tmp_path / "run" / "items" / "balls--a-vase--seed0"
    before, after = (load_asset(path.read_bytes()).surface for path in (source, folder / "result.glb"))
    moved = float(((after.positions - before.positions) ** 2).sum(1).max() ** 0.5)
    assert moved > 0
    assert json.loads((folder / "report.json").read_text())["prompt"] == "a vase"
    assert (folder / "preview.png").stat().st_size > 0
    assert "## Kept" in (tmp_path / "run" / "table.md").read_text()
