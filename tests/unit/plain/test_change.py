"""What changes make of a dog of boxes and of a chair, and of their files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from meshdeform.assets import Limits, load_asset
from meshdeform.errors import ParameterError, PartNotFoundError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.plain.body import Body, loose_body
from meshdeform.plain.change import Done, apply_changes, meant
from meshdeform.plain.naming import find_parts
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.table import OF_PARTS
from meshdeform.plain.words import Sentence, read_changes
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import JobFile, job_input
from meshdeform.runs.changes import check_parts, part_names
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from meshdeform.settings import Settings
from meshdeform.vocabulary.lookup import noun_of
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.assets.playing import Player
from tests.unit.plain.reading import body_of
from tests.unit.plain.shapes import HIP, _box, chair, dog, plain_glb, rigged_dog


def changed(body: Body, text: str) -> tuple[Body, list[Done]]:
    sentence = read_changes(text)
    assert sentence is not None
    return apply_changes(body, sentence.changes)


def run(glb: bytes, prompt: str, noun: str | None = None, **output: object) -> tuple[bytes, dict[str, object]]:
    given = grouped({"source_noun": noun}) if noun else {}
    request = JobRequest.model_validate({"prompt": prompt, "params": given, "output": output})
    made = text_deform.start(job_input(glb, "asset.glb", request))
    assert [*made] == []
    artifacts = made.finish()
    return artifacts["result.glb"].data, json.loads(artifacts["report.json"].data)


DOGS = {"joints": body_of(rigged_dog()), "shapes": body_of(plain_glb(join(*dog().values())), "dog")}
SHOWN = {**DOGS, "chair": body_of(plain_glb(chair()), "chair")}


@each_case("found_by", DOGS)
def test_longer_legs_lift_the_body_and_keep_feet_and_everything_else(found_by: str) -> None:
    body = DOGS[found_by]
    after, (done,) = changed(body, "legs longer by 30 %")
    assert (done.found_by, done.flips, done.warnings) == (found_by, 0, [])
    assert done.got == pytest.approx(1.3, abs=0.03)
    above = body.points[:, 1] > HIP + 0.2
    lift = after.points[above] - body.points[above]
    np.testing.assert_allclose(lift, np.tile(lift.mean(0), (len(lift), 1)), atol=0.02)
    np.testing.assert_allclose(lift.mean(0), [0, 0.3 * HIP, 0], atol=0.05)
    feet = body.points[:, 1] < 0.02
    np.testing.assert_allclose(after.points[feet], body.points[feet], atol=1e-9)


@each_case("found_by", DOGS)
def test_head_and_tail_grow_alone(found_by: str) -> None:
    body = DOGS[found_by]
    assert {"legs", "head", "neck", "tail"} <= set(part_names(body))
    for text in ("a bigger head", "a longer tail"):
        after, (done,) = changed(body, text)
        assert done.flips == 0
        assert done.got == pytest.approx(done.change.factor, abs=0.05)
        trunk = (np.abs(body.points[:, 2]) < 0.5) & (body.points[:, 1] < 1.9)
        np.testing.assert_allclose(after.points[trunk], body.points[trunk], atol=1e-9)


def test_fat_scales_sections_and_no_lengths() -> None:
    body = DOGS["joints"]
    after, (done,) = changed(body, "fatter")
    assert done.got == pytest.approx(done.change.factor, abs=0.05)
    assert np.ptp(after.points[:, 2]) == pytest.approx(np.ptp(body.points[:, 2]), rel=0.03)
    assert after.points[:, 1].min() == pytest.approx(0)


def test_a_result_is_as_symmetric_as_its_source() -> None:
    body = DOGS["shapes"]
    for text in ("longer legs", "fatter", "a bigger head", "wider"):
        after, _ = changed(body, text)
        images = after.points * [-1, 1, 1]
        assert after.partners is not None
        np.testing.assert_allclose(after.points[after.partners], images, atol=1e-6)


def test_a_couch_is_longer_along_its_longer_side() -> None:
    seat, back = _box((-1.5, 0.4, -0.5), (1.5, 0.6, 0.5)), _box((-1.5, 0.6, -0.5), (1.5, 1.2, -0.3))
    legs = [_box((x, 0, z), (x + 0.1, 0.4, z + 0.1), 1) for x in (-1.5, 1.4) for z in (-0.5, 0.4)]
    body = body_of(plain_glb(join(seat, back, *legs)))
    after, _ = changed(body, "twice as long")
    np.testing.assert_allclose(np.ptp(after.points, axis=0), [6.0, 1.2, 1.0], atol=1e-6)


def test_parts_of_a_chair() -> None:
    body = SHOWN["chair"]
    after, (done,) = changed(body, "a taller back")
    assert done.got == pytest.approx(1.4, abs=0.01)
    low = body.points[:, 1] < 0.6
    np.testing.assert_allclose(after.points[low], body.points[low], atol=1e-9)
    for text in ("a bigger head", "a longer tail"):
        with pytest.raises(PartMissingError):
            changed(body, text)


def read(text: str) -> Sentence | None:
    return read_changes(text, noun_of)


@each_case("shown", SHOWN)
def test_every_sentence_that_is_offered_is_a_change_of_just_that_part(shown: str) -> None:
    body = SHOWN[shown]
    found = {part.name: part for part in find_parts(body, read)}
    others = ["seat", "back"] if shown == "chair" else ["head", "neck", "tail"]
    assert set(found) - {"hips", "nose"} == {"legs", *others}
    for part in found.values():
        for operation in part.operations:
            for word, factor in zip(OF_PARTS[operation], (1.3, 0.7), strict=True):
                _, (done,) = changed(body, f"{part.name} {word} by 30 %")
                assert (done.change.operation, done.found_by) == (operation, part.found_by)
                assert done.change.factor == pytest.approx(factor)
    assert [part.name for part in find_parts(body, read, read("a taller and longer leg"))] == ["legs"]


def two_nodes(*names: str) -> bytes:
    """A slab and a rod that do not touch, as nodes with these names and as many triangles as each has."""
    builder = Builder()
    for name, mesh in zip(names, (_box((-1, 0, -1), (1, 0.2, 1)), _box((0, 0.5, 0), (0.1, 1.5, 0.1))), strict=True):
        faces = mesh.faces.astype(np.uint16)
        builder.node(builder.mesh(builder.primitive(mesh.verts, faces)), name=name)
    return builder.glb()


def test_the_triangles_of_a_named_part_are_those_of_its_node() -> None:
    asset = load_asset(two_nodes("Plinth.001", "AntennaLeft"))
    body, nodes = loose_body(asset), asset.pieces().node_of_triangle
    found = {part.name: part.faces(body.vertex_map[asset.surface.triangles]) for part in find_parts(body, read)}
    assert {name: found[name] for name in ("plinth", "antenna")} == {
        "plinth": [[0, int((nodes == 0).sum()) - 1]],
        "antenna": [[int((nodes == 0).sum()), len(nodes) - 1]],
    }


def test_nothing_is_known_of_what_nobody_read() -> None:
    body = body_of(plain_glb(icosphere(3)))
    assert part_names(body) == []
    with pytest.raises(PartMissingError, match="nobody knows what the asset is"):
        changed(body, "longer legs")


@each_case("name", ["Big", "TallTower", "of", "7", "Short_Long", "Puppy"])
def test_a_name_that_a_sentence_would_read_as_something_else_is_no_part(name: str) -> None:
    assert name.lower() not in part_names(body_of(two_nodes("Plinth", name)))


def test_a_backdrop_belongs_to_no_part() -> None:
    body = SHOWN["chair"]
    (legs,) = find_parts(body, read, read("longer legs"))
    corners = np.concatenate([body.faces[:2], [[0, 1, -1]], body.faces[2:]])
    first, *_ = np.flatnonzero(legs.inside)
    legs = replace(legs, inside=np.arange(len(body.faces)) < 3)
    assert legs.faces(corners) == [[0, 1], 3]
    assert first >= 0


def test_several_changes_in_one_sentence_are_made_in_order() -> None:
    body = DOGS["joints"]
    after, done = changed(body, "longer legs and a bigger head")
    assert [each.change.part for each in done] == ["leg", "head"]
    assert all(each.got == pytest.approx(each.change.factor, abs=0.05) for each in done)
    assert after.points[:, 1].max() > body.points[:, 1].max() + 0.4


@each_case("turned", [False, True])
def test_joints_go_with_what_grows_around_them_in_the_pose_that_is_shown(turned: bool) -> None:
    glb = rigged_dog(turned=turned)
    before, after = Player(glb), Player(run(glb, "taller", "dog")[0])
    joints = before.root["skins"][0]["joints"]
    places, verts = (
        [np.c_[rows, np.ones(len(rows))] for rows in each]
        for each in (
            [np.array(player.worlds(None))[joints, :3, 3] for player in (before, after)],
            [player.at(None, 0).verts for player in (before, after)],
        )
    )
    start = 0
    for number, part in enumerate(dog().values()):
        rows = slice(start, start := start + len(part.verts))
        change = np.linalg.lstsq(verts[0][rows], verts[1][rows])[0]
        np.testing.assert_allclose(places[1][number], places[0][number] @ change, atol=0.03)


@each_case("turned", [False, True])
def test_the_animation_of_a_rigged_file_plays_as_before_at_the_new_height(turned: bool) -> None:
    glb = rigged_dog(turned=turned)
    result, report = run(glb, "longer legs", "dog")
    assert report["way"] == "change"
    assert report["rig"]["mode"] == "follow"  # type: ignore[index]
    before, after = Player(glb), Player(result)
    lift = 0.4 * HIP
    for time in (None, 0.0, 0.5, 1.0):
        source, changed_ = before.at(time, 0).verts, after.at(time, 0).verts
        upper = before.at(None, 0).verts[:, 1] > HIP + 0.2
        # The body plays as before, higher; a leg of 1.4 times the length turns about the lifted hip.
        np.testing.assert_allclose(changed_[upper], source[upper] + [0, lift, 0], atol=0.03)
        swung = source[:, 1].min()
        assert changed_[:, 1].min() == pytest.approx(swung, abs=0.1)
        assert after.at(time, 0).lengths == pytest.approx(after.at(None, 0).lengths, abs=1e-5)


def test_an_animated_node_goes_along_unless_it_is_to_be_kept() -> None:
    builder, mesh = Builder(), chair()
    faces = mesh.faces.astype(np.uint16)
    builder.node(builder.mesh(builder.primitive(mesh.verts, faces)), name="Swivel")
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    turn = builder.accessor(np.array([[0, 0, 0, 1], [0, 1, 0, 0]], np.float32))
    channel = {"sampler": 0, "target": {"node": 0, "path": "rotation"}}
    builder.root["animations"] = [{"samplers": [{"input": times, "output": turn}], "channels": [channel]}]
    for rig, told in (("keep", True), ("follow", False)):
        _, report = run(builder.glb(), "taller", "chair", rig=rig)
        assert any("1 animated node, which stayed" in text for text in report["warnings"]) is told  # type: ignore[attr-defined]


def test_a_rig_that_is_to_be_kept_is_kept() -> None:
    glb = rigged_dog()
    result, report = run(glb, "longer legs", "dog", rig="keep")
    assert report["rig"]["mode"] == "keep"  # type: ignore[index]
    assert load_asset(result).rig_digest() == load_asset(glb).rig_digest()


def test_everything_else_in_the_file_stays() -> None:
    mesh = join(*dog().values())
    glb = plain_glb(mesh, name="Rex", extras={"owner": "us"}, translation=[3, 0, 1], scale=[2, 2, 2])
    result, report = run(glb, "taller", "dog")
    assert json.dumps(Player(result).root["nodes"]) == json.dumps(Player(glb).root["nodes"])
    assert report["mesh"]["same_faces"] is True  # type: ignore[index]
    assert report["changes"] == [
        {"operation": "tall", "part": "whole", "found_by": "", "asked": 1.4, "factor": 1.4, "got": 1.4, "flips": 0}
        | {"grown": 1.4, "other": 1.0, "rest": 0.0}
    ]
    assert report["verdict"]["value"] == "good"


def test_a_part_that_is_not_there_is_refused_with_those_that_are(tmp_path: object) -> None:
    glb = plain_glb(chair(), name="Chair")
    with pytest.raises(PartNotFoundError) as caught:
        run(glb, "bigger antenna", "chair")
    assert "legs" in caught.value.extra["parts"]
    path = tmp_path / "chair.glb"  # type: ignore[operator]
    path.write_bytes(glb)
    request = JobRequest.model_validate({"prompt": "a longer tail", "params": grouped({"source_noun": "chair"})})
    params = TEXT_DEFORM.check(request, Settings(), {"asset": JobFile()})
    with pytest.raises(PartNotFoundError, match="No tail was found"):
        check_parts(path, "chair.glb", request.prompt, params, Limits())
    check_parts(path, "chair.glb", "longer legs", params, Limits())


def test_a_named_node_is_a_part() -> None:
    body = DOGS["shapes"]
    flags = body.points[:, 2] < -1.1
    named = replace(body, names={"Antenna_01": flags})
    after, (done,) = changed(named, "bigger antenna")
    assert done.found_by == "names"
    wide = [np.ptp(each.points[flags], axis=0)[0] for each in (body, after)]
    assert wide[1] == pytest.approx(1.45 * wide[0], rel=0.02)


def test_a_noun_that_is_the_name_of_a_part_means_that_part() -> None:
    body = DOGS["shapes"]
    hat = replace(body, names={"Helmet": body.points[:, 1] > 2.5, "Dog": body.points[:, 1] > -1})
    for text, part in (("a bigger helmet", "helmet"), ("a bigger dog", "whole"), ("a big helmet", "whole")):
        sentence = read_changes(text, noun_of)
        assert sentence is not None
        assert [each.part for each in meant(hat, sentence)] == [part]


def test_morph_targets_follow_and_quantised_positions_are_read() -> None:
    builder, mesh = Builder(), chair()
    places = mesh.verts
    steps = np.round(places * 20_000).astype(np.int16)
    raised = np.zeros_like(steps)
    raised[:, 1] = 1000
    primitive = builder.primitive(steps, mesh.faces.astype(np.uint16))
    primitive["targets"] = [{"POSITION": builder.accessor(raised, bounds=True)}]
    builder.node(builder.mesh(primitive), scale=[1 / 20_000] * 3)
    builder.root["extensionsUsed"] = builder.root["extensionsRequired"] = ["KHR_mesh_quantization"]
    result, _ = run(builder.glb(), "taller", "chair")
    np.testing.assert_allclose(np.ptp(load_asset(result).surface.positions, axis=0), [1, 1.4 * 1.5, 1], atol=1e-3)
    player = Player(result)
    target = player.root["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    # Where the chair is stretched, what a target raises is raised by more; posts take the change of their plates.
    assert 1000 <= np.abs(player.read(target)[:, 1]).max() < 2500
    assert np.abs(player.read(target)[:, [0, 2]]).max() < 100


def test_a_description_is_a_change_if_the_source_is_what_it_says() -> None:
    request = JobRequest.model_validate({"prompt": "a fat dog", "params": grouped({"source_noun": "dog"})})
    made = text_deform.start(job_input(rigged_dog(), "asset.glb", request))
    report = json.loads(made.finish()["report.json"].data)
    assert report["way"] == "change"
    assert report["source_noun"] == {"noun": "dog", "probability": 1.0, "recognised": True}
    assert [each["operation"] for each in report["changes"]] == ["fat"]
    # Of a vase it is a prompt, for which a model is loaded.
    request = JobRequest.model_validate({"prompt": "a fat dog", "params": grouped({"source_noun": "vase"})})
    with pytest.raises(RuntimeError, match="no function to load the prior builtin"):
        text_deform.start(job_input(rigged_dog(), "asset.glb", request))


def test_changes_need_no_model_no_steps_and_no_controls() -> None:
    request = JobRequest(prompt="longer legs")
    assert TEXT_DEFORM.steps(request, "builtin", None) == 0
    refused = JobRequest.model_validate(
        {"prompt": "longer legs", "params": grouped({"handles": [{"position": [0, 1, 0], "to": [0, 2, 0]}]})}
    )
    with pytest.raises(ParameterError, match="handles"):
        TEXT_DEFORM.check(refused, Settings(), {"asset": JobFile()})


def test_a_branch_is_no_change() -> None:
    job = JobRequest(prompt="a vase")
    assert TEXT_DEFORM.as_branch(job, JobRequest(prompt="a tall vase")).prompt == "a tall vase"
    with pytest.raises(ParameterError, match="A branch goes on with a prompt"):
        TEXT_DEFORM.as_branch(job, JobRequest(prompt="longer legs"))


def test_a_flip_takes_back_what_would_flip() -> None:
    """A spike that stands out of the neck folds when everything shrinks towards it, and is held back."""
    mesh = TriangleMesh(join(*dog().values()).verts, join(*dog().values()).faces)
    after, done = changed(body_of(plain_glb(mesh), "dog"), "flatter and much thinner")
    a, b, c = after.points[after.faces].transpose(1, 0, 2)
    assert sum(each.flips for each in done) == 0
    assert np.isfinite(np.cross(b - a, c - a)).all()
