"""Whole jobs on files, compared with doing nothing."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch

from meshdeform.assets import load_asset
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.requests.choices import Preset
from meshdeform.requests.document import DeformParams, resolve
from tests.unit.evaluation.stand_ins import HeightJudge
from tests.unit.runs.test_text_deform import glb
from training.evaluation import runner
from training.evaluation.delivered import best_stretch
from training.evaluation.plan import Plan
from training.evaluation.suite import KEEP_ASSETS, Suite, find_suite

JUDGE = "tests.unit.evaluation.stand_ins:HeightJudge"


class TallJudge(HeightJudge):
    """Takes a mesh for a vase the more, the taller it is for its width."""

    def noun_probabilities(self, mesh: TriangleMesh) -> dict[str, float]:
        size = mesh.verts.amax(0) - mesh.verts.amin(0)
        vase = float(torch.sigmoid(size[1] / size[0] - size[2] / size[0]))
        return {noun: vase if noun == "vase" else (1 - vase) / (len(NOUNS) - 1) for noun in NOUNS}


def two_balls() -> bytes:
    return glb(join(icosphere(2), TriangleMesh(icosphere(2).verts + 1.5, icosphere(2).faces)))


def test_the_best_stretch_is_what_the_judge_likes_best(tmp_path: Path) -> None:
    (tmp_path / "balls.glb").write_bytes(two_balls())
    stretch = best_stretch(TallJudge(), str(tmp_path / "balls.glb"), "vase")
    width, height, depth = stretch.factors
    assert (height, depth, width) == (2.0, 0.5, 0.5)
    assert stretch.rank == 1


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


def test_the_suite_knows_its_files(tmp_path: Path) -> None:
    suite = find_suite("keep")
    for asset in KEEP_ASSETS:
        assert parse(f"a {asset['noun']}").noun == asset["noun"]
        assert parse(asset["near"])
        assert parse(asset["far"])
    assert len(suite.items()) == 2 * len(KEEP_ASSETS) == 56
    with pytest.raises(ParameterError, match=r"Chair_1\.glb"):
        suite.in_folder(tmp_path)
    for name in suite.sources:
        (tmp_path / name).write_bytes(two_balls())
    with pytest.raises(ParameterError, match="another Chair_1"):
        suite.in_folder(tmp_path)


def test_a_change_in_plain_words_is_measured_without_steps(tmp_path: Path, repository: Path) -> None:
    source = str(repository / "examples" / "vase.glb")
    suite = Suite("keep", (source,), ("a tall vase",), (0,), "preview", ((source, "a tall vase"),), delivered=True)
    params = resolve(DeformParams(preset=Preset.PREVIEW))
    (record,) = runner.run(
        Plan(suite, params, (params.steps,), tmp_path / "run", judge=JUDGE), jobs=1, say=lambda line: None
    )["records"]
    assert record["failed"] is None
    assert (record["step_s_median"], record["pulls"]) == (0.0, {})
    report = json.loads((tmp_path / "run/items/vase--a-tall-vase--seed0/report.json").read_text())
    assert report["way"] == "change"
