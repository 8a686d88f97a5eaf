"""`meshdeform family-synthesize`: a fitted folder in, shapes out; and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench.parametric_families import family, labels_document
from meshdeform.cli.app import app

_SMALL = ["--points", "20", "--set", "samples=50", "--set", "iterations=2", "--set", "epochs=2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of ten chairs, and the family that was fitted to it, twice."""
    place = tmp_path_factory.mktemp("families")
    (place / "chairs").mkdir()
    members = family("chairs", 10)
    for member in members:
        (place / "chairs" / member.name).write_bytes(member.glb())
    (place / "chairs/labels.json").write_text(json.dumps(labels_document("chairs", members, 10)), encoding="utf-8")
    fit = ["family-fit", str(place / "chairs"), "-o", str(place / "fitted"), *_SMALL, "-q"]
    assert CliRunner().invoke(app, [*fit, "--embed-labels"]).exit_code == 0
    assert (place / "fitted/labelled.zip").is_file()
    made = CliRunner().invoke(app, fit)
    assert made.exit_code == 0, made.output
    return place


def test_a_fit_without_labelled_assets_leaves_none_of_an_earlier_one(folder: Path) -> None:
    assert not (folder / "fitted/labelled.zip").exists()
    assert (folder / "fitted/family.safetensors").is_file()


def test_shapes_are_made_and_made_again(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "new"
    command = ["family-synthesize", str(folder / "fitted"), str(folder / "chairs"), "-o", str(out)]
    made = CliRunner().invoke(app, [*command, "--count", "1", "--json"])
    assert made.exit_code == 0, made.output
    summary = json.loads(made.stdout)
    assert set(summary["files"]) == {path.name for path in out.iterdir()}
    assert "result.glb" in summary["files"]
    assert len(summary["shapes"]) == 1
    found = CliRunner().invoke(app, [*command, "--mode", "search", "--member", "chair_0002", "--count", "2"])
    assert found.exit_code == 0, found.output
    assert found.output.count("chair_0") == 2
    assert {path.name for path in out.iterdir()} == {
        "report.json",
        "preview.png",
        "wall.glb",
    }  # none of the shapes before


def test_what_is_missing_is_said(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/preview.png").write_bytes(b"mine")
    fitted, chairs = str(folder / "fitted"), str(folder / "chairs")
    for arguments, words in (
        (["family-synthesize", fitted], "The collection is missing."),
        (["family-synthesize", str(tmp_path / "empty"), chairs], "There is no family.safetensors"),
        (["family-synthesize", fitted, str(tmp_path / "empty")], "holds no asset"),
        (["family-synthesize", fitted, chairs, "--mode", "complete"], "takes one member"),
        (["family-synthesize", fitted, chairs, "-o", str(tmp_path / "mine")], "was not written by an earlier run"),
        (["family-fit", str(tmp_path / "empty")], "holds no asset"),
    ):
        refused = CliRunner().invoke(app, arguments)
        assert refused.exit_code not in {0, 1}, refused.output
        assert words in refused.output.replace("\n", " ")
        assert "ZIP" not in refused.output or "collection" in refused.output
    assert (tmp_path / "mine/preview.png").read_bytes() == b"mine"
