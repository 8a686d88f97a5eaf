"""Jobs of kind `family_fit`, from a ZIP to the artifacts."""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from contextlib import nullcontext

import numpy as np
import pytest
import safetensors.numpy
from PIL import Image

from bench.parametric_families import family, labels_document
from meshdeform.assets import Limits, build_glb, load_asset
from meshdeform.assets.collection import inspect_collection, open_collection, own_labels
from meshdeform.assets.parted import parts_of, with_parts
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetFormatError,
    AssetTooLargeError,
    CheckpointError,
    ParameterError,
)
from meshdeform.kinds.families.reading import MemberReading, agreed_nouns
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import check_request, start_run
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.settings import Settings
from meshdeform.vocabulary.solids import PART_NAMES
from tests.cases import each_case

PARAMS = {"points": 20, "samples": 50, "iterations": 2, "epochs": 3, "embed_labels": True, "read": False}


def packed(files, labels=None):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in files.items() if isinstance(files, dict) else files:
            archive.writestr(name, content)
        if labels is not None:
            archive.writestr("labels.json", labels if isinstance(labels, str) else json.dumps(labels))
    return buffer.getvalue()


@pytest.fixture(scope="module")
def chairs():
    return family("chairs", 10)


@pytest.fixture(scope="module")
def glbs(chairs):
    return {member.name: member.glb() for member in chairs}


def begin(data, checkpoint=None, **params):
    request = JobRequest.model_validate({"kind": "family_fit", "params": grouped({**PARAMS, **params})})
    return start_run(RunInput(request, {"collection": InputFile(data, "chairs.zip")}, checkpoint=checkpoint))


def same_state(one, other):
    """Whether two checkpoints hold the same bits; safetensors writes metadata in any order."""
    a, b = safetensors.numpy.load(one), safetensors.numpy.load(other)
    return a.keys() == b.keys() and all(a[name].tobytes() == b[name].tobytes() for name in a)


def test_a_collection_becomes_all_artifacts_and_a_resumed_run_equals_it_bit_for_bit(chairs, glbs):
    data = packed(glbs, labels_document("chairs", chairs, 6))
    run = begin(data)
    kept = {}
    for report in run:
        kept[report.step] = run.checkpoint()
        assert np.isfinite(report.losses["total"])
    assert report.step == report.total_steps == 15
    for step in (0, 4, 11, 13):  # while it reads, infers, learns
        again = begin(data, kept[step]) if step else begin(data)
        assert [r.step for r in again] == list(range(step + 1, 16))
        assert same_state(again.checkpoint(), kept[15])
    with pytest.raises(CheckpointError):
        begin(data, kept[4], seed=1)
    artifacts = run.finish()
    _check_arrays(artifacts, glbs, chairs)
    _check_report(json.loads(artifacts["report.json"].data))
    _check_wall(artifacts, glbs)
    assert Image.open(io.BytesIO(artifacts["preview.png"].data)).size[0] >= 480
    machine = safetensors.numpy.load(artifacts["family.safetensors"].data)
    assert machine["template.points"].shape == (20, 3)
    assert machine["machine.a"].shape[0] == 60


def unfinished_at(run, step):
    """The artifacts of a run that is ended after a step, and its report."""
    for report in run:
        if report.step == step:
            break
    artifacts = {name: artifact.data for name, artifact in run.so_far().items()}
    return artifacts, json.loads(artifacts["report.json"])


@each_case(
    ("step", "read", "said"),
    [(6, 6, "6 of 10 assets are read"), (10, 10, "new shapes cannot be made"), (13, 10, "the best one so far")],
)
def test_a_run_that_is_ended_leaves_the_parts_that_it_found_so_far(chairs, glbs, step, read, said):
    data = packed(glbs, labels_document("chairs", chairs, 4))
    run = begin(data)
    artifacts, report = unfinished_at(run, step)
    assert report["unfinished"] == {"step": step, "total_steps": 15}
    assert said in report["warnings"][-1]
    assert not any("cannot be read" in warning for warning in report["warnings"])
    assert [asset["name"] for asset in report["assets"]] == list(glbs)[:read]
    with zipfile.ZipFile(io.BytesIO(artifacts["labelled.zip"])) as archive:
        assert archive.namelist() == list(glbs)[:read]
    found = np.load(io.BytesIO(artifacts["segmentation.npz"]))
    for number in range(4):  # given labels are kept
        assert [report["parts"][part] for part in found[f"{number:04d}"]] == chairs[number].parts()
    assert ("family.safetensors" in artifacts) is (step > 12)
    assert same_state(run.checkpoint(), begin(data, run.checkpoint()).checkpoint())


def test_of_a_run_that_has_read_one_asset_nothing_is_left(glbs):
    run = begin(packed(glbs))
    next(iter(run))
    assert run.so_far() == {}


def test_a_checkpoint_shows_the_assets_in_the_colours_of_their_parts_so_far(chairs, glbs, monkeypatch):
    read_as_their_nodes(monkeypatch, chairs)
    run = begin(packed(glbs), read=True, points=60, samples=200)
    seen = {}
    for report in run:
        if report.step in (3, 12):
            seen[report.step] = load_asset(run.snapshot().data).pieces()
    for step, count in ((3, 3), (12, 10)):
        named = {node["name"] for node in seen[step].nodes}
        assert {name.partition(": ")[0] for name in named} == set(list(glbs)[:count])
        assert {name.partition(": ")[2] for name in named} <= {"seat", "back", "leg", "arm"}
        assert len(named) > 2 * count


def _check_arrays(artifacts, glbs, chairs):
    parts = np.load(io.BytesIO(artifacts["segmentation.npz"].data))
    places = np.load(io.BytesIO(artifacts["correspondences.npz"].data))
    names = list(parts["parts"])
    assert list(parts["names"]) == list(glbs)
    assert places["positions"].shape == (10, 20, 3)
    with zipfile.ZipFile(io.BytesIO(artifacts["labelled.zip"].data)) as archive:
        assert archive.namelist() == list(glbs)
        for number, (name, glb) in enumerate(glbs.items()):
            source = load_asset(glb)
            surface, found = source.surface, parts[f"{number:04d}"]
            # A place is where its triangle and weights say.
            corners = surface.positions[surface.triangles[places["triangles"][number]]]
            np.testing.assert_allclose(
                np.einsum("kc,kcd->kd", places["weights"][number], corners), places["positions"][number], atol=1e-9
            )
            if number < 6:  # given labels are kept
                assert [names[part] for part in found] == chairs[number].parts()
            again = load_asset(archive.read(name))
            shown = again.surface.positions[again.surface.triangles]
            np.testing.assert_array_equal(shown, surface.positions[surface.triangles])
            for part, flags in parts_of(again).items():
                np.testing.assert_array_equal(flags, found == names.index(part))
            assert sorted(parts_of(again)) == sorted(names[part] for part in np.unique(found))


def _check_wall(artifacts, glbs):
    """Each shape hangs in a place of its own, with the points that are its correspondences."""
    data = artifacts["wall.glb"].data
    root = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    about = root["asset"]["extras"]["meshdeform"]
    assert about["points"] == np.load(io.BytesIO(artifacts["correspondences.npz"].data))["part"].tolist()
    assert [node["name"] for node in root["nodes"]] == list(glbs)
    assert len({tuple(node["translation"]) for node in root["nodes"]}) == about["shapes"] == len(glbs)


def _check_report(report):
    assert report["kind"] == "family_fit"
    assert report["parts"] == ["seat", "back", "leg", "arm"]
    assert report["accuracy"]["held_out"] == 4
    assert 0.5 < report["accuracy"]["parts"] <= 1
    assert report["classes"]["assets"] == 10
    assert [asset["labels"] for asset in report["assets"]] == ["given"] * 6 + ["held out"] * 4


def test_a_collection_that_is_none_is_refused(glbs):
    first = next(iter(glbs.values()))
    two = {"parts": ["a", "b"]}
    cases = [
        ({"one.glb": first}, None, AssetError, "one asset; a family has at least 10"),
        ({"readme.txt": b"x"}, None, AssetEmptyError, "holds no asset"),
        ({**glbs, "../out.glb": first}, None, AssetError, "outside itself"),
        (glbs, {**two, "assets": {"chair_0000.glb": {"nodes": {"seat": "sofa"}}}}, AssetError, "'sofa'.*names no part"),
        (glbs, {**two, "assets": {"nobody.glb": {}}}, AssetError, "'nobody.glb', which is not in the ZIP"),
        (glbs, {"parts": ["a"]}, AssetError, "labels.json is not valid: parts"),
        (glbs, {"parts": ["a", "a"]}, AssetError, "names a part twice"),
        (glbs, "{", AssetError, "labels.json is not valid"),
        ([*glbs.items(), ("./chair_0000.glb", first)], None, AssetError, "holds two files named 'chair_0000.glb'"),
        ({**glbs, "a\nb.glb": first}, None, AssetError, r"name with control characters: 'a\\nb.glb'"),
        ({**glbs, "more.glb": packed(glbs)}, None, AssetFormatError, "more.glb is a ZIP within a ZIP"),
        ({**glbs, "b/chair_0000.glb": first, "c/chair_0000.glb": first}, None, None, ""),
        (
            {**{f"b/{name}": glb for name, glb in glbs.items()}, "c/chair_0000.glb": first},
            {**two, "assets": {"chair_0000.glb": {}}}, AssetError, "'chair_0000.glb', which is the name of 2 assets",
        ),
        ({**glbs, "chair_0000.glb": first[:200]}, None, AssetError, "chair_0000.glb: "),
        ({**glbs, "broken.glb": first[:200]}, None, None, ""),
    ]  # fmt: skip
    for files, labels, error, words in cases:
        with pytest.raises(error, match=words) if error else nullcontext():
            inspect_collection(packed(files, labels), Limits())
    with pytest.raises(AssetTooLargeError, match="unpacks to"):
        open_collection(packed(glbs), dataclasses.replace(Limits(), max_bytes=10_000))
    with pytest.raises(AssetError, match="cannot be read"):
        open_collection(packed(glbs)[:-40], Limits())
    found = inspect_collection(packed(glbs), Limits())
    assert (found.format, found.meshes) == ("zip", 10)
    assert found.triangles > 0


def with_own_parts(chairs, count, *, left_out=()):
    """The first `count` chairs with the attribute `_PART`, which some parts are missing from; the others without."""
    files = {}
    for number, member in enumerate(chairs):
        asset, named = load_asset(member.glb()), np.array(member.parts())
        flags = {part: named == part for part in sorted(set(named) - set(left_out))}
        files[member.name] = with_parts(asset, flags) if number < count else member.glb()
    return files


def results_of(run):
    for _ in run:
        pass
    artifacts = run.finish()
    return json.loads(artifacts["report.json"].data), np.load(io.BytesIO(artifacts["segmentation.npz"].data))


def test_parts_that_assets_have_themselves_are_labels(chairs):
    report, found = results_of(begin(packed(with_own_parts(chairs, 6))))
    assert sorted(report["parts"]) == ["arm", "back", "leg", "seat"]
    assert [asset["labels"] for asset in report["assets"]] == ["given"] * 6 + ["none"] * 4
    for number in range(6):
        named = [report["parts"][part] for part in found[f"{number:04d}"]]
        assert named == chairs[number].parts()


def test_what_has_no_part_in_any_asset_is_the_rest(chairs):
    report, found = results_of(begin(packed(with_own_parts(chairs, 10, left_out=["leg"]))))
    assert sorted(report["parts"]) == ["arm", "back", "rest", "seat"]
    for number, chair in enumerate(chairs):
        named = [report["parts"][part].replace("rest", "leg") for part in found[f"{number:04d}"]]
        assert np.mean(np.array(named) == chair.parts()) > 0.9


def test_labels_beside_the_assets_come_before_their_own(chairs):
    labels = labels_document("chairs", chairs, 3)
    for name in list(labels["assets"])[3:]:
        labels["assets"][name] = {"class": "side"}
    report, _ = results_of(begin(packed(with_own_parts(chairs, 6, left_out=["seat"]), labels)))
    assert report["parts"] == labels["parts"]
    assert [asset["labels"] for asset in report["assets"]] == ["given"] * 6 + ["none"] * 4


def test_of_many_names_those_of_most_assets_count(chairs):
    files = with_own_parts(chairs, 10)
    for number, name in enumerate(list(files)[:3]):
        asset = load_asset(files[name])
        count = len(asset.surface.triangles)
        flags = {f"{number} {each}": np.arange(count) % 20 == each for each in range(20)}
        files[name] = with_parts(asset, flags)
    labels = own_labels(files, Limits())
    assert len(labels.parts) == 15
    assert {"back", "leg", "seat"} <= set(labels.parts)
    assert own_labels({name: chair.glb() for name, chair in zip(files, chairs, strict=True)}, Limits()) is None
    assert own_labels({"broken.glb": next(iter(files.values()))[:400], "a.obj": b"v 0 0 0"}, Limits()) is None


def test_what_cannot_be_read_is_left_out_and_named_and_so_are_copies(glbs):
    whole = build_glb(np.array([[0, 0, 0], [1, 0, 0], [0.1, 1, 0.625]]), np.array([[0, 1, 2]]))
    places = [at for at in range(len(whole)) if whole.startswith(np.float32(0.625).tobytes(), at)]
    broken = whole[: places[-1]] + np.float32("nan").tobytes() + whole[places[-1] + 4 :]
    with pytest.raises(AssetError, match=r"chair_0003\.glb: "):
        for _ in begin(packed({**glbs, "chair_0003.glb": broken})):
            pass
    run = begin(packed({**glbs, "a.glb": broken, "copy.glb": glbs["chair_0002.glb"]}))
    for _ in run:
        pass
    report = json.loads(run.finish()["report.json"].data)
    assert len(report["assets"]) == 11
    assert "1 of 12 assets cannot be read and are left out: a.glb." in report["warnings"]
    assert "1 of 12 assets are copies of others: copy.glb." in report["warnings"]


def test_labels_that_do_not_fit_an_asset_are_refused_with_its_name(glbs):
    wrong = {"parts": ["a", "b"], "assets": {"chair_0000.glb": {"nodes": {"seats": "a"}}}}
    with pytest.raises(AssetError, match="has no node 'seats'") as caught:
        next(iter(begin(packed(glbs, wrong))))
    assert "seat" in caught.value.advice_text
    few = {"parts": ["a", "b"], "assets": {"chair_0000.glb": {"triangles": ["a"]}}}
    with pytest.raises(AssetError, match="triangles, but 1 labels"):
        next(iter(begin(packed(glbs, few))))
    partly = {"parts": ["a", "b"], "assets": {"chair_0000.glb": {"nodes": {"seat": "a"}}}}
    with pytest.raises(AssetError, match="labels no asset completely"):
        for _ in begin(packed(glbs, partly)):
            pass


@each_case(
    ("document", "words"),
    [
        ({"params": {"points": 100, "samples": 60}}, "less than params.points"),
        ({"output": {"morph": True}}, "jobs that deform one asset"),
    ],
)
def test_a_request_that_cannot_run_is_refused(document, words):
    request = JobRequest.model_validate({"kind": "family_fit", **document})
    with pytest.raises(ParameterError, match=words):
        check_request(request, Settings(), files={"collection"})


def read_as_their_nodes(monkeypatch, chairs):
    """Let members be read as their nodes say, the first one as a throne if no noun is given."""
    asked = []

    def read(asset, data, name, noun, readings):
        asked.append((name, noun))
        member = next(each for each in chairs if each.name == name)
        codes = np.array([PART_NAMES.index(part) for part in member.parts()])
        known = {"chair": 0.9} if noun or name != chairs[0].name else {"throne": 0.9}
        return MemberReading(*known, known, codes, np.full(len(codes), 0.9))

    monkeypatch.setattr("meshdeform.kinds.families.fit_run.read_member", read)
    return asked


def test_parts_have_the_names_that_most_members_are_read_with(chairs, glbs, monkeypatch):
    asked = read_as_their_nodes(monkeypatch, chairs)
    data, params = packed(glbs), {"read": True, "points": 60, "samples": 200, "iterations": 8}
    run = begin(data, **params)
    kept = {report.step: run.checkpoint() for report in run}
    report, found = results_of(begin(data, kept[12], **params))
    assert asked.count((chairs[0].name, None)) == asked.count((chairs[0].name, "chair")) == 1  # it is no throne
    assert {asset["noun"] for asset in report["assets"]} == {"chair"}
    assert set(report["parts"]) <= {"seat", "back", "leg", "arm"}
    for number, chair in enumerate(chairs):
        named = np.array([report["parts"][part] for part in found[f"{number:04d}"]])
        assert (named == chair.parts()).mean() > 0.7


def read_as(*nouns):
    """Readings of members, each with its nouns and their probabilities, the first of which it was read as."""
    return [MemberReading(next(iter(each), ""), each, np.empty(0, int), np.empty(0)) for each in nouns]


def test_a_noun_that_few_are_is_believed_only_where_no_noun_is_that_of_most():
    chairs = [{"chair": 0.8, "stool": 0.2}] * 9
    assert agreed_nouns(read_as(*chairs, {"throne": 0.9}, {})) == [*["chair"] * 10, ""]
    kit = [{"car": 0.9, "van": 0.1}] * 4 + [{"bus": 1.0}] * 3 + [{"tractor": 0.9}, {"rover": 1.0}, {}]
    assert agreed_nouns(read_as(*kit)) == [*["car"] * 4, *["bus"] * 3, "tractor", "rover", ""]
    assert agreed_nouns(read_as({})) == [""]
    # What is unsure, or of another kind, is what others are.
    more = {"truck": 0.26, "car": 0.2, "jeep": 0.12}, {"microwave": 0.6, "bus": 0.2}, {"chest": 0.95, "bus": 0.01}
    assert agreed_nouns(read_as(*kit, *more))[-3:] == ["car", "bus", "chest"]


def test_few_labels_are_enough_where_assets_are_read(chairs, glbs, monkeypatch):
    read_as_their_nodes(monkeypatch, chairs)
    words = {"seat": "Sitz", "back": "Lehne", "leg": "Bein", "arm": "Armlehne"}
    labels = labels_document("chairs", chairs, 2)
    labels = json.loads(json.dumps(labels), object_hook=lambda node: {k: words.get(v, v) if isinstance(v, str) else v
                                                                      for k, v in node.items()})  # fmt: skip
    labels["parts"] = list(words.values())
    report, found = results_of(begin(packed(glbs, labels), read=True, points=60, samples=200, iterations=6))
    assert report["parts"] == list(words.values())
    right = [
        np.mean([report["parts"][part] == words[own] for part, own in zip(found[f"{n:04d}"], c.parts(), strict=True)])
        for n, c in enumerate(chairs)
    ]
    assert np.mean(right) > 0.85


def test_a_noun_that_is_none_is_refused():
    request = JobRequest.model_validate({"kind": "family_fit", "params": {"noun": "qwertz"}})
    with pytest.raises(ParameterError, match="no noun of the builtin prior"):
        check_request(request, Settings(), files={"collection"})
