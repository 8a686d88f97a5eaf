"""A job of kind `surface_fit` over HTTP, with a worker in this process."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from meshdeform.assets import load_asset
from meshdeform.cli.app import app
from meshdeform.client import Client
from meshdeform.errors import AssetEmptyError, AssetError
from meshdeform.geometry.shapes import icosphere
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.runs import start_run
from meshdeform.settings import Settings
from tests.integration.conftest import DEADLINE_S, serving
from tests.worker_world import working

SMALL = {"base_faces": 100, "steps": 4, "octaves": 1, "width": 8, "depth": 1, "level": 1}


def test_a_cloud_is_posted_fitted_and_downloaded_and_is_no_asset(tmp_path: Path, redis_url: str) -> None:
    mesh = icosphere(3)
    points = mesh.verts
    cloud = tmp_path / "cloud.xyz"
    np.savetxt(cloud, np.concatenate([points, points], 1), fmt="%.5f")
    unsigned = tmp_path / "unsigned.npz"
    np.savez(unsigned, sdf=np.ones((8, 8, 8)), origin=np.zeros(3), spacing=0.1)
    settings = Settings(data_dir=tmp_path / "data", redis_url=redis_url, queue="test-surface-fit")
    with serving(settings) as url, Client(url) as client:
        with pytest.raises(AssetError, match="one sign, as unsigned"):
            client.submit(unsigned, kind="surface_fit", params=SMALL)
        checked = client.validate(cloud, kind="surface_fit", params=SMALL)
        assert (checked.asset.format, checked.asset.vertices, checked.asset.triangles) == ("xyz", len(points), 0)
        with working(settings, start_run):
            result = client.deform(cloud, kind="surface_fit", params=SMALL, timeout_s=DEADLINE_S)
            asked = ["run", str(cloud), "--kind", "surface_fit", "--steps", "2", "-o", str(tmp_path / "o")]
            asked += [word for name in SMALL if name != "steps" for word in ("--set", f"{name}={SMALL[name]}")]
            shell = CliRunner().invoke(app, [*asked, "--url", url, "--json"])
        assert shell.exit_code == 0, shell.output
        assert (json.loads(shell.stdout)["kind"], json.loads(shell.stdout)["params"]["steps"]) == ("surface_fit", 2)
        assert read_field(tmp_path / "o/surface.ndf").header["widths"][1:] == [SMALL["width"], 3]
        verts, _ = read_field(result.read("surface.ndf")).unfold(2)
        assert np.linalg.norm(verts, axis=1).mean() == pytest.approx(1, abs=0.05)
        assert "level_1.glb" in {artifact.name for artifact in result.job.artifacts}

        # The other kind needs a mesh.
        for refused in (lambda: client.validate(cloud, "a mushroom"), lambda: client.submit(unsigned, "a mushroom")):
            with pytest.raises(AssetEmptyError, match="no triangles") as caught:
                refused()
            assert "meshdeform surface-fit FILE -o mesh.glb" in caught.value.advice_text
        level = load_asset(result.read("level_1.glb")).surface
        assert len(level.triangles) > 0
