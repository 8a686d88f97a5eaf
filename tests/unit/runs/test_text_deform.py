"""The kind `text_deform` from bytes to bytes: the loop, the checkpoint, the results, the report."""

from __future__ import annotations

import hashlib
import io
import json
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import meshdeform
from meshdeform.assets import build_glb, load_asset
from meshdeform.errors import CheckpointError
from meshdeform.geometry import intersections
from meshdeform.geometry.mesh import TriangleMesh, face_normals
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.priors import load_prior
from tests.fakes import FakePrior
from tests.unit.assets.builders import unpack
from tests.unit.runs.jobs import started
from training.shapes import box


def glb(mesh: TriangleMesh, *, scale: float = 1.0, offset: float = 0.0) -> bytes:
    """Split at every face, as exporters do at seams, with normals and UVs."""
    corners = mesh.verts[mesh.faces].reshape(-1, 3)
    normals = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    uvs = corners[:, :2] * 0.5 + 0.5
    faces = np.arange(len(corners)).reshape(-1, 3)
    return build_glb(corners * scale + offset, faces, normals=normals, uvs=uvs, material="clay")


GIVEN: dict[str, Any] = {"steps": 12, "seed": 5}


def test_what_is_coarser_where_faces_crowd_is_in_the_report(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(intersections, "_TESTS", 0)
    monkeypatch.setattr(intersections, "_TESTS_OF_FACE", 0)
    run = started(glb(icosphere(2)), steps=2)
    assert len(list(run)) == 2
    report = json.loads(run.finish()["report.json"].data)
    assert report["quality"]["self_intersections_added"] is None
    assert report["quality"]["flipped_faces"] == 0
    told = " ".join(report["warnings"])
    assert "the safeguard only prevented folds" in told
    assert "self-intersections were not counted" in told


@pytest.mark.as_shipped
def test_results_keep_the_asset_and_say_so() -> None:
    asset = glb(icosphere(2), scale=30.0, offset=100.0)
    run = started(asset, **GIVEN, output={"morph": True})
    reports = list(run)
    assert [r.step for r in reports] == list(range(1, 13))
    assert run.step == run.total_steps == 12
    artifacts = run.finish()
    assert set(artifacts) == {"result.glb", "morph.glb", "report.json", "preview.png"}
    old, new = load_asset(asset).surface, load_asset(artifacts["result.glb"].data).surface
    assert np.array_equal(old.triangles, new.triangles)
    assert len(old.positions) == len(new.positions)
    assert not np.allclose(old.positions, new.positions)
    # Its own units and place: the centre of mass stays, a hundred units away from the origin.
    assert np.abs(new.positions.mean(0) - 100).max() < 3
    assert np.allclose(np.linalg.norm(new.normals, axis=1), 1, atol=1e-5)
    report = json.loads(artifacts["report.json"].data)
    assert report["mesh"]["same_vertex_count"] is True
    assert report["mesh"]["same_faces"] is True
    assert report["mesh"]["same_uvs"] is True
    assert report["mesh"]["welded_vertices"] == 162
    assert report["seed"] == 5
    assert report["params"]["steps"] == 12
    assert report["orientation"] == {"turn_deg": 0.0, "source": "kept", "notice": None}
    assert report["losses"][0]["step"] == 1
    assert report["losses"][-1]["step"] == 12
    assert report["quality"]["flipped_faces"] == 0
    assert set(report["seconds"]) == {"read", "prepare", "optimize", "write", "measure"}
    assert Image.open(io.BytesIO(artifacts["preview.png"].data)).size == (1024, 512)


def test_results_are_compact_and_have_their_provenance_if_requested() -> None:
    asset = glb(icosphere(1))
    results = {}
    for wanted in (False, True):
        output = {"morph": True, "compact": wanted, "provenance": wanted}
        run = started(asset, steps=1, seed=5, output=output)
        list(run)
        results[wanted] = {"snapshot": run.snapshot().data} | {n: a.data for n, a in run.finish().items()}
    assert len(results[True]["result.glb"]) < len(asset) + 500 < len(results[False]["result.glb"])
    for name in ("result.glb", "morph.glb", "snapshot"):
        plain, extended = (unpack(results[wanted][name])[0]["asset"] for wanted in (False, True))
        assert plain == unpack(asset)[0]["asset"]
        found = extended["extras"]["meshdeform"]
        assert len(found.pop("parameters_sha256")) == 64
        origin = {"prompt": "an egg", "seed": 5, "guidance": "sds", "preset": "preview", "step": 1}
        source = {"source_sha256": hashlib.sha256(asset).hexdigest()}
        assert found == {"version": meshdeform.__version__, **origin, **source}


def test_a_box_of_twelve_triangles_bends_if_it_is_subdivided() -> None:
    cube = box()
    asset = glb(cube)
    assert len(cube.faces) == 12
    given: dict[str, Any] = {"steps": 40, "output": {"subdivide": True}}
    run = started(asset, **given)
    steps = iter(run)
    for _ in range(20):
        next(steps)
    saved = run.checkpoint()
    list(steps)
    files = run.finish()
    report = json.loads(files["report.json"].data)
    grown = report["subdivision"]
    assert (grown["triangles_before"], grown["triangles_after"]) == (12, 3072)
    assert any("12 triangles became 3,072" in text for text in report["warnings"])
    result = load_asset(files["result.glb"].data).surface
    assert len(result.triangles) == 3072
    normals = face_normals(result.positions, result.triangles)
    # Faces of one side of the box no longer lie in one plane.
    source = load_asset(asset).subdivided(100_000)[0].surface
    flat = face_normals(source.positions, source.triangles)
    side = flat[:, 0] > 0.9
    mean = normals[side].mean(0)
    assert np.degrees(np.arccos(np.clip(normals[side] @ (mean / np.linalg.norm(mean)), -1, 1))).max() > 10
    resumed = started(asset, **given, checkpoint=saved)
    list(resumed)
    assert resumed.finish()["result.glb"].data == files["result.glb"].data
    for wrong in ({"checkpoint": saved}, {"initial": saved}):
        with pytest.raises(CheckpointError):
            started(asset, steps=40, **wrong)


def test_the_report_says_which_normals_were_rebuilt() -> None:
    ball = icosphere(2)
    normals = ball.verts.copy()
    normals[[3, 50]] = np.nan
    run = started(build_glb(ball.verts, ball.faces, normals=normals), steps=1)
    list(run)
    artifacts = run.finish()
    report = json.loads(artifacts["report.json"].data)
    assert report["mesh"]["rebuilt_normals"] == 2
    assert report["input"]["warnings"][0].startswith("2 normals of the file have no direction")
    assert np.isfinite(load_asset(artifacts["result.glb"].data).surface.normals).all()


class HalfPrior(FakePrior):
    """One on a processor with bfloat16."""

    dtype = torch.bfloat16


def test_a_run_that_resumes_in_another_precision_says_so_to_its_end() -> None:
    asset, places = glb(icosphere(1)), [HalfPrior(), FakePrior(), FakePrior(), HalfPrior()]
    stored, said = None, []
    for until, prior in zip((3, 5, 7, 12), places, strict=True):
        run = started(asset, **GIVEN, prior=prior, checkpoint=stored)
        for report in run:
            if report.step == until:
                break
        stored = run.checkpoint()
        said.append(json.loads(run.finish()["report.json"].data))
    assert [each["precision"] for each in said] == [
        "bfloat16", "bfloat16, float32", "bfloat16, float32", "bfloat16, float32, bfloat16",
    ]  # fmt: skip
    warned = [[words for words in each["warnings"] if "precision" in words] for each in said]
    assert [len(words) for words in warned] == [0, 1, 1, 1]
    assert "bfloat16, float32, in this order" in warned[1][0]
    # A branch is a run of its own, which only begins with the shape.
    assert started(asset, steps=12, seed=9, initial=stored)._facts.precision == "float32"


def test_a_branch_begins_exactly_at_the_shape_of_the_checkpoint_and_resumes() -> None:
    asset = glb(icosphere(2), scale=30.0, offset=100.0)
    first = started(asset, **GIVEN)
    for report in first:
        if report.step == 5:
            break
    state = first.checkpoint()
    assert first.snapshot().content_type == "model/gltf-binary"
    for other in (GIVEN, {"seed": 9, "steps": 4, "learning_rate": 0.01}):
        branch = started(asset, **other, initial=state)
        assert branch.step == 0
        assert np.array_equal(branch.positions(), first.positions())
        assert branch.snapshot() == first.snapshot()
        next(iter(branch))
        resumed = started(asset, **other, checkpoint=branch.checkpoint())
        assert [report.step for report in branch] == list(range(2, branch.total_steps + 1))
        assert not np.array_equal(branch.positions(), first.positions())
        assert resumed.step == 1
        list(resumed)
        assert resumed.finish()["result.glb"].data == branch.finish()["result.glb"].data == branch.snapshot().data
    for wrong in ({"seed": 6}, {"learning_rate": 0.02}):
        with pytest.raises(CheckpointError):
            started(asset, **{**GIVEN, **wrong}, checkpoint=state)
    with pytest.raises(CheckpointError, match="another asset"):
        started(glb(icosphere(2), scale=31.0), **GIVEN, initial=state)


def test_several_components_open_borders_and_stray_vertices_are_no_errors() -> None:
    mesh = join(icosphere(2), box(2))
    verts = np.concatenate([mesh.verts, [[9.0, 9.0, 9.0]]])
    degenerate = [[0, 0, 1], [0, 1, 0]]
    faces = np.concatenate([mesh.faces[:-3], degenerate, mesh.faces[:1]])
    run = started(build_glb(verts, faces), steps=3)
    for _ in run:
        pass
    artifacts = run.finish()
    skipped = json.loads(artifacts["report.json"].data)["skipped"]
    assert skipped["unreferenced_vertices"] == 1
    assert skipped["degenerate_faces"] == 2
    assert skipped["border_edges"] > 0
    assert skipped["non_manifold_edges"] > 0
    new = load_asset(artifacts["result.glb"].data).surface.positions
    assert np.isfinite(new).all()
    np.testing.assert_allclose(new[-1], [9, 9, 9])


@pytest.mark.parametrize(("bottom", "kept"), [(0.0, True), (-7.0, False)])
def test_what_stands_on_the_origin_stands_there_after_a_prompt(bottom: float, kept: bool) -> None:
    ball = icosphere(2)
    asset = glb(TriangleMesh(ball.verts + [0.0, bottom + 1.0, 5.0], ball.faces))
    prior = load_prior("builtin", device="cpu")
    run = started(asset, "a mushroom", steps=4, learning_rate=0.05, prior=prior)
    list(run)
    lowest = load_asset(run.finish()["result.glb"].data).surface.positions[:, 1].min()
    assert bool(abs(lowest - bottom) < 1e-6) is kept
    assert bool(abs(run.positions()[:, 1].min() - bottom) < 1e-6) is kept
