"""`meshdeform family-fit`: a ZIP in, a folder out, Ctrl-C and going on, and what is refused."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench.parametric_families import family, labels_document, packed
from meshdeform.cli.app import app
from meshdeform.runs.family_fit import FamilyFitRun

_SMALL = ["--points", "20", "--set", "samples=50", "--set", "iterations=2", "--set", "epochs=2"]
_FILES = {
    "report.json", "preview.png",
    "wall.glb", "segmentation.npz", "correspondences.npz", "descriptors.npz", "family.safetensors"
}  # fmt: skip


@pytest.fixture(autouse=True)
def chairs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten chairs and their labels in the current folder."""
    monkeypatch.chdir(tmp_path)
    members = family("chairs", 10)
    Path("chairs.zip").write_bytes(packed(members))
    Path("labels.json").write_text(json.dumps(labels_document("chairs", members, 6)), encoding="utf-8")


def test_a_fit_is_interrupted_and_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["family-fit", "chairs.zip", "--labels", "labels.json", *_SMALL]
    infer = FamilyFitRun._infer

    def interrupted(self: FamilyFitRun) -> dict[str, float]:
        signal.raise_signal(signal.SIGINT)
        return infer(self)

    with monkeypatch.context() as patch:
        patch.setattr(FamilyFitRun, "_infer", interrupted)
        stopped = CliRunner().invoke(app, [*command, "--checkpoint", "chairs.state"])
    assert stopped.exit_code == 130, stopped.output
    assert "Interrupted at step 11 of 14. The state is in chairs.state." in stopped.output
    assert not list(Path("chairs-family").iterdir())
    made = CliRunner().invoke(app, [*command, "--resume", "chairs.state", "--json"])
    assert made.exit_code == 0, made.output
    summary = json.loads(made.stdout)
    assert summary["resumed"] is True
    assert summary["accuracy"]["held_out"] == 4
    assert set(summary["files"]) == _FILES == {path.name for path in Path("chairs-family").iterdir()}


def test_files_of_the_user_are_kept() -> None:
    Path("mine").write_bytes(b"mine")
    Path("folder").mkdir()
    Path("folder/report.json").write_bytes(b"mine")
    for options, words in (
        (["-o", "mine"], "cannot be written"),
        (["-o", "folder"], "was not written by an earlier run"),
        (["--checkpoint", "mine"], "is not a checkpoint"),
        (["--checkpoint", "chairs.zip"], "is not a checkpoint"),
        (["--points", "5"], "points"),
    ):
        refused = CliRunner().invoke(app, ["family-fit", "chairs.zip", *_SMALL, *options])
        assert refused.exit_code not in {0, 1}, options
        assert words in refused.output
    assert Path("mine").read_bytes() == Path("folder/report.json").read_bytes() == b"mine"
