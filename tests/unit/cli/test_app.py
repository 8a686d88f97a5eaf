"""The command line: quick, clean errors, distinct exit codes, nothing half written."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from meshdeform import errors
from meshdeform.assets import build_glb
from meshdeform.cli.app import app
from meshdeform.cli.exits import ExitCode, exit_code
from meshdeform.support.files import write_files
from tests.acceptance.service import until
from tests.cases import each_case

FIT = ["run", "sphere.glb", "--target", "egg.glb"]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder of a test, with a small sphere and, as a target, a taller one."""
    from meshdeform.geometry.shapes import icosphere

    mesh = icosphere(2)
    monkeypatch.chdir(tmp_path)
    for name, height in (("sphere", 1.0), ("egg", 1.6)):
        Path(f"{name}.glb").write_bytes(build_glb(mesh.verts * [1, height, 1], mesh.faces))
    return tmp_path


def made() -> dict[str, bytes]:
    """What the current folder has beside the assets."""
    return {path.name: path.read_bytes() for path in Path().iterdir() if path.name not in ("sphere.glb", "egg.glb")}


def run_here(*arguments: object) -> Result:
    """Run a command in this process, which has loaded torch already."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@each_case(
    ("arguments", "code", "said"),
    [
        (["run", "nowhere.glb", "a vase"], ExitCode.USAGE, "does not exist"),
        (["run", "bad.glb", "a vase"], ExitCode.BAD_INPUT, "Error: "),
        (["run", "sphere.glb", "a vase", "--steps", "0"], ExitCode.BAD_INPUT, "params.steps"),
        (["run", "sphere.glb", "a vase", "--param", "no_such=1"], ExitCode.BAD_INPUT, "no_such"),
        (["run", "sphere.glb", "a vase", "--param", "nonsense"], ExitCode.USAGE, "NAME=VALUE"),
        (["run", "sphere.glb", "a vase", "-o", "vase.obj"], ExitCode.USAGE, ".glb"),
        (["run", "sphere.glb", "a vase", "--preset", "fast"], ExitCode.USAGE, "fast"),
        (["serve", "--port", "70000"], ExitCode.USAGE, "65535"),
        (["worker"], ExitCode.BAD_INPUT, "MESHDEFORM_REDIS_URL"),
        (["api"], ExitCode.BAD_INPUT, "MESHDEFORM_REDIS_URL"),
    ],
)
def test_wrong_use_says_what_is_wrong(arguments: list[str], code: ExitCode, said: str) -> None:
    Path("bad.glb").write_bytes(b"hello")
    result = run_here(*arguments)
    assert result.exit_code == code
    assert said in result.output
    assert "Traceback" not in result.output
    assert made().keys() == {"bad.glb"}


def test_a_run_writes_everything_beside_the_result() -> None:
    result = run_here(*FIT, "--steps", 3, "--morph", "-o", "out.glb")
    assert result.exit_code == 0, result.stderr
    assert sorted(made()) == ["out.glb", "out.morph.glb", "out.preview.png", "out.report.json"]
    assert "out.report.json" in result.stdout
    assert "step 3/3" in result.stderr


def test_a_run_says_what_it_damaged_and_that_the_asset_was_better() -> None:
    careless = ["--preset", "preview", "--steps", 3, "--learning-rate", 1, "--param", "safeguard=none"]
    careless += ["--param", "dirichlet_weight=0"]
    result = run_here("run", "sphere.glb", "an airplane", *careless, "-o", "plane.glb")
    assert result.exit_code == 0, result.stderr
    report = json.loads(Path("plane.report.json").read_text())
    assert report["verdict"]["value"] == "keep_source"
    lines = result.stdout.splitlines()
    files = [number for number, line in enumerate(lines) if line.startswith(("GLB ", "Report ", "Picture "))]
    assert lines[files[-1] + 1].startswith("keep_source: It looks no more like an airplane than before")
    assert "Still your asset" not in result.stdout
    assert f"Damaged faces, of 320: {report['quality']['flipped_faces']} flipped" in result.stderr
    assert result.output.count("Damaged faces") == 1


def test_a_run_overwrites_only_what_a_run_wrote_and_its_input_only_by_force() -> None:
    def refused(*more: object, asset: str = "sphere.glb") -> bool:
        result = run_here("run", asset, "--target", "egg.glb", "--steps", 1, "-q", "-o", "out.glb", *more)
        assert (result.exit_code, bool(result.output)) in ((0, False), (ExitCode.BAD_INPUT, True)), result.output
        return bool(result.exit_code)

    Path("out.png").write_bytes(b"a texture")
    assert not refused()
    assert Path("out.png").read_bytes() == b"a texture"
    assert not refused("--seed", 2)  # a loop, a Makefile
    before = Path("out.glb").read_bytes()
    assert refused("-o", "./out.glb", asset="out.glb")
    assert Path("out.glb").read_bytes() == before
    assert not refused("--force", asset="out.glb")
    Path("out.glb").write_bytes(b"edited")
    assert refused()
    assert Path("out.glb").read_bytes() == b"edited"
    assert not refused("--force")
    Path("out.morph.glb").write_bytes(b"mine")
    Path("out.report.json").unlink()
    assert refused()
    assert refused("--checkpoint", "out.png", "-o", "other.glb")
    assert not refused("--checkpoint", "state", "-o", "other.glb")
    assert not refused("--checkpoint", "state", "-o", "other.glb")


def test_json_is_one_document_and_a_resumed_run_is_the_same_run() -> None:
    common = [*FIT, "--steps", 6, "--json", "--param", "checkpoint_every_steps=4"]
    whole = run_here(*common, "-o", "whole.glb", "--checkpoint", "state")
    assert json.loads(whole.stdout)["resumed_from"] is None
    resumed = run_here(*common, "-o", "resumed.glb", "--resume", "state")
    assert json.loads(resumed.stdout)["resumed_from"] == 4
    assert Path("whole.glb").read_bytes() == Path("resumed.glb").read_bytes()


@each_case("option", ["-o", "--checkpoint"])
def test_a_place_that_cannot_be_written_is_told_before_the_first_step(option: str) -> None:
    Path("file").write_bytes(b"in the way")
    result = run_here(*FIT, "--steps", 50_000, option, "file/out.glb")
    assert result.exit_code == exit_code(errors.UnavailableError(""))
    assert f"with {option}" in result.stderr
    assert "step" not in result.stderr
    assert made().keys() == {"file"}


def test_ctrl_c_writes_nothing_half_and_keeps_the_state() -> None:
    # One step writes the state, so the run is known to be in the middle when it is there.
    often = ["--param", "checkpoint_every_steps=1", "--checkpoint", "state"]
    command = [sys.executable, "-P", "-m", "meshdeform", *FIT, "--steps", "50000", "-o", "out.glb", *often]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as child:
        give_up = threading.Timer(120.0, child.kill)
        give_up.start()
        until("the state is written", lambda: Path("state").exists() or child.poll() is not None)
        child.send_signal(signal.SIGINT)
        _, said = child.communicate()
        give_up.cancel()
    assert child.returncode == ExitCode.INTERRUPTED, said
    assert re.search(
        r"^Interrupted at step \d+ of 50000\. The state is in state\.\nContinue with --resume state$", said, re.M
    )
    assert made().keys() == {"state"}


def test_files_are_written_all_or_none(here: Path) -> None:
    Path("a").write_bytes(b"old")
    with pytest.raises(OSError):
        write_files({here / "a": b"new", here / "no" / "b": b"new"})
    assert made() == {"a": b"old"}
    write_files({here / "a": b"new", here / "b": b"new"})
    assert made() == {"a": b"new", "b": b"new"}
