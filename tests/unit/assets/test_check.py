"""The second gate: a child process decodes, the parent gets a verdict whatever happens to the child."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import check, isolation
from meshdeform.assets.check import check_asset_subprocess
from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
    UnavailableError,
)
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_VERTS, Builder, quad


def nan_quad() -> bytes:
    builder = Builder()
    primitive = builder.primitive()
    primitive["attributes"]["POSITION"] = builder.accessor(QUAD_VERTS * np.float32("nan"))
    builder.node(builder.mesh(primitive))
    return builder.glb()


PYTHON = sys.executable


def stand_in_for_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str) -> None:
    """Write a good file, and let a program of ours check it."""
    (tmp_path / "quad.glb").write_bytes(quad())
    program = tmp_path / "child.py"
    program.write_text(child)
    stand_in = tmp_path / "python"
    stand_in.write_text(f'#!/bin/sh\nexec "{PYTHON}" "{program}"\n')
    stand_in.chmod(0o755)
    monkeypatch.setattr(isolation.sys, "executable", str(stand_in))


def test_a_good_file(tmp_path: Path) -> None:
    path = tmp_path / "stored"
    path.write_bytes(quad())
    summary = check_asset_subprocess(path, "quad.glb")
    assert (summary.format, summary.vertices, summary.triangles, summary.skipped) == ("glb", 4, 2, ())


def test_the_childs_error_is_the_parents(tmp_path: Path) -> None:
    path = tmp_path / "nan.glb"
    path.write_bytes(nan_quad())
    with pytest.raises(AssetNotFiniteError, match="4 positions") as raised:
        check_asset_subprocess(path)
    assert raised.value.advice_text == AssetNotFiniteError.advice


@each_case("width", [0.0, 1e-6, 9e-6])
def test_triangles_that_the_solve_takes_for_collapsed_are_refused(tmp_path: Path, width: float) -> None:
    with pytest.raises(AssetEmptyError, match="zero area"):
        check_asset_subprocess(needles(tmp_path, width))


def test_a_thin_triangle_that_the_solve_can_use_is_accepted(tmp_path: Path) -> None:
    assert check_asset_subprocess(needles(tmp_path, 1e-4)).triangles == 2


def needles(folder: Path, width: float) -> Path:
    """Write a square that is as narrow as this share of its length."""
    builder = Builder()
    primitive = builder.primitive()
    primitive["attributes"]["POSITION"] = builder.accessor(QUAD_VERTS * np.float32([1, width, width]))
    builder.node(builder.mesh(primitive))
    path = folder / "needles.glb"
    path.write_bytes(builder.glb())
    return path


def test_limits_reach_the_child(tmp_path: Path) -> None:
    path = tmp_path / "quad.glb"
    path.write_bytes(quad())
    with pytest.raises(AssetTooLargeError):
        check_asset_subprocess(path, limits=Limits(max_triangles=1))


def test_an_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "empty.glb"
    path.touch()
    with pytest.raises(AssetTruncatedError):
        check_asset_subprocess(path)


@each_case(
    ("child", "error", "message"),
    [
        ("import os; os.kill(os.getpid(), 11)", AssetError, "SIGSEGV"),
        ("import os; os.kill(os.getpid(), 9)", AssetTooLargeError, "memory"),
        ("raise SystemExit(7)", AssetError, "exit status 7"),
        ("import time; time.sleep(600)", AssetTooLargeError, "within 0.5 s"),
    ],
)
def test_a_child_that_dies_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str, error: type[AssetError], message: str
) -> None:
    stand_in_for_child(tmp_path, monkeypatch, child)
    with pytest.raises(error, match=message):
        check_asset_subprocess(tmp_path / "quad.glb", timeout_s=0.5 if "sleep" in child else 60)


def test_the_command_prints_a_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check, "bound_resources", lambda *_: None)  # not for the process that runs the tests
    path = tmp_path / "a.glb"
    path.write_bytes(quad())
    assert check.main([str(path)]) == 0
    assert json.loads(capsys.readouterr().out)["summary"]["triangles"] == 2
    path.write_bytes(nan_quad())
    assert check.main([str(path)]) == 1
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "asset_not_finite"
    assert set(error) == {"code", "detail", "advice", "extra"}


@each_case("name", ["-x.glb", "--help", "a\0b.glb", "\ud800.glb", "a\nb.glb", "x" * 200_000 + ".glb"])
def test_a_name_that_no_command_line_takes(tmp_path: Path, name: str) -> None:
    path = tmp_path / "stored"
    path.write_bytes(quad())
    assert check_asset_subprocess(path, name).triangles == 2


def test_a_decoder_that_prints_is_still_understood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in_for_child(tmp_path, monkeypatch, "print('decoding {'); print('[]'); import sys; sys.exit(3)")
    with pytest.raises(AssetError, match="exit status 3"):
        check_asset_subprocess(tmp_path / "quad.glb")


def test_a_machine_that_starts_no_process_is_not_the_files_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "quad.glb"
    path.write_bytes(quad())
    monkeypatch.setattr(isolation.sys, "executable", str(tmp_path / "nothing"))
    with pytest.raises(UnavailableError):
        check_asset_subprocess(path)


def test_a_file_that_takes_more_memory_than_it_may_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "quad.glb"
    path.write_bytes(quad())
    with pytest.raises(AssetError) as raised:
        check_asset_subprocess(path, limits=Limits(max_memory_bytes=24 * 2**20))
    assert raised.value.status in (413, 422)


def test_memory_and_time_are_limits() -> None:
    limits = Limits()
    assert limits.memory_bytes(limits.max_bytes) == limits.max_memory_bytes
    assert limits.memory_bytes(0) < limits.max_memory_bytes
    assert Limits(max_memory_bytes=5).memory_bytes(10**9) == 5
    larger = Limits.from_settings(Settings(max_upload_bytes=2**30))
    assert larger.max_memory_bytes == larger.memory_bytes(2**30) > limits.max_memory_bytes
