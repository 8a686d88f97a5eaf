"""Names and joints of a file weigh in; what they do not name stays."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.nouns.labels import code
from meshdeform.reading.cells import cells_of
from meshdeform.reading.evidence import JOINT_PARTS, Evidence, nouns_named, part_meant, parts_told, weighed
from meshdeform.vocabulary.solids import PART_NAMES
from training.shapes import box


@pytest.mark.parametrize(
    ("name", "part"),
    [("Wheel_FL", "wheel"), ("frontLegs", "leg"), ("RoofTiles", "roof"), ("tyre.003", "wheel"), ("shoes", "foot"),
     ("car_door_handle", None), ("Cube.001", None), ("wheelAxle", None), ("body", None)],
)  # fmt: skip
def test_a_name_means_a_part_or_nothing(name: str, part: str | None) -> None:
    assert part_meant(name) == part


def test_joints_and_names_move_probabilities_where_they_stand() -> None:
    mesh = box()
    verts, faces = mesh.verts, mesh.faces
    cells = cells_of(verts, faces)
    parts = np.array(sorted(code(name) for name in ("body", "head", "wheel")))
    even = np.full((len(cells), 3), 1 / 3)
    areas = np.ones(len(faces))
    top = verts[:, 1] > 0
    by_joints = weighed(even, parts, Evidence(joints={"head": top.astype(float)}), faces, cells, areas)
    by_names = weighed(even, parts, Evidence(names={"Wheel": top}), faces, cells, areas)
    up = top[faces].all(1)[cells.face]
    assert (PART_NAMES[parts[by_joints[up].argmax(1)[0]]], PART_NAMES[parts[by_names[up].argmax(1)[0]]]) == (
        "head",
        "wheel",
    )
    wheel = parts.tolist().index(code("wheel"))
    assert (by_names[~up][:, wheel] < 0.1).all()
    np.testing.assert_allclose(by_joints.sum(1), 1)
    np.testing.assert_allclose(weighed(even, parts, Evidence(), faces, cells, areas), even)


@pytest.mark.filterwarnings("error")
def test_a_joint_that_moves_a_single_vertex_says_nothing_of_any_face() -> None:
    mesh = box()
    verts, faces = mesh.verts, mesh.faces
    cells, areas = cells_of(verts, faces), np.ones(len(faces))
    parts = np.array(sorted(code(name) for name in ("body", "head")))
    even = np.full((len(cells), 2), 0.5)
    one = (np.arange(len(verts)) == 0).astype(float)
    weighed_in = weighed(even, parts, Evidence(joints={"head": one}), faces, cells, areas)
    assert np.isfinite(weighed_in).all()
    assert (weighed_in[:, parts.tolist().index(code("head"))] < 0.5).all()


def test_the_parts_of_joints_are_parts() -> None:
    assert set().union(*JOINT_PARTS.values()) <= set(PART_NAMES)


@pytest.mark.parametrize(
    ("name", "nouns", "near"),
    [("Couch_Medium1", ("sofa",), ()), ("White_wolf.001", ("wolf",), ()), ("car-hippie-van", ("car", "van"), ()),
     ("Bone.003", (), ()), ("Plane_Material", (), ()), ("Object_4", (), ()),
     ("Acacia_Mat", (), ("bamboo", "plant", "tree")), ("Landrover.001", (), ("car", "jeep")),
     ("Sketchfab_model", (), ())],
)  # fmt: skip
def test_what_most_of_an_asset_is_named_after_is_its_noun(
    name: str, nouns: tuple[str, ...], near: tuple[str, ...]
) -> None:
    mesh = box()
    faces, everything = mesh.faces, np.ones(len(mesh.verts), bool)
    areas = np.ones(len(faces))
    assert nouns_named(Evidence(names={name: everything}), faces, areas) == (nouns, near)
    corner = Evidence(names={name: np.arange(len(mesh.verts)) < 3})
    assert nouns_named(corner, faces, areas) == ((), ())


def test_what_joints_and_names_tell_is_found_although_no_member_has_it() -> None:
    mesh = box()
    verts, faces = mesh.verts, mesh.faces
    cells = cells_of(verts, faces)
    top, low = verts[:, 1] > 0, verts[:, 1] < 0
    evidence = Evidence(joints={"neck": top.astype(float)}, names={"Foot": low, "Wheel.L": low})
    body = np.array([code("body")])
    told = parts_told(evidence, faces, "person", body)
    assert [PART_NAMES[number] for number in told] == ["foot", "neck"]
    assert code("neck") not in parts_told(evidence, faces, "person", np.array([code("body"), code("neck")]))
    arms = Evidence(joints={"arm": top.astype(float)})
    assert not len(parts_told(arms, faces, "dolphin", np.array([code("body"), code("fin")])))
    parts = np.union1d(body, told)
    even = (parts == body)[None].repeat(len(cells), 0).astype(float)
    found = weighed(even, parts, evidence, faces, cells, np.ones(len(faces))).argmax(1)
    up, down = top[faces].all(1)[cells.face], low[faces].all(1)[cells.face]
    assert {PART_NAMES[parts[column]] for column in found[up]} == {"neck"}
    assert {PART_NAMES[parts[column]] for column in found[down]} == {"foot"}
