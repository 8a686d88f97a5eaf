"""Jobs of kind `surface_fit`: the run by itself, and its refusals."""

from __future__ import annotations

import io
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError
from safetensors.numpy import save
from typer.testing import CliRunner

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.build import Picture, Primitive
from meshdeform.cli.app import app
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetTooLargeError,
    CheckpointError,
    ParameterError,
)
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.kinds.surface_fit.cleaning import clean
from meshdeform.kinds.surface_fit.collapse import base_of
from meshdeform.kinds.surface_fit.learned_scalars import learned_scalars, places_on
from meshdeform.kinds.surface_fit.measures import distances
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.run import _warnings
from meshdeform.kinds.surface_fit.scalar_sections import colours_at, read_scalars
from meshdeform.kinds.surface_fit.surface_sources import MeshSurface
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import check_request, kind_of, start_run
from meshdeform.runs.base import InputFile, JobRun, RunInput
from meshdeform.settings import Settings
from tests.unit.assets.test_pose import bent_arm
from tests.unit.assets.test_rig import arm
from training.shapes import torus

SMALL = {"base_faces": 100, "steps": 4, "octaves": 1, "width": 8, "depth": 1, "level": 1}


def glb(mesh: TriangleMesh, scale: float = 1.0, shift: float = 0.0) -> bytes:
    return build_glb(mesh.verts * scale + shift, mesh.faces)


@pytest.fixture(scope="module")
def ring() -> bytes:
    return glb(torus(n=16, m=10))


def begin(
    data: bytes,
    name: str = "ring.glb",
    *,
    base: bytes | None = None,
    scalars: bytes | None = None,
    checkpoint: bytes | None = None,
    initial: bytes | None = None,
    **params: object,
) -> JobRun:
    request = JobRequest.model_validate({"kind": "surface_fit", "params": grouped({**SMALL, **params})})
    sent = {"asset": (data, name), "base": (base, "base.glb"), "scalars": (scalars, "scalars.npz")}
    files = {part: InputFile(content, called) for part, (content, called) in sent.items() if content is not None}
    return start_run(RunInput(request, files, checkpoint=checkpoint, initial=initial))


def test_a_run_writes_a_field_its_levels_and_what_they_are_worth(ring: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("meshdeform.kinds.surface_fit.run.learned_scalars", partial(learned_scalars, steps=60))
    monkeypatch.setattr("meshdeform.kinds.surface_fit.run._UNCOVERED", -1.0)
    mesh = torus(n=24, m=12)
    scalars = io.BytesIO()
    np.savez(scalars, points=mesh.verts, height=mesh.verts[:, 2])
    run = begin(ring, scalars=scalars.getvalue())
    assert [report.step for report in run] == [1, 2, 3, 4]
    assert len(load_asset(run.snapshot().data).surface.triangles) > 100
    found = run.finish()
    assert set(found) == {
        "surface.ndf", "level_0.glb", "level_1.glb", "intrinsic.npz", "report.json", "preview.png"
    }  # fmt: skip
    kind = kind_of(JobRequest.model_validate({"kind": "surface_fit"}).kind)
    declared = {artifact.name: artifact.media_type for artifact in kind.artifacts}
    assert {name: each.content_type for name, each in found.items()}.items() <= declared.items()
    report = json.loads(found["report.json"].data)
    field = read_field(found["surface.ndf"].data)
    verts, faces = field.unfold(1)
    surface = load_asset(found["level_1.glb"].data).surface
    assert np.abs(surface.positions - verts).max() < 1e-6
    assert len(surface.triangles) == len(faces) == 4 * len(field.faces) == report["levels"][1]["faces"]
    assert report["input"]["genus"] == 1
    missing, coarse = report["input"]["warnings"]
    assert "parts of it are missing" in missing
    assert coarse.startswith("The asset has 320 triangles. Compressed by Draco")
    told = report["levels"][1]["distance"]
    assert told["reversed_faces"] == told["reversed"] == 0
    (fact,) = report["scalars"]
    assert (fact["name"], fact["relative_error"] < 0.3) == ("height", True), fact
    height = read_scalars(field)[0].values(*places_on(field, verts, np.zeros_like(verts)))
    assert np.corrcoef(height[:, 0], verts[:, 2])[0, 1] > 0.95
    assert report["intrinsic"]["all_delaunay"] is True
    assert report["result"]["bytes"] == len(found["surface.ndf"].data)
    assert len(report["eigenvalues"]["input"]) == 20
    assert 0 < report["levels"][1]["distance"]["mean"] < 0.05
    arrays = np.load(io.BytesIO(found["intrinsic.npz"].data))
    assert arrays["faces"].shape == arrays["lengths"].shape == faces.shape


def test_reversed_faces_are_never_silent() -> None:
    mesh = icosphere(2)
    verts, faces = mesh.verts, mesh.faces.copy()
    faces[:4] = faces[:4, ::-1]
    found = distances(MeshSurface(clean(verts, mesh.faces)), verts, faces)
    assert (found["reversed_faces"], found["reversed"]) == (4, pytest.approx(4 / len(faces), rel=0.2))
    (told,) = _warnings({"faces": len(faces), "distance": found}, {})
    assert told.startswith("4 of 320 triangles face the other way than the surface: it is folded.")
    few, turned = found | {"reversed": 0.001}, {"turned_normals": 9}
    assert len(_warnings({"faces": len(faces), "distance": few}, turned)) == 2


def test_a_textured_asset_comes_back_textured(tmp_path: Path) -> None:
    ball, picture, png = icosphere(3), np.zeros((64, 64, 3), np.uint8), io.BytesIO()
    picture[:, :32, 0] = picture[:, 32:, 2] = 255  # red where x < 0, blue elsewhere
    Image.fromarray(picture).save(png, "PNG")
    verts = ball.verts
    part = Primitive(verts, ball.faces, uvs=(verts[:, :2] + 1) / 2, material="paint", texture=Picture(png.getvalue()))
    run = begin(build_glb([part]), "ball.glb", steps=20)
    list(run)
    found = run.finish()
    report = json.loads(found["report.json"].data)
    assert "level_1.glb alone" in report["input"]["warnings"][0]
    data = found["surface.ndf"].data
    painted = read_field(data)
    colours, (verts, _) = colours_at(painted, 2), painted.unfold(2)
    for side, colour in ((verts[:, 0] < -0.2, [255, 0, 0]), (verts[:, 0] > 0.2, [0, 0, 255])):
        assert np.abs(colours[side].astype(int) - colour).mean() < 12
    (tmp_path / "ball.ndf").write_bytes(data)
    unfolded = CliRunner().invoke(app, ["unfold", str(tmp_path / "ball.ndf"), "-o", str(tmp_path / "ball.glb")])
    assert unfolded.exit_code == 0, unfolded.output
    written = load_asset((tmp_path / "ball.glb").read_bytes())
    assert written.appearance().colors.shape == (len(verts), 4)
    assert np.ptp(written.appearance().colors[:, 0]) > 0.9
    asset = load_asset(found["level_1.glb"].data)
    look = asset.appearance()
    pixels = look.paints[0].texture.pixels
    column, row = (look.texcoords * pixels.shape[1::-1]).astype(int).T
    x = asset.surface.positions[look.rows, 0]
    # At the ends of x the picture begins again.
    for side, colour in ((abs(x + 0.5) < 0.4, [255, 0, 0]), (abs(x - 0.5) < 0.4, [0, 0, 255])):
        assert np.abs(pixels[row, column][side][:, :3].astype(int) - colour).max() <= 1
    plain = load_asset(found["level_0.glb"].data).appearance()
    assert plain.paints[0].texture is None


def test_a_rig_is_fitted_in_the_pose_that_its_nodes_give_and_says_so() -> None:
    shown = load_asset(bent_arm().glb()).surface.positions
    assert np.abs(np.ptp(shown, axis=0) - np.ptp(load_asset(arm().glb()).surface.positions, axis=0)).max() > 0.1
    run = begin(bent_arm().glb(), "arm.glb", level=0)
    list(run)
    found = run.finish()
    verts = load_asset(found["level_0.glb"].data).surface.positions
    assert [*verts.min(0), *verts.max(0)] == pytest.approx([*shown.min(0), *shown.max(0)], abs=0.05)
    (said,) = [each for each in json.loads(found["report.json"].data)["input"]["warnings"] if "rig" in each]
    assert "in the pose of the file's nodes" in said


@pytest.mark.parametrize("kind", ["xyz", "npz", "obj"])
def test_a_surface_far_from_the_origin_is_fitted_where_it_is(kind: str) -> None:
    far = np.array([448_262.25, 5_411_932.75, 312.5])
    ball = icosphere(4)
    verts = ball.verts
    if kind == "xyz":
        file = io.BytesIO()
        np.savetxt(file, np.hstack([verts + far, verts]), fmt="%.6f")
    elif kind == "npz":
        file, axis = io.BytesIO(), np.linspace(-1.3, 1.3, 20)
        inside = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij")), axis=0) - 1.0
        np.savez(file, sdf=inside, origin=far - 1.3, spacing=axis[1] - axis[0])
    else:
        lines = ["v {:.6f} {:.6f} {:.6f}".format(*place) for place in verts + far]
        file = io.BytesIO("\n".join([*lines, *("f {} {} {}".format(*face) for face in ball.faces + 1)]).encode())
    run = begin(file.getvalue(), f"a.{kind}")
    list(run)
    written = load_asset(run.finish()["level_1.glb"].data).surface.positions - far
    assert np.abs(np.linalg.norm(written, axis=1) - 1.0).mean() < 0.05  # 32-bit floats there are 0.5 apart


def test_a_resumed_run_writes_the_same_file(ring: bytes) -> None:
    run = begin(ring)
    steps = iter(run)
    next(steps)
    next(steps)
    state = run.checkpoint()
    list(steps)
    resumed = begin(ring, checkpoint=state)
    assert resumed.step == 2
    list(resumed)
    assert resumed.finish()["surface.ndf"] == run.finish()["surface.ndf"]
    assert begin(ring, checkpoint=run.checkpoint()).finish()["surface.ndf"] == run.finish()["surface.ndf"]
    with pytest.raises(CheckpointError):
        begin(ring, checkpoint=state, seed=1)
    branch = begin(ring, initial=state, seed=1)
    assert branch.step == 0
    with pytest.raises(CheckpointError):
        begin(ring, initial=state, width=9)


def test_a_base_of_other_holes_goes_where_its_anchors_say(ring: bytes) -> None:
    ball, sphere = icosphere(1), glb(icosphere(2))
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    # A quarter turn about y, which projection alone would never make.
    turned = axes[:, [2, 1, 0]] * [1, 1, -1]
    anchors = [{"base": list(a), "surface": list(b)} for a, b in zip(axes * 1.2, turned, strict=True)]
    run = begin(sphere, base=glb(ball, 1.2), steps=150, width=16, anchors=anchors)
    assert list(run)[-1].losses["anchors"] < 0.05
    field = read_field(run.finish()["surface.ndf"].data)
    nearest = [int(np.argmax(field.verts @ axis)) for axis in axes]
    found = field.evaluate(np.repeat(np.array(nearest)[:, None], 3, 1), np.tile([1.0, 0.0, 0.0], (6, 1)))
    assert (((found * turned).sum(1) / np.linalg.norm(found, axis=1)) > 0.8).all()

    # A ball for a ring: holes need not agree, and the report has both.
    run = begin(ring, base=glb(ball, 1.2), steps=1, level=0)
    list(run)
    report = json.loads(run.finish()["report.json"].data)
    assert (report["base"]["genus"], report["input"]["genus"], report["base"]["faces"]) == (0, 1, 80)
    with pytest.raises(AssetTooLargeError, match="5120 faces"):
        begin(sphere, base=glb(icosphere(4)))
    for scale, shift in ((1000, 0), (0.001, 0), (1, 9)):
        with pytest.raises(AssetError, match="elsewhere than the surface"):
            begin(sphere, base=glb(ball, scale, shift))
    here = {"base": [0.0, 0.0, 1.0], "surface": [0.0, 0.0, 1.0]}
    for part in here:
        with pytest.raises(ParameterError, match=f"Anchor 2 names a point of the {part} that lies outside"):
            begin(sphere, anchors=[here, {**here, part: [0.0, 0.0, 5.0]}])


def octahedron() -> bytes:
    """Return a network whose value is nearly |x| + |y| + |z| - 1."""
    slope = 20.0
    weight = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32) * slope
    tensors = {
        "layers.0.weight": weight,
        "layers.0.bias": np.zeros(6, np.float32),
        "layers.1.weight": np.full((1, 6), 1 / slope, np.float32),
        "layers.1.bias": np.array([-1.0], np.float32),
    }
    return save(tensors, {"activation": "softplus", "bounds": "[-1.5,-1.5,-1.5,1.5,1.5,1.5]"})


def test_an_octahedron_is_fitted_from_a_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("meshdeform.kinds.surface_fit.surface_sources._CELLS", 16)
    run = begin(octahedron(), "octahedron.safetensors", steps=1)
    list(run)
    report = json.loads(run.finish()["report.json"].data)
    assert report["input"]["described_by"] == "network"
    assert report["input"]["genus"] == 0
    assert report["levels"][1]["distance"]["mean"] < 0.02


def test_what_cannot_be_fitted_is_refused_with_the_reason() -> None:
    plane = build_glb(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(AssetEmptyError, match="only 1 different"):
        begin(plane)
    with pytest.raises(ValidationError, match="base_faces"):
        JobRequest.model_validate({"kind": "surface_fit", "params": {"base_faces": 1}})
    with pytest.raises(ValidationError, match="preset"):
        JobRequest.model_validate({"kind": "surface_fit", "params": {"preset": "preview"}})
    asked = JobRequest.model_validate({"kind": "surface_fit", "output": {"compact": True}})
    with pytest.raises(ParameterError, match="jobs that deform one asset"):
        check_request(asked, Settings(), files=["asset"])
    many = join(*[torus(n=12, m=8) for _ in range(20)])
    apart = many.verts + np.repeat(np.arange(20), 96)[:, None] * 3.0
    with pytest.raises(AssetError, match="20 parts, 20 handles and 0 borders, which need a base of 60"):
        base_of(clean(apart, many.faces), 20)


def test_a_branch_has_the_network_of_its_job() -> None:
    kind = kind_of(JobRequest.model_validate({"kind": "surface_fit"}).kind)
    job = JobRequest.model_validate({"kind": "surface_fit", "params": {"width": 16, "steps": 9}})
    branch = kind.as_branch(job, JobRequest.model_validate({"kind": "surface_fit", "params": {"steps": 5}}))
    assert branch.params.model_dump()["width"] == 16
    assert branch.params.model_dump()["steps"] == 5
    with pytest.raises(ParameterError, match=r"same params\.width"):
        kind.as_branch(job, JobRequest.model_validate({"kind": "surface_fit", "params": {"width": 8}}))
