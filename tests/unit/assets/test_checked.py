"""An asset is checked once for each owner, and only files that passed are remembered."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from meshdeform.assets import Limits
from meshdeform.assets import check as checked
from meshdeform.assets.check import CheckedAssets
from meshdeform.errors import AssetError


def received(path: Path, data: bytes, filename: str, owner: str = "ann") -> tuple[Path, str, str, str]:
    path.write_bytes(data)
    return path, filename, hashlib.sha256(data).hexdigest(), owner


def test_the_same_bytes_are_checked_once(tmp_path: Path, repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    real = checked.check_asset_subprocess

    def counted(path: Path, filename: str, limits: Limits, *, content: checked.FileContent) -> object:
        calls.append(filename)
        return real(path, filename, limits, content=content)

    monkeypatch.setattr(checked, "check_asset_subprocess", counted)
    assets = CheckedAssets(Limits())
    sphere = (repository / "examples/sphere.glb").read_bytes()
    first = assets.check(*received(tmp_path / "a", sphere, "one.glb"))
    again = assets.check(*received(tmp_path / "b", sphere, "two.GLB"))
    assert first == again
    assert calls == ["one.glb"]
    # Otherwise the time of a check would tell whether another owner has sent the file.
    assets.check(*received(tmp_path / "d", sphere, "four.glb", "bob"))
    assert calls.pop() == "four.glb"
    broken = received(tmp_path / "c", sphere[:-100], "three.glb")
    for _ in range(2):
        with pytest.raises(AssetError):
            assets.check(*broken)
    assert calls == ["one.glb", "three.glb", "three.glb"]


def test_what_was_checked_long_ago_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checked, "check_asset_subprocess", lambda *_, **__: object())
    monkeypatch.setattr(checked, "_REMEMBERED", 2)
    assets = CheckedAssets(Limits())
    files = [(Path("x"), "x.glb", letter * 64, "ann") for letter in "abc"]
    seen = [assets.check(*file) for file in files]
    assert assets.check(*files[2]) is seen[2]
    assert assets.check(*files[0]) is not seen[0]
