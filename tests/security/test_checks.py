"""Attack the check of an upload: it runs in a process of its own, which gets nothing and holds nobody up."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from meshdeform.assets import check
from meshdeform.assets.check import check_asset_subprocess
from meshdeform.children import asking
from meshdeform.errors import AssetFormatError
from tests.unit.assets.builders import Builder, quad

REPORT = """
import json, os, sys
with open({path!r}, "w") as file:
    json.dump([sys.argv[1:], os.getcwd(), dict(os.environ)], file)
print('{{"error": {{"code": "asset_format", "detail": "", "advice": "", "extra": {{}}}}}}')
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "stored"
    path.write_bytes(quad())
    return path


def test_the_parent_reads_nothing_of_the_file(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("the API process inspects the file")

    monkeypatch.setattr(check, "inspect_asset", refuse)
    assert check_asset_subprocess(file, "quad.glb").triangles == 2


def test_modules_of_the_current_folder_are_not_imported(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("numpy", "json", "meshdeform"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", ".")
    assert check_asset_subprocess(file, "quad.glb").triangles == 2
    assert not (tmp_path / "executed").exists()


def test_the_child_gets_no_secrets_and_another_folder(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, stand_in, child = tmp_path / "report.json", tmp_path / "python", tmp_path / "child.py"
    child.write_text(REPORT.format(path=str(report)))
    stand_in.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{child}" "$@"\n')
    stand_in.chmod(0o755)
    monkeypatch.setattr(asking.sys, "executable", str(stand_in))
    monkeypatch.chdir(tmp_path)
    for name in ("AWS_SECRET_ACCESS_KEY", "DATABASE_URL", "MESHDEFORM_DATABASE_URL", "PGPASSWORD", "HF_TOKEN"):
        monkeypatch.setenv(name, "secret")
    with pytest.raises(AssetFormatError):
        check_asset_subprocess(file, "quad.glb")
    arguments, folder, environment = json.loads(report.read_text())
    assert "secret" not in environment.values()
    assert Path(folder) == Path(tmp_path.anchor)
    assert "-P" in arguments


def test_the_child_has_limits_on_memory_time_and_files(tmp_path: Path) -> None:
    program = (
        "import resource as r; from meshdeform.children.protocol import Bounds; Bounds(2**30, 7.2).apply();"
        "print([r.getrlimit(getattr(r, 'RLIMIT_' + n))[0] for n in ('AS', 'CPU', 'FSIZE', 'CORE')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert json.loads(done.stdout) == [2**30, 9, 0, 0]


def test_a_summary_stays_small_however_much_is_skipped_or_named(tmp_path: Path) -> None:
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    for _ in range(check.MAX_LISTED + 50):
        builder.node(mesh, name="n" * 10_000)
    for _ in range(500):
        builder.node(mesh, scale=[1, 0, 1])
    path = tmp_path / "large.glb"
    path.write_bytes(builder.glb())
    found = check_asset_subprocess(path)
    assert len(found.nodes) == check.MAX_LISTED
    assert {len(node["name"]) for node in found.nodes} == {200}
    assert len(found.skipped) == check.MAX_SKIPPED + 1
    assert found.skipped[-1] == {"reason": f"and {500 - check.MAX_SKIPPED} more"}
