"""Jobs of kind `family_synthesize`, from a fitted family to new assets."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import zipfile

import numpy as np
import pytest
import safetensors.numpy

from bench.parametric_families import family, labels_document
from meshdeform.assets import load_asset
from meshdeform.assets.parted import parts_of
from meshdeform.errors import (
    AssetError,
    AssetFormatError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
    ParameterError,
)
from meshdeform.kinds.families.family_file import dump_family, read_family
from meshdeform.requests.document import JobRequest
from meshdeform.runs import check_request, start_run
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.unit.kinds.families.test_family_fit import packed, same_state


@pytest.fixture(scope="module")
def chairs():
    """Ten labelled chairs, fitted: the assets, and the results."""
    members = family("chairs", 10)
    glbs = {member.name: member.glb() for member in members}
    params = {"points": 40, "samples": 80, "iterations": 3, "epochs": 20, "embed_labels": True, "read": False}
    request = JobRequest.model_validate({"kind": "family_fit", "params": params})
    data = packed(glbs, labels_document("chairs", members, 10))
    run = start_run(RunInput(request, {"collection": InputFile(data, "chairs.zip")}))
    for _ in run:
        pass
    results = {name: artifact.data for name, artifact in run.finish().items()}
    return glbs, data, results


def begin(chairs, *, checkpoint=None, collection=None, fitted=None, **params):
    request = JobRequest.model_validate({"kind": "family_synthesize", "params": params})
    check_request(request, Settings(), files={"family", "collection"})
    files = {
        "family": InputFile(fitted or chairs[2]["family.safetensors"], "family.safetensors"),
        "collection": InputFile(collection or chairs[1], "chairs.zip"),
    }
    return start_run(RunInput(request, files, checkpoint=checkpoint))


def finished(run):
    for _ in run:
        pass
    return run.finish()


def shapes_of(artifacts):
    with zipfile.ZipFile(io.BytesIO(artifacts["shapes.zip"].data)) as archive:
        return [archive.read(name) for name in sorted(archive.namelist())]


def corners(asset, node=None):
    """The corners of all triangles, or of those of a node, in any order of triangles."""
    surface = asset.surface
    chosen = np.ones(len(surface.triangles), bool)
    if node is not None:
        chosen = asset.pieces().in_node(next(n["index"] for n in asset.pieces().nodes if n["name"] == node))
    rows = surface.positions[surface.triangles[chosen]].reshape(-1, 9)
    return rows[np.lexsort(rows.T)]


def test_samples_are_assets_of_members_parts_and_a_resumed_run_equals_it_bit_for_bit(chairs):
    run = begin(chairs, count=2, seed=3)
    kept = {}
    for report in run:
        kept[report.step] = run.checkpoint()
    assert report.step == report.total_steps == 2
    artifacts = run.finish()
    for step in (1,):
        again = begin(chairs, count=2, seed=3, checkpoint=kept[step])
        assert [r.step for r in again] == list(range(step + 1, 3))
        assert same_state(again.checkpoint(), kept[2])
        assert shapes_of(again.finish()) == shapes_of(artifacts)
    made = shapes_of(artifacts)
    assert made[0] == artifacts["result.glb"].data != made[1]
    report = json.loads(artifacts["report.json"].data)
    for glb, about in zip(made, report["shapes"], strict=True):
        asset = load_asset(glb)
        assert [node["name"] for node in asset.pieces().nodes] == [part["part"] for part in about["parts"]]
        # Each part has the triangles and the material of the part of its member.
        for part in about["parts"]:
            member = load_asset(chairs[0][part["member"]])
            count = sum(
                int(member.pieces().of_material(m["index"]).sum())
                for m in member.pieces().materials if m["name"] == part["part"]
            )  # fmt: skip
            assert len(corners(asset, part["part"])) == count
            assert max(part["gap"], part["penetration"]) < 0.01
        assert {m["name"] for m in asset.pieces().materials} == {part["part"] for part in about["parts"]}
        named = parts_of(asset)
        assert list(named) == [part["part"] for part in about["parts"]]
        for node in asset.pieces().nodes:
            np.testing.assert_array_equal(named[node["name"]], asset.pieces().in_node(node["index"]))
        assert 0 <= about["plausibility"] <= 1
        assert len(about["nearest_members"]) == 3
    points = np.load(io.BytesIO(artifacts["points.npz"].data))
    assert points["points"].shape == (2, 40, 3)


def test_a_run_that_is_ended_leaves_the_shapes_that_it_made(chairs):
    whole = begin(chairs, count=3, seed=3)
    assert whole.so_far() == {}
    next(steps := iter(whole))
    artifacts = whole.so_far()
    report = json.loads(artifacts["report.json"].data)
    assert report["unfinished"] == {"step": 1, "total_steps": 3}
    assert report["warnings"][-1].endswith("1 of 3 shapes are made.")
    assert len(shapes_of(artifacts)) == len(report["shapes"]) == 1
    next(steps)
    named = {node["name"] for node in load_asset(whole.snapshot().data).pieces().nodes}
    assert {name.partition(": ")[0] for name in named} == {"shape 0", "shape 1"}
    assert {name.partition(": ")[2] for name in named} <= {"seat", "back", "leg", "arm"}
    assert "unfinished" not in json.loads(finished(begin(chairs, count=1))["report.json"].data)


def test_an_interpolation_begins_and_ends_with_the_members(chairs):
    made = shapes_of(finished(begin(chairs, mode="interpolate", members=["chair_0000", "chair_0004.glb"], count=3)))
    for glb, name in ((made[0], "chair_0000.glb"), (made[2], "chair_0004.glb")):
        np.testing.assert_array_equal(corners(load_asset(glb)), corners(load_asset(chairs[0][name])))
    between = load_asset(made[1]).surface.positions
    ends = [np.ptp(load_asset(glb).surface.positions, axis=0) for glb in (made[0], made[2])]
    assert (np.ptp(between, axis=0) > np.minimum(*ends) - 0.05).all()
    assert (np.ptp(between, axis=0) < np.maximum(*ends) + 0.05).all()


def test_a_completion_keeps_the_given_parts_exactly(chairs):
    artifacts = finished(begin(chairs, mode="complete", members=["chair_0001.glb"], keep=["seat", "leg"], count=2))
    member = load_asset(chairs[0]["chair_0001.glb"])
    materials = {each["name"]: each["index"] for each in member.pieces().materials}
    for glb in shapes_of(artifacts):
        asset = load_asset(glb)
        for part in ("seat", "leg"):
            rows = member.surface.triangles[member.pieces().of_material(materials[part])]
            wanted = member.surface.positions[rows].reshape(-1, 9)
            np.testing.assert_array_equal(corners(asset, part), wanted[np.lexsort(wanted.T)])
    shapes = json.loads(artifacts["report.json"].data)["shapes"]
    assert all(part["kept"] == (part["part"] in {"seat", "leg"}) for shape in shapes for part in shape["parts"])


def test_a_search_names_the_nearest_members(chairs):
    artifacts = finished(begin(chairs, mode="search", members=["chair_0002"], count=3))
    assert set(artifacts) == {"report.json", "preview.png", "wall.glb"}
    found = json.loads(artifacts["report.json"].data)["nearest_members"]
    descriptors = np.load(io.BytesIO(chairs[2]["descriptors.npz"]))["descriptors"]
    distance = np.abs(descriptors - descriptors[2]).sum(1)
    order = [i for i in np.argsort(distance, kind="stable") if i != 2][:3]
    assert [each["name"] for each in found] == [f"chair_{i:04d}.glb" for i in order]
    np.testing.assert_allclose([each["distance"] for each in found], distance[order], rtol=1e-5)


def test_the_labelled_assets_serve_as_the_collection(chairs):
    by_zip = finished(begin(chairs, count=1))
    by_labelled = finished(begin(chairs, count=1, collection=chairs[2]["labelled.zip"]))
    one, other = (load_asset(shapes_of(each)[0]) for each in (by_zip, by_labelled))
    np.testing.assert_array_equal(corners(one), corners(other))
    # Members whose names differ in the ending alone are two.
    rows = ["solid a", "facet normal 0 0 1", "outer loop", "vertex 0 0 0", "vertex 1 0 0", "vertex 0 1 1", "endloop"]
    stl = "\n".join([*rows, "endfacet", "endsolid a"]).encode()
    data = packed({**chairs[0], "chair_0000.stl": stl})
    params = {"points": 20, "samples": 50, "iterations": 1, "epochs": 1, "embed_labels": True, "read": False}
    request = JobRequest.model_validate({"kind": "family_fit", "params": params})
    results = finished(start_run(RunInput(request, {"collection": InputFile(data, "chairs.zip")})))
    fitted, labelled = (results[name].data for name in ("family.safetensors", "labelled.zip"))
    asked = {"mode": "search", "members": ["chair_0000.stl"]}
    assert finished(begin(chairs, fitted=fitted, collection=labelled, **asked))


def test_a_family_of_an_earlier_version_knows_its_members(chairs):
    found = read_family(chairs[2]["family.safetensors"])
    digests = []
    for name in found.names:
        surface = load_asset(chairs[0][name]).surface
        digests.append(hashlib.sha256(surface.positions.tobytes() + surface.triangles.tobytes()).hexdigest())
    assert not set(digests) & set(found.digests)
    earlier = dump_family(dataclasses.replace(found, digests=digests), {})
    assert shapes_of(finished(begin(chairs, count=1, fitted=earlier)))


def test_a_family_that_cannot_be_used_is_refused(chairs):
    whole = chairs[2]["family.safetensors"]
    found = read_family(whole)
    version = whole.replace(b"meshdeform-family-3", b"meshdeform-family-2")
    arrays = safetensors.numpy.load(whole)
    places = np.where(np.arange(found.points.size).reshape(found.points.shape) == 5, np.nan, found.points)
    strong = {**found.machine, "a": found.machine["a"] * np.float32(1e9)}
    cases = [
        (version, AssetFormatError, "this version reads 'meshdeform-family-3'"),
        (whole[:-8], AssetTruncatedError, "damaged or incomplete"),
        (b"\x80\x04\x95" + b"x" * 60, AssetFormatError, "not a safetensors file"),
        (safetensors.numpy.save(arrays), AssetFormatError, "holds no family"),
        (dump_family(dataclasses.replace(found, points=places), {}), AssetNotFiniteError, "points that are not finite"),
        (dump_family(dataclasses.replace(found, names=found.names[:-1]), {}), AssetError, "does not fit together"),
        (dump_family(dataclasses.replace(found, triangles=found.triangles + 10**6), {}), AssetError, "names no triang"),
        (dump_family(dataclasses.replace(found, labels=found.labels + 4), {}), AssetError, "a part has no name"),
        (dump_family(dataclasses.replace(found, points=found.points * 1e9), {}), AssetError, "points lie outside"),
        (dump_family(dataclasses.replace(found, scaling=found.scaling * 1e-9), {}), AssetError, "size is out of range"),
        (dump_family(dataclasses.replace(found, machine=strong), {}), AssetError, "a of the machine is out of range"),
    ]  # fmt: skip
    for data, error, words in cases:
        with pytest.raises(error, match=words):
            read_family(data)
    from meshdeform.assets import Limits

    with pytest.raises(AssetTooLargeError):
        read_family(whole, dataclasses.replace(Limits(), max_bytes=1000))
    other = {**chairs[0], "chair_0003.glb": chairs[0]["chair_0002.glb"]}
    with pytest.raises(AssetError, match=r"chair_0003\.glb has another shape"):
        finished(begin(chairs, mode="search", members=["chair_0003"], collection=packed(other)))
    for name in ("diagonals", "centres"):
        far = dump_family(dataclasses.replace(found, **{name: getattr(found, name) * 2.0 + 1e-3}), {})
        with pytest.raises(AssetError, match=r"chair_\d+\.glb has another size or place"):
            finished(begin(chairs, count=1, fitted=far))
    nothing = dump_family(dataclasses.replace(found, exists=np.zeros_like(found.exists)), {})
    with pytest.raises(AssetError, match="Shape 0 has no point that any member has"):
        finished(begin(chairs, count=1, fitted=nothing))
    renamed = {name.replace("chair_0005", "stool"): data for name, data in chairs[0].items()}
    with pytest.raises(AssetError, match=r"has no 'chair_0005\.glb'"):
        begin(chairs, count=1, collection=packed(renamed))


@each_case(
    ("params", "words"),
    [
        ({"mode": "interpolate", "members": ["chair_0000"]}, "takes two members, not 1"),
        ({"mode": "interpolate", "members": ["a", "a"]}, "are the same"),
        ({"mode": "interpolate", "members": ["chair_0000", "chair_0000.glb"]}, "are the same"),
        ({"mode": "interpolate", "members": ["a", "b"], "count": 1}, "at least two shapes"),
        ({"members": ["a"]}, "takes no member"),
        ({"mode": "complete", "members": ["chair_0000"]}, "needs the parts to keep"),
        ({"keep": ["seat"]}, "is for the mode complete"),
        ({"mode": "search", "members": ["sofa"]}, "has no member 'sofa'"),
        ({"mode": "complete", "members": ["chair_0000"], "keep": ["wheel"]}, "has no part 'wheel'"),
    ],
)
def test_a_request_that_cannot_run_is_refused(chairs, params, words):
    with pytest.raises(ParameterError, match=words) as caught:
        begin(chairs, **params)
    assert caught.value.extra["errors"][0]["loc"][0] == "params"
