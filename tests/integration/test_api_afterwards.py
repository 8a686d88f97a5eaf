"""Artifacts that a job was not asked for are made of its files later on."""

from __future__ import annotations

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import Asset, build_glb, load_asset
from meshdeform.assets.limits import Limits
from meshdeform.children.asking import run_child
from meshdeform.client import Client
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.document import MorphParams, OutputParams
from meshdeform.runs import derive
from meshdeform.runs.base import FORMATS_OF_RESULT
from meshdeform.runs.derive import DerivedInput
from meshdeform.runs.strength import AssetPath, write_morph
from service.downloads import variants
from tests.cases import each_case
from tests.integration.conftest import Api, new_job
from tests.integration.http_calls import check_document, check_problem, finished_job, kept
from tests.unit.assets.test_bake import two_joints

ORIGIN = {"prompt": "a tall ball", "seed": 7}
STRETCH = [1.0, 3.0, 1.0]


def source() -> Asset:
    mesh = icosphere(1)
    return load_asset(build_glb(mesh.verts, mesh.faces, material="clay"), "ball.glb")


def finished(api: Api, result: bytes, **output: bool) -> str:
    """A job that has succeeded with a result."""
    files = {"asset": kept(api, source().to_bytes(), "ball.glb")}
    return finished_job(api, result, files=files, prompt="x", output=output)


@pytest.fixture
def stretched() -> bytes:
    asset = source()
    return asset.replace(asset.surface.positions * STRETCH, asset.surface.normals, provenance=ORIGIN)


def test_a_morph_is_made_once_and_is_that_of_a_run(
    api: Api, stretched: bytes, openapi: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    job_id = finished(api, stretched, provenance=True, compact=True)
    url, version = f"/v1/jobs/{job_id}/artifacts/morph.glb", api.http.get(f"/v1/jobs/{job_id}").headers["etag"]
    problem = check_problem(api.http.get(url), 404, "not_found")
    assert f"POST {url}" in problem["advice"]
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: api.http.post(url), range(2))
    assert (first.status_code, first.json()) == (200, second.json())
    check_document(first.json(), "ArtifactView", openapi)
    assert api.http.get(f"/v1/jobs/{job_id}").headers["etag"] != version
    names = {each["name"] for each in api.http.get(f"/v1/jobs/{job_id}").json()["artifacts"]}
    assert names == {"result.glb", "morph.glb"}
    objects = [key for key, _ in api.store.list(f"jobs/{job_id}/")]
    assert len(objects) == 2, objects
    assert sum(api.store.size(key) for key in objects) == _stored_bytes(api, job_id)

    answer = api.http.get(url)
    assert answer.headers["etag"] == f'"{first.json()["sha256"]}"'
    assert answer.headers["content-disposition"] == 'attachment; filename="ball-x-seed0.morph.glb"'
    assert api.http.get(url, headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    asset = source()
    path = AssetPath(asset, load_asset(stretched).surface.positions)
    assert answer.content == write_morph(asset, path, path.at(1), MorphParams(), compact=True, provenance=ORIGIN)
    document = json.loads(answer.content[20 : 20 + int.from_bytes(answer.content[12:16], "little")])
    assert [animation["name"] for animation in document["animations"]] == ["deform"]
    shown = load_asset(answer.content).surface.positions  # at rest, as viewers show it
    np.testing.assert_allclose(shown, load_asset(stretched).surface.positions, atol=1e-6)
    # It is there now: nothing is made any more.
    monkeypatch.setattr(derive, "run_child", None)
    assert api.http.post(url).json() == first.json()


def test_other_files_are_deformed_as_the_asset_was(
    api: Api, stretched: bytes, openapi: dict[str, Any], tmp_path: Path
) -> None:
    job_id = finished(api, stretched, compact=True)
    coarse = icosphere(0)
    lod = build_glb(coarse.verts, coarse.faces)
    (tmp_path / "lod.glb").write_bytes(lod)
    with Client(api.url) as client:
        found = load_asset(client.apply(job_id, tmp_path / "lod.glb")).surface.positions
    np.testing.assert_allclose(found, load_asset(lod).surface.positions * STRETCH, atol=0.05)
    names = {each["name"] for each in api.http.get(f"/v1/jobs/{job_id}").json()["artifacts"]}
    assert names == {"result.glb", "map.safetensors"}

    def refused(content: bytes, status: int, code: str, **query: str) -> str:
        headers = {"Content-Type": "application/octet-stream"}
        answer = api.http.post(f"/v1/jobs/{job_id}/apply", content=content, params=query, headers=headers)
        return str(check_problem(answer, status, code)["detail"])

    elsewhere = build_glb(coarse.verts + 50, coarse.faces)
    assert "all outside of what the map deforms" in refused(elsewhere, 422, "parameter_invalid")
    assert "its content is something else" in refused(b"hello", 415, "asset_format")
    assert "outside" in refused(lod, 422, "parameter_invalid", outside="away")
    queued = new_job(api.record).id
    check_problem(api.http.post(f"/v1/jobs/{queued}/apply", content=lod), 409, "job_not_finished")


def _stored_bytes(api: Api, job_id: str) -> int:
    return sum(artifact.size for artifact in api.record.artifacts(job_id))


def test_other_formats_are_made_of_the_result_alone_and_say_what_they_lose(
    api: Api, openapi: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import trimesh

    glb = two_joints().glb()
    files = {"asset": kept(api, glb, "ball.glb")}
    job_id = finished_job(api, glb, files=files, prompt="x", output={})
    api.store.delete(api.record.get(job_id).source.key)
    monkeypatch.setattr(derive, "run_child", run_child)  # real children, bounded as in operation
    names = ["result.stl", "result.3mf", "result.obj.zip", "result.usdz"]
    with Client(api.url) as client:
        stl, *others = client.fetch(job_id, tmp_path, names)
        told = {each.name: each.warnings for each in client.artifacts(job_id)}
    wanted = load_asset(glb).surface
    found = trimesh.load_mesh(stl, process=False).triangles
    np.testing.assert_array_equal(found, wanted.positions[wanted.triangles].astype(np.float32))
    for path, name in zip((stl, *others), names, strict=True):
        answer = api.http.head(f"/v1/jobs/{job_id}/artifacts/{name}")
        kind = next(kind for kind in FORMATS_OF_RESULT if kind.name == name)
        assert answer.headers["content-type"] == kind.media_type
        named = f"ball-x-seed0{name.removeprefix('result')}"
        assert answer.headers["content-disposition"] == f'attachment; filename="{named}"'
        assert answer.headers.get("meshdeform-warnings", "") == " ".join(told[name])
        part = api.http.get(f"/v1/jobs/{job_id}/artifacts/{name}", headers={"Range": "bytes=0-9"})
        assert (part.status_code, part.content) == (206, path.read_bytes()[:10])
        check_document(api.http.post(f"/v1/jobs/{job_id}/artifacts/{name}").json(), "ArtifactView", openapi)
    assert told["result.stl"] == ["Without animations.", "Without skins."]
    assert told["result.glb"] == told["result.usdz"] == []


def test_a_result_in_a_pose_is_made_once_in_any_format(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    glb = two_joints().glb()
    job_id = finished_job(api, glb, files={"asset": kept(api, glb, "ball.glb")}, prompt="x", output={})
    url = f"/v1/jobs/{job_id}/artifacts"
    posed = api.http.get(f"{url}/result.glb", params={"pose": "bend@2"})
    np.testing.assert_allclose(positions(posed.content)[1], [1, 1, 0], atol=1e-6)
    assert posed.headers["meshdeform-warnings"] == "Without animations. Without skins."
    name = posed.headers["content-disposition"].partition("=")[2]
    assert name.startswith('"ball-x-seed0-pose-')
    assert name.endswith('.glb"')
    stl = api.http.get(f"{url}/result.stl", params={"pose": "0@2.0"})
    assert stl.headers["content-type"] == "model/stl"
    np.testing.assert_allclose(load_asset(stl.content, "a.stl").surface.positions.max(0), [1, 1, 0], atol=1e-6)
    assert {each["name"] for each in api.http.get(url).json()["artifacts"]} == {"result.glb"}
    monkeypatch.setattr(variants, "derive", None)  # from here on nothing is made
    with Client(api.url) as client:
        assert client.read(job_id, "result.glb", pose="bend@2") == posed.content
    again = {"If-None-Match": posed.headers["etag"]}
    assert api.http.get(f"{url}/result.glb?pose=bend@2", headers=again).status_code == 304
    signed = api.http.post(f"{url}/result.glb/url").json()["url"]
    check_problem(api.http.get(f"{signed}&pose=bend@2"), 403, "forbidden")
    for query in ("pose=bend", "pose=@1", "pose=bend@1&strength=0.5"):
        check_problem(api.http.get(f"{url}/result.glb?{query}"), 422, "parameter_invalid")
    check_problem(api.http.get(f"{url}/report.json?pose=bend@1"), 422, "parameter_invalid")
    monkeypatch.undo()
    problem = check_problem(api.http.get(f"{url}/result.glb?pose=bend@3"), 422, "parameter_invalid")
    assert "from 0 to 2 s" in problem["advice"]


def test_what_cannot_be_made_is_refused(api: Api, stretched: bytes) -> None:
    waiting = new_job(api.record).id
    check_problem(api.http.post(f"/v1/jobs/{waiting}/artifacts/morph.glb"), 409, "job_not_finished")
    check_problem(api.http.post("/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6/artifacts/morph.glb"), 404, "not_found")
    job_id = finished(api, stretched)
    check_problem(api.http.post(f"/v1/jobs/{job_id}/artifacts/preview.png"), 404, "not_found")
    mesh = icosphere(2)
    other = finished(api, build_glb(mesh.verts, mesh.faces))
    problem = check_problem(api.http.post(f"/v1/jobs/{other}/artifacts/morph.glb"), 422, "asset_unsupported")
    assert "other triangles" in problem["detail"]
    assert [artifact.name for artifact in api.record.artifacts(job_id)] == ["result.glb"]


@each_case("arguments", [{"max_check_s": 0.01}, {"max_memory_bytes": 2**24 - 8 * 2**30}])
def test_a_child_that_exceeds_its_limits_is_an_error(
    arguments: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(derive, "run_child", run_child)
    paths = tmp_path / "source", tmp_path / "result", tmp_path / "target"
    for path in paths[:2]:
        path.write_bytes(source().to_bytes())
    given = derive.DerivedInput(paths[0], paths[1], "ball.glb", OutputParams())
    with pytest.raises(derive.AssetTooLargeError, match="could not be made"):
        derive.derive("morph.glb", given, paths[2], derive.Limits(**arguments))
    assert not paths[2].exists()


@pytest.fixture
def job_id(api: Api, sphere: bytes) -> str:
    """A finished job that has made an ellipsoid of the sphere."""
    source = load_asset(sphere)
    result = source.replace(source.surface.positions * [1.0, 2.0, 1.0])
    files = {"asset": kept(api, sphere)}
    return finished_job(api, result, files=files, more={"report.json": b"{}"}, prompt="an egg")


def positions(data: bytes) -> NDArray[np.float64]:
    return load_asset(data).surface.positions


def test_a_strength_is_made_once_and_can_be_resumed_like_any_artifact(
    api: Api, job_id: str, sphere: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(derive, "run_child", run_child)  # a real child, once
    url = f"/v1/jobs/{job_id}/artifacts/result.glb"
    half = api.http.get(url, params={"strength": 0.5})
    assert half.status_code == 200, half.text
    np.testing.assert_allclose(positions(half.content), positions(sphere) * [1.0, 1.5, 1.0], atol=0.02)
    assert half.headers["content-disposition"] == 'attachment; filename="sphere-an-egg-seed0-strength50.glb"'
    assert half.headers["etag"] == f'"{hashlib.sha256(half.content).hexdigest()}"'
    monkeypatch.setattr(variants, "derive", None)  # from here on nothing is made
    again = {"If-None-Match": half.headers["etag"]}
    assert api.http.get(url, params={"strength": 0.5}, headers=again).status_code == 304
    part = api.http.get(url, params={"strength": 0.5}, headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, half.content[100:200])
    assert api.http.get(url, params={"strength": 1}).content == api.http.get(url).content
    with Client(api.url) as client:
        assert client.read(job_id, "result.glb", strength=0.5) == half.content
    # Deleting the job removes them, too.
    assert len(list(api.store.list(f"jobs/{job_id}/variants/"))) == 1
    assert api.http.delete(f"/v1/jobs/{job_id}").status_code == 204
    assert not list(api.store.list(f"jobs/{job_id}/"))


def test_only_a_few_strengths_of_a_job_are_kept(api: Api, job_id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fake(_name: str, given: DerivedInput, output: Path, _limits: Limits) -> list[str]:
        output.write_bytes(f"{given.strength}".encode())
        return []

    monkeypatch.setattr(variants, "derive", fake)
    monkeypatch.setattr(variants, "_KEPT_PER_JOB", 2)
    for strength in ("0.1", "0.2", "0.3", "0.1"):
        answer = api.http.get(f"/v1/jobs/{job_id}/artifacts/result.glb", params={"strength": strength})
        assert (answer.status_code, answer.text) == (200, strength)
    assert len(list(api.store.list(f"jobs/{job_id}/variants/"))) == 2


def test_what_cannot_be_is_refused(api: Api, job_id: str) -> None:
    url = f"/v1/jobs/{job_id}/artifacts"
    for value in ("1.51", "-0.01", "0.123", "half", "nan"):
        check_problem(api.http.get(f"{url}/result.glb?strength={value}"), 422, "parameter_invalid")
    problem = check_problem(api.http.get(f"{url}/report.json?strength=0.5"), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["query", "strength"]
    check_problem(api.http.get(f"{url}/other.glb?strength=0.5"), 404, "not_found")
    # A signature covers the query: a signed URL of the result opens no other strength.
    signed = api.http.post(f"{url}/result.glb/url").json()["url"]
    check_problem(api.http.get(f"{signed}&strength=0.5"), 403, "forbidden")
