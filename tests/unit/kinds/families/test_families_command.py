"""`meshdeform family-fit` and `family-synthesize`: a folder or ZIP in, a folder out, Ctrl-C, and what is refused."""

from __future__ import annotations

import json
import signal
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bench.parametric_families import family, labels_document, packed
from meshdeform.cli.app import app
from meshdeform.kinds.families.commands import _shape_lines
from meshdeform.kinds.families.fit_run import FamilyFitRun
from tests.cases import each_case
from tests.unit.cli.lines import done, refused

_SMALL = "--points 20 --set samples=50 --set iterations=2 --set epochs=2 --set read=false"
_FILES = {
    "report.json", "preview.png",
    "wall.glb", "segmentation.npz", "correspondences.npz", "descriptors.npz", "family.safetensors"
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The current folder, with ten chairs as files and as a ZIP, and a family that was fitted to them."""
    members = family("chairs", 10)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place := tmp_path_factory.mktemp("families"))
        for name in ("chairs", "empty", "mine"):
            Path(name).mkdir()
        for member in members:
            Path("chairs", member.name).write_bytes(member.glb())
        Path("chairs/labels.json").write_text(json.dumps(labels_document("chairs", members, 10)), encoding="utf-8")
        Path("chairs.zip").write_bytes(packed(members))
        with zipfile.ZipFile("chairs.zip", "a") as archive:
            archive.writestr("labels.json", json.dumps(labels_document("chairs", members, 6)))
        for mine in ("mine.txt", "mine/report.json", "mine/preview.png"):
            Path(mine).write_bytes(b"mine")
        done(f"family-fit chairs -o fitted {_SMALL} -q")
        yield place


def names(folder: str) -> set[str]:
    return {path.name for path in Path(folder).iterdir()}


def test_a_fit_is_interrupted_and_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    command = f"family-fit chairs.zip {_SMALL}"
    infer = FamilyFitRun._infer

    def interrupted(self: FamilyFitRun) -> dict[str, float]:
        signal.raise_signal(signal.SIGINT)
        return infer(self)

    with monkeypatch.context() as patch:
        patch.setattr(FamilyFitRun, "_infer", interrupted)
        stopped = CliRunner().invoke(app, f"{command} --checkpoint chairs.state".split())
    assert stopped.exit_code == 130, stopped.output
    said = "Interrupted at step 11 of 14. What was done so far is in chairs-family. The state is in chairs.state."
    assert said in " ".join(stopped.output.split())
    assert names("chairs-family") == _FILES - {"family.safetensors"}
    assert json.loads(Path("chairs-family/report.json").read_bytes())["unfinished"]["step"] == 11
    summary = json.loads(done(f"{command} --resume chairs.state --json").stdout)
    assert summary["resumed"] is True
    assert summary["accuracy"]["held_out"] == 4
    assert set(summary["files"]) == _FILES == names("chairs-family")


def test_an_interrupted_fit_leaves_the_whole_results_of_an_earlier_one(monkeypatch: pytest.MonkeyPatch) -> None:
    done(f"family-fit chairs -o whole {_SMALL} -q")
    before = {path: path.read_bytes() for path in Path("whole").iterdir()}
    learn = FamilyFitRun._learn

    def interrupted(self: FamilyFitRun) -> dict[str, float]:
        signal.raise_signal(signal.SIGINT)
        return learn(self)

    with monkeypatch.context() as patch:
        patch.setattr(FamilyFitRun, "_learn", interrupted)
        stopped = CliRunner().invoke(app, f"family-fit chairs -o whole {_SMALL} --seed 1".split())
    assert stopped.exit_code == 130, stopped.output
    assert "Interrupted at step 13 of 14. Nothing was written." in " ".join(stopped.output.split())
    assert {path: path.read_bytes() for path in Path("whole").iterdir()} == before


def test_a_fit_without_labelled_assets_leaves_none_of_an_earlier_one() -> None:
    done(f"family-fit chairs -o twice {_SMALL} -q --embed-labels")
    assert "labelled.zip" in names("twice")
    done(f"family-fit chairs -o twice {_SMALL} -q")
    assert names("twice") == _FILES


def test_shapes_are_made_and_made_again() -> None:
    command = "family-synthesize fitted chairs -o new"
    summary = json.loads(done(f"{command} --count 1 --json").stdout)
    assert set(summary["files"]) == names("new") > {"result.glb"}
    assert len(summary["shapes"]) == 1
    found = done(f"{command} --mode search --member chair_0002 --count 2").stdout
    assert found.count("chair_0") == 2
    assert names("new") == {"report.json", "preview.png", "wall.glb"}  # none of the shapes before


@each_case(
    ("line", "said"),
    [
        ("family-fit chairs.zip -o mine.txt", "cannot be written"),
        ("family-fit chairs.zip -o mine", "was not written by an earlier run"),
        ("family-fit chairs.zip --checkpoint mine.txt", "is not a checkpoint"),
        ("family-fit chairs.zip --checkpoint chairs.zip", "is not a checkpoint"),
        ("family-fit chairs.zip --points 5", "points"),
        ("family-fit empty", "There is no mesh"),
        ("family-synthesize fitted", "There is no"),
        ("family-synthesize empty chairs", "family.safetensors"),
        ("family-synthesize fitted empty", "There is no mesh"),
        ("family-synthesize fitted chairs --mode complete", "takes one member"),
        ("family-synthesize fitted chairs -o mine", "was not written by an earlier run"),
    ],
)
def test_what_cannot_be_done_is_said_and_files_of_the_user_are_kept(line: str, said: str) -> None:
    assert said in refused(line)
    for mine in ("mine.txt", "mine/report.json", "mine/preview.png"):
        assert Path(mine).read_bytes() == b"mine"


def test_a_shape_whose_parts_hang_apart_is_not_only_praised() -> None:
    parts = [{"part": "seat", "member": "a", "gap": 0.002}, {"part": "lid", "member": "b", "gap": 0.0449}]
    shape = {"name": "0.glb", "parts": parts, "loose": ["arm"], "nearest_members": [{"name": "c.glb", "distance": 0.1}]}
    whole = {**shape, "parts": parts[:1], "loose": []}
    summary = {"folder": "x", "files": [], "shapes": [shape, whole], "nearest_members": None}
    assert list(_shape_lines(summary))[2:] == [
        "0.glb  seat of a, lid of b; loose: arm; parts up to 4.5% apart; most like c.glb",
        "0.glb  seat of a; most like c.glb",
    ]
