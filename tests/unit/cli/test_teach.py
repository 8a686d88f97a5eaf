"""`meshdeform teach` with a small network: its files, Ctrl-C and going on, use, and what is refused."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest
from PIL import Image
from safetensors import safe_open
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.priors.builtin.taught import known_words
from meshdeform.priors.builtin.teaching.teacher import Trainer
from tests.cases import each_case
from tests.taught import shorten_lessons, write_small_weights
from tests.unit.cli.lines import done, refused

_TEACH = "teach gnomes --noun gnome --synonym dwarf --licence CC0-1.0 --model small.safetensors --steps 3"


@pytest.fixture(autouse=True)
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a folder of three meshes and small weights current, and lessons short."""
    import trimesh

    monkeypatch.chdir(tmp_path)
    write_small_weights(Path("small.safetensors"))
    Path("gnomes/tall").mkdir(parents=True)
    Path("gnomes/notes.txt").write_text("no mesh")
    trimesh.creation.icosphere(1).export("gnomes/round.glb")
    trimesh.creation.box((1, 1, 1)).export("gnomes/square.obj")
    trimesh.creation.cylinder(0.3, 2, sections=8).export("gnomes/tall/can.stl")
    shorten_lessons(monkeypatch)


def test_a_lesson_is_interrupted_resumed_taught_again_listed_and_used(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "of 2 held-out pictures are taken for a gnome" in done(f"{_TEACH} -o whole.safetensors").output
    step = Trainer.step

    def interrupted(self: Trainer) -> float:
        signal.raise_signal(signal.SIGINT)
        return step(self)

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "step", interrupted)
        stopped = CliRunner().invoke(app, f"{_TEACH} -o mine.safetensors --checkpoint mine.state".split())
    assert stopped.exit_code == 130, stopped.output
    assert "Interrupted at step 1 of 3. The state is in mine.state." in stopped.output
    assert not Path("mine.safetensors").exists()
    assert "another lesson" in refused(f"{_TEACH} -o mine.safetensors --seed 1 --resume mine.state")
    made = done(f"{_TEACH} -o mine.safetensors --resume mine.state --json")
    assert _contents("mine.safetensors") == _contents("whole.safetensors")

    report = json.loads(Path("mine.report.json").read_text())
    assert json.loads(made.stdout)["retrieval"] == report["retrieval"]
    attributes = {mesh["name"]: mesh["attributes"] for mesh in report["nouns"][0]["meshes"]}
    assert attributes == {"round.glb": [], "square.obj": [], "tall/can.stl": ["tall"]}
    with Image.open("mine.preview.png") as picture:
        assert picture.width > 4 * 64

    done("teach gnomes/round.glb --model mine.safetensors --steps 1 --noun", "a milk jug")
    Path("milk-jug.safetensors").rename("two.safetensors")
    assert set(known_words("two.safetensors").nouns) == {"bowl", "heart", "vase", "gnome", "milk-jug"}

    Path("models").mkdir()
    Path("two.safetensors").rename("models/two.safetensors")
    Path("models/broken.safetensors").write_bytes(b"broken")
    monkeypatch.setenv("MESHDEFORM_MODELS", "models")
    listed = json.loads(done("models --json").stdout)["models"]
    available = {model["title"]: model["available"] for model in listed}
    assert available == {"Builtin": True, "broken": False, "two": True}
    assert [lesson["noun"] for lesson in listed[2]["lessons"]] == ["gnome", "milk-jug"]
    assert listed[2]["licence"] == "CC0-1.0"
    described = done("models two.safetensors").output
    assert "gnome or dwarf, from round.glb, square.obj, tall/can.stl; labelled tall" in described

    run = "run gnomes/round.glb --steps 1 --set orientation=keep"
    done(f"{run} --model two.safetensors -o out.glb", "a tall dwarf")
    report = json.loads(Path("out.report.json").read_text())
    assert report["guidance"]["id"] == report["params"]["model"] == "two.safetensors"
    assert "likeness" not in report
    assert "dwarf" in refused(f"{run} --model builtin -o other.glb", "a tall dwarf")


def test_a_kit_says_its_nouns_and_takes_steps_for_each() -> None:
    Path("gnomes").rename("kit")
    Path("kit/square.obj").rename("kit/box.obj")
    kit = "teach kit --model small.safetensors"
    assert "'round' does not say what round.glb shows" in refused(kit)  # an adjective
    Path("kit/round.glb").rename("kit/ball.glb")
    Path("kit/tall").rename("kit/cans")
    again = done(f"{kit} --steps 2")
    assert "3 nouns and their meshes: ball (1), box (1), can (1)" in again.output
    assert {"ball", "box", "can"} <= set(known_words("kit.safetensors").nouns)
    assert "can: " in again.output
    assert "knows 'vase' already" in refused("teach kit --noun vase --model small.safetensors")


def _contents(path: str) -> tuple[dict[str, str], dict[str, bytes]]:
    """Return the metadata and the bytes of each tensor; the order of the metadata in a file is arbitrary."""
    with safe_open(path, framework="np") as file:
        return file.metadata(), {name: file.get_tensor(name).tobytes() for name in file.keys()}  # noqa: SIM118


@each_case(
    ("line", "said"),
    [
        ("empty", "There is no mesh"),
        ("many", "a lesson takes at most 200"),
        ("holiday", "does not name attributes"),
        ("face.obj", "face.obj has 1 faces"),
        ("gnomes/notes.txt", "notes.txt"),
        ("gnomes -o mine.safetensors", "was not written by an earlier run"),
        ("gnomes -o mine.glb", "does not end in"),
        ("gnomes --checkpoint mine.state", "is not a checkpoint"),
        ("gnomes --resume mine.state", "cannot be read"),
        ("gnomes --model mine.safetensors", "not safetensors"),
        ("gnomes --model owner/model", "cannot be taught"),
        ("gnomes -o small.safetensors", "is an input of this run"),
    ],
)
def test_what_cannot_be_taught_is_refused_before_anything_is_written(line: str, said: str) -> None:
    for folder in ("empty", "holiday/photos", "many"):
        Path(folder).mkdir(parents=True, exist_ok=True)
    for mesh in ("holiday/photos/a.glb", "holiday/b.glb"):
        Path(mesh).write_bytes(Path("gnomes/round.glb").read_bytes())
    Path("face.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for file in ("mine.safetensors", "mine.state", *(f"many/{number}.obj" for number in range(201))):
        Path(file).write_bytes(b"mine")
    before = sorted(Path().rglob("*"))
    model = [] if "--model" in line else ["--model", "small.safetensors"]
    assert said in refused(f"teach {line} --noun gnome --steps 1", *model)
    assert sorted(Path().rglob("*")) == before
    assert Path("mine.safetensors").read_bytes() == Path("mine.state").read_bytes() == b"mine"
