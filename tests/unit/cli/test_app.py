"""The command line: quick, clean errors, distinct exit codes, nothing half written."""

from __future__ import annotations

import contextlib
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
from meshdeform.cli.app import app
from meshdeform.cli.exits import ExitCode, exit_code
from meshdeform.support.files import write_files
from tests.acceptance.service import until
from tests.cases import each_case


@pytest.fixture(scope="module")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small sphere as an OBJ."""
    return _write_obj(tmp_path_factory.mktemp("assets") / "sphere.obj", 1.0)


@pytest.fixture(scope="module")
def egg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, taller: a target."""
    return _write_obj(tmp_path_factory.mktemp("assets") / "egg.obj", 1.6)


def _write_obj(path: Path, height: float) -> Path:
    from meshdeform.geometry.shapes import icosphere

    mesh = icosphere(2)
    lines = [f"v {x} {y * height} {z}" for x, y, z in mesh.verts.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines))
    return path


def meshdeform_command(*arguments: object) -> list[str]:
    return [sys.executable, "-P", "-m", "meshdeform", *(str(argument) for argument in arguments)]


def run_here(*arguments: object, cwd: Path) -> Result:
    """Run a command in this process, which has loaded torch already."""
    with contextlib.chdir(cwd):
        return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_help_loads_neither_torch_nor_numpy_nor_pydantic() -> None:
    program = (
        "import sys, meshdeform.cli.app\n"
        "print([name for name in ('torch', 'numpy', 'pydantic', 'fastapi', 'redis') if name in sys.modules])"
    )
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"


@each_case(
    ("arguments", "code", "said"),
    [
        (["run", "nowhere.glb", "a vase"], ExitCode.USAGE, "does not exist"),
        (["run", "SPHERE", "a vase", "--steps", "0"], ExitCode.BAD_INPUT, "params.steps"),
        (["run", "SPHERE", "a vase", "--param", "no_such=1"], ExitCode.BAD_INPUT, "no_such"),
        (["run", "SPHERE", "a vase", "--param", "nonsense"], ExitCode.USAGE, "NAME=VALUE"),
        (["run", "SPHERE", "a vase", "-o", "vase.obj"], ExitCode.USAGE, ".glb"),
        (["run", "SPHERE", "a vase", "--preset", "fast"], ExitCode.USAGE, "fast"),
        (["serve", "--port", "70000"], ExitCode.USAGE, "65535"),
        (["worker"], ExitCode.BAD_INPUT, "MESHDEFORM_REDIS_URL"),
        (["api"], ExitCode.BAD_INPUT, "MESHDEFORM_REDIS_URL"),
    ],
)
def test_wrong_use_says_what_is_wrong(arguments: list[str], code: ExitCode, said: str, sphere: Path) -> None:
    result = CliRunner().invoke(app, [str(sphere) if a == "SPHERE" else a for a in arguments])
    assert result.exit_code == code
    assert said in result.output
    assert "Traceback" not in result.output


def test_a_run_writes_everything_beside_the_result(sphere: Path, egg: Path, tmp_path: Path) -> None:
    result = run_here("run", sphere, "--target", egg, "--steps", 3, "--morph", "-o", "egg.glb", cwd=tmp_path)
    assert result.exit_code == 0, result.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "egg.glb",
        "egg.morph.glb",
        "egg.preview.png",
        "egg.report.json",
    ]
    assert "egg.report.json" in result.stdout
    assert "step 3/3" in result.stderr
    assert (tmp_path / "egg.glb").read_bytes()[:4] == b"glTF"


def test_a_run_says_what_it_damaged_and_that_the_asset_was_better(sphere: Path, tmp_path: Path) -> None:
    careless = ["--preset", "preview", "--steps", 3, "--learning-rate", 1, "--param", "safeguard=none"]
    careless += ["--param", "dirichlet_weight=0"]
    result = run_here("run", sphere, "an airplane", *careless, "-o", "plane.glb", cwd=tmp_path)
    assert result.exit_code == 0, result.stderr
    report = json.loads((tmp_path / "plane.report.json").read_text())
    assert report["verdict"]["value"] == "keep_source"
    assert "(keep_source). It looks no more like an airplane than before" in result.stdout
    assert f"Still your asset: {report['quality']['kept_share']:.0%}" in result.stdout
    assert f"Damaged faces, of 320: {report['quality']['flipped_faces']} flipped" in result.stderr
    assert result.output.count("Damaged faces") == 1


def test_a_run_overwrites_only_what_a_run_wrote(sphere: Path, egg: Path, tmp_path: Path) -> None:
    common = ["run", sphere, "--target", egg, "--steps", 1, "-o", "egg.glb"]

    def refused(*more: object) -> bool:
        result = run_here(*common, *more, cwd=tmp_path)
        assert result.exit_code in (0, ExitCode.BAD_INPUT), result.output
        return bool(result.exit_code)

    (tmp_path / "egg.png").write_bytes(b"a texture")
    assert not refused("-q")
    assert (tmp_path / "egg.png").read_bytes() == b"a texture"
    assert not refused("--seed", 2)  # a loop, a Makefile
    (tmp_path / "egg.glb").write_bytes(b"edited")
    assert refused()
    assert (tmp_path / "egg.glb").read_bytes() == b"edited"
    assert not refused("--force")
    (tmp_path / "egg.morph.glb").write_bytes(b"mine")
    (tmp_path / "egg.report.json").unlink()
    assert refused()
    assert refused("--checkpoint", "egg.png", "-o", "other.glb")
    assert not refused("--checkpoint", "state", "-o", "other.glb")
    assert not refused("--checkpoint", "state", "-o", "other.glb")


def test_a_run_does_not_replace_its_input_unless_forced(sphere: Path, egg: Path, tmp_path: Path) -> None:
    common = ["run", sphere, "--target", egg, "--steps", 1, "-q"]
    done = run_here(*common, "-o", "a.glb", cwd=tmp_path)
    assert (done.exit_code, done.output) == (0, "")
    before = (tmp_path / "a.glb").read_bytes()
    again = ["run", "a.glb", *common[2:], "-o", "./a.glb"]
    refused = run_here(*again, cwd=tmp_path)
    assert refused.exit_code == ExitCode.BAD_INPUT
    assert "a.glb is an input" in refused.stderr
    assert "--force" in refused.stderr
    assert (tmp_path / "a.glb").read_bytes() == before
    assert run_here(*again, "--force", cwd=tmp_path).exit_code == 0
    assert (tmp_path / "a.glb").read_bytes() != before


def test_json_is_one_document_and_a_resumed_run_is_the_same_run(sphere: Path, egg: Path, tmp_path: Path) -> None:
    common = ["run", sphere, "--target", egg, "--steps", 6, "--json", "--param", "checkpoint_every_steps=4"]
    whole = run_here(*common, "-o", "whole.glb", "--checkpoint", "state", cwd=tmp_path)
    assert json.loads(whole.stdout)["resumed_from"] is None
    resumed = run_here(*common, "-o", "resumed.glb", "--resume", "state", cwd=tmp_path)
    assert json.loads(resumed.stdout)["resumed_from"] == 4
    assert (tmp_path / "whole.glb").read_bytes() == (tmp_path / "resumed.glb").read_bytes()


def test_a_file_that_is_no_mesh_is_one_line_and_advice(tmp_path: Path) -> None:
    (tmp_path / "bad.glb").write_bytes(b"hello")
    result = run_here("run", "bad.glb", "a vase", cwd=tmp_path)
    assert result.exit_code == ExitCode.BAD_INPUT
    assert result.stderr.splitlines()[-2].startswith("Error: ")
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(("option", "what"), [("-o", "The result"), ("--checkpoint", "The checkpoint")])
def test_a_place_that_cannot_be_written_is_told_before_the_first_step(
    sphere: Path, egg: Path, tmp_path: Path, option: str, what: str
) -> None:
    (tmp_path / "file").write_bytes(b"in the way")
    result = run_here("run", sphere, "--target", egg, "--steps", 50_000, option, "file/egg.glb", cwd=tmp_path)
    assert result.exit_code == exit_code(errors.UnavailableError(""))
    assert f"{what} cannot be written" in result.stderr
    assert f"with {option}" in result.stderr
    assert "step" not in result.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_ctrl_c_writes_nothing_half_and_keeps_the_state(sphere: Path, egg: Path, tmp_path: Path) -> None:
    command = meshdeform_command(
        "run", sphere, "--target", egg, "--steps", 50_000, "-o", "egg.glb", "--checkpoint", "state"
    )
    # One step writes the state, so the run is known to be in the middle when it is there.
    command += ["--param", "checkpoint_every_steps=1"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as child:
        give_up = threading.Timer(120.0, child.kill)
        give_up.start()
        until("the state is written", lambda: (tmp_path / "state").exists() or child.poll() is not None)
        child.send_signal(signal.SIGINT)
        _, said = child.communicate()
        give_up.cancel()
    assert child.returncode == ExitCode.INTERRUPTED, said
    assert re.search(
        r"^Interrupted at step \d+ of 50000\. The state is in state\.\nContinue with --resume state$", said, re.M
    )
    assert [p.name for p in tmp_path.iterdir()] == ["state"]


def test_files_are_written_all_or_none(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    with pytest.raises(OSError):
        write_files({tmp_path / "a": b"new", tmp_path / "no" / "b": b"new"})
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"old")]
    write_files({tmp_path / "a": b"new", tmp_path / "b": b"new"})
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a": b"new", "b": b"new"}
