"""The reading of a source: made once, by what the request gives, with what it corrects laid over it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.parted import with_parts
from meshdeform.errors import ModelError, ParameterError
from meshdeform.geometry.shapes import join
from meshdeform.plain.body import Body, loose_body
from meshdeform.plain.joints import is_person
from meshdeform.reading import Reading
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.requests.groups import grouped
from meshdeform.runs import reading
from meshdeform.runs.kept_readings import FolderReadings, key_of
from meshdeform.runs.reading import ReadingSource, corrected, read_source, reading_document, reading_report
from meshdeform.support.recent import Recent
from tests.cases import each_case
from tests.unit.plain.shapes import dog, plain_glb, rigged_dog

ASSET = load_asset(plain_glb(join(*dog().values())))
BODY = loose_body(ASSET)


def params(**named: object) -> ResolvedParams:
    return resolve(DeformParams.model_validate(grouped({"source_noun": "dog", "orientation": 0, **named})))


@pytest.fixture(scope="module")
def read_dog() -> Reading:
    found = read_source(BODY, params())
    assert found is not None
    return found


@pytest.fixture
def readings_made(monkeypatch: pytest.MonkeyPatch, read_dog: Reading) -> list[tuple[dict[str, float], float | None]]:
    """What was asked of each reading that was of a process that remembers none."""
    asked: list[tuple[dict[str, float], float | None]] = []

    def read(
        _body: Body, nouns: dict[str, float], front: float | None, _cache: Path | None = None, **_up: object
    ) -> Reading:
        asked.append((dict(nouns), front))
        return read_dog

    monkeypatch.setattr(reading, "read_body", read)
    monkeypatch.setattr(reading, "_last", Recent(8))
    return asked


def test_nothing_is_read_before_somebody_asks_and_nothing_twice(
    readings_made: list[object], read_dog: Reading, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = ReadingSource("ab", "dog.glb", kept=FolderReadings(tmp_path))
    body = corrected(BODY, ASSET, params(), source)
    assert body.reader.made is None
    assert readings_made == []
    assert body.reader.reading is read_dog
    assert body.reader.reading is read_dog
    assert body.moved(body.points + 1).reader.made is read_dog
    assert readings_made == [({"dog": 1.0}, 0.0)]
    assert read_source(BODY, params(parts=[{"name": "ears", "faces": [1]}]), source) is read_dog  # remembered
    monkeypatch.setattr(reading, "_last", Recent(8))
    again = read_source(BODY, params(), source)  # of the folder, as another process
    assert again is not None
    assert (again.noun, again.confidence) == (read_dog.noun, read_dog.confidence)
    np.testing.assert_array_equal(again.labels, read_dog.labels)
    assert len(readings_made) == 1
    read_source(BODY, params(orientation=90), source)
    read_source(BODY, params(), ReadingSource("", "dog.glb", kept=FolderReadings(tmp_path)))
    assert [front for _, front in readings_made] == [0.0, 90.0, 0.0]


def test_the_job_finds_what_was_read_at_the_door() -> None:
    at_the_door = key_of("ab", ".glb", params())
    assert (
        ReadingSource("ab", "any name.GLB").key(params())
        == ReadingSource("ab", "asset.glb").key(params())
        == at_the_door
    )
    assert ReadingSource("ab", "asset.glb", subdivided=True).key(params()) != at_the_door


@each_case("damage", ["cut", "other bytes", "another version", "another judge", "nothing", "another mesh"])
def test_what_was_kept_and_is_of_no_use_is_read_anew_and_replaced(
    damage: str, readings_made: list[object], read_dog: Reading, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del readings_made[:]
    monkeypatch.setattr(reading, "_last", Recent(8))
    folder = FolderReadings(tmp_path / damage)
    source = ReadingSource("ab", "dog.glb", kept=folder)
    key = source.key(params())
    read_source(BODY, params(), source)
    whole = folder.get(key)
    assert whole is not None
    fewer = Reading(**{**vars(read_dog), "labels": read_dog.labels[:-1]})
    bad = {
        "cut": whole[:-7],
        "other bytes": whole[:-7] + b"1234567",
        "another version": whole.replace(b"meshdeform reading ", b"meshdeform reading X"),
        "another judge": whole.replace(b"judge ", b"judge X"),
        "nothing": b"",
        "another mesh": whole[: whole.index(b"\n") + 1] + fewer.to_bytes(),
    }[damage]
    folder.put(key, bad)
    monkeypatch.setattr(reading, "_last", Recent(8))
    assert read_source(BODY, params(), source) is read_dog
    assert len(readings_made) == 2
    assert folder.get(key) == whole


@each_case(
    ("joints", "person"),
    [
        (["Head", "UpperArm.L", "UpperLeg.L"], True),
        (["mixamorig:Head", "mixamorig:LeftForeArm", "mixamorig:LeftFoot"], True),
        (["Bip01 Head", "Bip01 L Hand", "Bip01 L Thigh"], True),
        (["Armature", "Head", "FrontUpLeg.R"], False),
        (["head", "arm.L", "leg.L", "Tail1"], False),
        (["TankTrack22.L", "Root"], False),
        ([], False),
    ],
)
def test_joints_are_those_of_a_person(joints: list[str], person: bool) -> None:
    assert is_person(joints) is person


def test_the_judge_proposes_nouns_and_a_skeleton_of_a_person_is_one(
    readings_made: list[tuple[dict[str, float], float | None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    nouns = {f"noun{number}": 0.3 - number / 100 for number in range(9)}
    monkeypatch.setattr(reading, "nouns_alike", lambda *_: dict.fromkeys([*nouns, "robot"], 0.1))
    monkeypatch.setattr(reading, "_judged", lambda *_: nouns)
    for front in ("auto", "keep"):
        read_source(BODY, params(source_noun=None, orientation=front))
    dog = loose_body(load_asset(rigged_dog()))
    person = replace(dog, joints=[replace(dog.joints[0], name=name) for name in ("Head", "Arm", "Leg")])
    for body in (person, dog):
        read_source(body, params(source_noun="unknown", orientation=-90))
    figures = nouns | {"robot": 0.6}
    monkeypatch.setattr(reading, "_judged", lambda *_: figures)
    read_source(person, params(source_noun=None, orientation=-90))
    assert [front for _, front in readings_made] == [None, None, -90.0, -90.0, -90.0]
    proposed = [each for each, _ in readings_made]
    assert proposed[0] == proposed[1] == proposed[3]
    assert sum(proposed[0].values()) == pytest.approx(1.0)
    # Alike in shape: the judge decides their order, and what it does not know is last.
    assert sorted(proposed[0], key=lambda noun: -proposed[0][noun]) == [*nouns, "robot"]
    assert proposed[2] == {"person": 1.0}
    assert max(proposed[4], key=lambda noun: proposed[4][noun]) == "robot"


def test_what_cannot_be_read_has_no_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    flat = BODY.moved(BODY.points * [0, 1, 0])
    assert read_source(flat, params()) is None
    assert read_source(flat, params(source_noun=None)) is None

    def missing() -> None:
        raise ModelError("The judge's weights are missing.")

    monkeypatch.setattr("meshdeform.judge.Judge", missing)
    assert read_source(BODY, params(source_noun=None)) is None
    assert reading_document(None, params()) is reading_report(None, params()) is None


def test_the_documents_say_what_was_given_and_what_is_sure(read_dog: Reading) -> None:
    given = reading_document(read_dog, params())
    assert given is not None
    assert given["nouns"] == [{"noun": "dog", "probability": 1.0}]
    assert (given["noun"], given["sure"], given["noun_given"]) == ("dog", True, True)
    assert (given["front_azimuth_deg"], given["front_sure"], given["front_given"]) == (0.0, True, True)
    unsure = Reading(**{**vars(read_dog), "probabilities": {"fox": 0.4, "dog": 0.6}, "front_margin": 0.01})
    found = reading_document(unsure, params(source_noun=None, orientation="auto"))
    assert found is not None
    assert [each["noun"] for each in found["nouns"]] == ["dog", "fox"]
    assert not any(found[name] for name in ("sure", "noun_given", "front_sure", "front_given"))
    report = reading_report(read_dog, params())
    assert report is not None
    assert report["parts"].keys() == set(read_dog.parts)
    assert report["member"] == read_dog.member


def test_a_later_correction_takes_what_an_earlier_one_has() -> None:
    first, second = {"name": "Ears", "faces": [[0, 9]]}, {"name": "horn", "faces": [[5, 14]]}
    body = corrected(BODY, ASSET, params(parts=[first, second, {"name": "ears", "faces": [100]}]))
    assert {name: np.flatnonzero(flags).tolist() for name, flags in body.painted.items()} == {
        "ears": [0, 1, 2, 3, 4, 100],
        "horn": [*range(5, 15)],
    }
    renamed = corrected(BODY, ASSET, params(parts=[{"name": "ears", "parts": ["Horns", "crest", "left thing"]}]))
    assert dict(renamed.renamed) == {"horns": "ears", "crest": "ears", "left thing": "ears"}
    assert renamed.painted == {}


def test_what_the_file_names_is_given_and_the_request_goes_first() -> None:
    flags = np.zeros(len(BODY.faces), bool)
    flags[:8] = True
    asset = load_asset(with_parts(ASSET, {"Horn": flags}))
    body = loose_body(asset)
    assert np.flatnonzero(corrected(body, asset, params()).painted["horn"]).tolist() == list(range(8))
    after = corrected(body, asset, params(parts=[{"name": "ears", "faces": [[0, 3]]}])).painted
    assert {name: np.flatnonzero(own).tolist() for name, own in after.items()} == {
        "horn": [4, 5, 6, 7],
        "ears": [0, 1, 2, 3],
    }


def test_triangles_are_those_of_the_file_though_the_surface_lacks_some() -> None:
    verts, faces = ASSET.surface.positions, ASSET.surface.triangles.copy()
    faces[3] = faces[3][[0, 0, 1]]
    asset = load_asset(build_glb(verts, faces))
    body = corrected(loose_body(asset), asset, params(parts=[{"name": "ear", "faces": [[2, 5]]}]))
    assert np.flatnonzero(body.painted["ear"]).tolist() == [2, 3, 4]
    np.testing.assert_array_equal(body.vertex_map[asset.surface.triangles[5]], body.faces[4])


def test_a_correction_that_selects_nothing_is_refused() -> None:
    for entry in ({"box": {"min": [90, 90, 90], "max": [91, 91, 91]}}, {"node": "Nothing"}, {"component": 99}):
        with pytest.raises(ParameterError) as caught:
            corrected(BODY, ASSET, params(parts=[{"name": "a", "faces": [1]}, {"name": "ears", **entry}]))
        assert caught.value.extra["errors"][0]["loc"][:4] == ["params", "control", "parts", 1]


@each_case(
    "filename, up, said, expected",
    [
        ("a.glb", "y", "auto", (None, 0.1)),
        ("a.obj", None, "auto", ({"dog": 1.0}, 0.1)),
        ("a.STL", None, "auto", ({"dog": 1.0}, 0.8)),
        ("a.3mf", "z", "auto", ({"dog": 1.0}, 1.0)),
        ("a.glb", "y", "z", ({"dog": 1.0}, 1.0)),
        ("a.stl", None, "y", (None, 0.8)),
    ],
)
def test_what_is_up_is_asked_of_formats_that_leave_it_open(
    filename: str, up: str | None, said: str, expected: object, monkeypatch: pytest.MonkeyPatch, read_dog: Reading
) -> None:
    asked: list[object] = []

    def read(*_given: object, z_up: object, z_share: float, **_how: object) -> Reading:
        asked.append((z_up, z_share))
        return read_dog

    monkeypatch.setattr(reading, "read_body", read)
    monkeypatch.setattr(reading, "_last", Recent(8))
    given = params(input={"up": said})
    body = corrected(replace(BODY, up=up), ASSET, given)
    read_source(body, given, ReadingSource("ab", filename))
    assert asked == [expected]


def test_a_request_says_the_unit_and_the_axis_of_a_file() -> None:
    assert corrected(replace(BODY, unit=None), ASSET, params(input={"unit": "in"})).unit == 0.0254
    assert corrected(replace(BODY, unit=1.0), ASSET, params()).unit == 1.0
    lying = corrected(BODY, ASSET, params(input={"up": "z"}))
    standing = lying.upright()
    np.testing.assert_allclose(standing.points, BODY.points[:, [0, 2, 1]] * [1, 1, -1])
    assert corrected(BODY, ASSET, params()).upright() is not standing
    key = ReadingSource("ab", "a.stl").key
    assert len({key(params()), key(params(input={"up": "z"})), key(params(input={"up": "y"}))}) == 3
