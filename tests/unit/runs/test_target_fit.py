"""Jobs with a target mesh: how it is placed, what the report says, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.report_lines import fit_line
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from tests.unit.runs.jobs import finished, started

SPHERE = icosphere(2)


def glb(scale: tuple[float, float, float] = (1.0, 1.0, 1.0), offset: float = 0.0) -> bytes:
    return build_glb(SPHERE.verts * scale + offset, SPHERE.faces)


def fitted(asset: bytes, target: bytes, **params: object) -> tuple[np.ndarray, dict]:
    given = {"guidance": "target", "steps": 30, **params}
    result, report = finished(started(asset, "", target=target, **given))
    return load_asset(result).surface.positions, report


def test_the_report_says_how_well_the_target_is_fitted() -> None:
    positions, report = fitted(glb(), glb((8.0, 12.0, 10.0), 50.0), landmarks=[{"source": 0, "target": 0}])
    fit = report["fit"]
    assert np.abs(positions.mean(0)).max() < 0.05
    assert fit["within"] > 0.95
    assert fit["to_target"] < 0.005
    assert fit["from_target"] < 0.005
    assert fit["silhouettes"] > 0.95
    assert fit["alignment"]["overlap"] > 0.9
    assert fit["alignment"]["turn_deg"] == 0.0
    assert fit["landmarks"]["count"] == 1
    assert fit["landmarks"]["max"] < 0.03
    line = fit_line(fit | {"quality": report["quality"]})
    assert "of the target within 1 %" in line
    assert "0 flipped faces" in line


def test_without_alignment_the_result_is_where_the_target_is() -> None:
    positions, report = fitted(glb(), glb(offset=0.2), align="none")
    assert np.abs(positions - (SPHERE.verts + 0.2)).max() < 0.02
    assert report["fit"]["alignment"]["turn_deg"] is None


@each_case(
    ("params", "place"),
    [
        ({"landmarks": [{"source": 9999, "target": 0}]}, ["params", "guidance", "landmarks", 0, "source"]),
        ({"landmarks": [{"source": [0.0, 1.0, 0.0], "target": 162}]}, ["params", "guidance", "landmarks", 0, "target"]),
        ({"landmarks": [{"source": 0, "target": [0.0, 1e9, 0.0]}]}, ["params", "guidance", "landmarks", 0, "target"]),
        ({"landmarks": [{"source": [0.0, 1e9, 0.0], "target": 0}]}, ["params", "guidance", "landmarks", 0, "source"]),
    ],
)
def test_what_does_not_fit_the_files_is_refused(params: dict, place: list) -> None:
    with pytest.raises(ParameterError) as refused:
        fitted(glb(), glb(), **params)
    assert refused.value.extra["errors"][0]["loc"] == place


def test_parts_on_a_lattice_are_fitted_and_a_rigid_one_keeps_its_shape() -> None:
    two = join(SPHERE, TriangleMesh(0.4 * SPHERE.verts + np.array([1.6, 0.0, 0.0]), SPHERE.faces))
    asset = build_glb(two.verts, two.faces)
    target = build_glb(two.verts * (1.0, 1.3, 1.0), two.faces)
    positions, report = fitted(asset, target, rigid=[{"component": 1}], steps=12)
    assert report["carrier"]["kind"] == "lattice"
    assert report["rigid"]["max_deviation"] < 1e-6
    ball, rest = positions[len(SPHERE.verts) :], 0.4 * SPHERE.verts
    assert np.ptp(ball, axis=0) == pytest.approx(np.ptp(rest, axis=0), rel=0.02)
    assert np.ptp(positions[:, 1]) > 2.1
    assert report["quality"]["flipped_faces"] == 0
