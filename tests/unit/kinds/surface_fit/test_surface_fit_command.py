"""`meshdeform surface-fit` and `unfold`: files in, files out, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import build_glb, load_asset
from meshdeform.geometry.shapes import icosphere
from tests.unit.cli.lines import done, refused

_SMALL = "--steps 2 --width 8 --depth 1 --octaves 1 --level 0"
_FIT = f"surface-fit ball.glb --base-faces 100 {_SMALL}"


def test_a_fit_is_unfolded_and_nothing_else_is_overwritten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = icosphere(2)
    Path("ball.glb").write_bytes(build_glb(mesh.verts, mesh.faces))
    summary = json.loads(done(f"{_FIT} --json --checkpoint ball.state").stdout)
    assert summary["bytes"] == Path("ball.ndf").stat().st_size
    assert {path.name for path in Path().iterdir()} == {"ball.glb", "ball.ndf", "ball.report.json", "ball.preview.png"}
    done("unfold ball.ndf -o big.glb --level 2 --intrinsic big.npz")
    surface = load_asset(Path("big.glb").read_bytes()).surface
    assert len(surface.triangles) == 16 * json.loads(Path("ball.report.json").read_bytes())["base"]["faces"]
    assert len(np.load("big.npz")["faces"]) == len(surface.triangles)
    done(f"surface-fit ball.glb {_SMALL} --base ball.glb --anchor 1,0,0:0,1,0 -o own.ndf")
    assert json.loads(Path("own.report.json").read_bytes())["base"]["faces"] == len(mesh.faces)
    assert json.loads(done(f"{_FIT} -o mesh.glb --json").stdout)["result"] == "mesh.ndf"
    assert len(load_asset(Path("mesh.glb").read_bytes()).surface.triangles) == 100
    Path("mine.ndf").write_bytes(b"mine")
    for line, said in (
        ("surface-fit ball.glb -o mesh.obj", "does not end in .ndf or .glb"),
        *((f"surface-fit ball.glb --anchor {wrong}", "--anchor") for wrong in ("1,0:0,1,0", "1,0,0", "a,0,0:0,1,0")),
        (f"{_FIT} --scalars ball.glb -o x.ndf", "The scalars cannot be read"),
        ("surface-fit ball.glb --base-faces 1", "base_faces"),
        (f"{_FIT} -o mine.ndf", "mine.ndf"),
        ("unfold ball.ndf -o big.glb", "exists"),
        ("unfold mine.ndf", "not a .ndf"),
    ):
        assert said in refused(line), line
    assert Path("mine.ndf").read_bytes() == b"mine"
