"""The second gate: a child process decodes, the parent gets a verdict whatever happens to the child."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from meshdeform.errors import AssetEmptyError, AssetError, AssetNotFiniteError, AssetTooLargeError, AssetTruncatedError
from meshdeform.gltf import check
from meshdeform.gltf.check import check_asset_subprocess
from meshdeform.gltf.limits import Limits
from tests.unit.gltf.builders import QUAD_VERTS, Builder, quad


def nan_quad() -> bytes:
    builder = Builder()
    primitive = builder.primitive()
    primitive["attributes"]["POSITION"] = builder.accessor(QUAD_VERTS * np.float32("nan"))
    builder.node(builder.mesh(primitive))
    return builder.glb()


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


def test_triangles_without_any_area_are_refused_at_the_door(tmp_path: Path) -> None:
    builder = Builder()
    primitive = builder.primitive()
    primitive["attributes"]["POSITION"] = builder.accessor(QUAD_VERTS * np.float32([1, 0, 0]))
    builder.node(builder.mesh(primitive))
    path = tmp_path / "line.glb"
    path.write_bytes(builder.glb())
    with pytest.raises(AssetEmptyError, match="zero area"):
        check_asset_subprocess(path)


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


@pytest.mark.parametrize(
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
    path = tmp_path / "quad.glb"
    path.write_bytes(quad())
    stand_in = tmp_path / "python"
    stand_in.write_text(f"#!/bin/sh\nexec {sys.executable} -c {child!r}\n".replace("'", '"'))
    stand_in.chmod(0o755)
    monkeypatch.setattr(check.sys, "executable", str(stand_in))
    with pytest.raises(error, match=message):
        check_asset_subprocess(path, timeout_s=0.5 if "sleep" in child else 60)


def test_the_command_prints_a_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check, "_bound_memory", lambda size: None)  # not for the process that runs the tests
    path = tmp_path / "a.glb"
    path.write_bytes(quad())
    assert check.main([str(path)]) == 0
    assert json.loads(capsys.readouterr().out)["summary"]["triangles"] == 2
    path.write_bytes(nan_quad())
    assert check.main([str(path)]) == 1
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "asset_not_finite"
    assert set(error) == {"code", "detail", "advice", "extra"}
