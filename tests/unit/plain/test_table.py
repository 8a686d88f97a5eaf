"""What words do to parts of manufactured assets: their direction, their side, and what stays where it is."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.errors import PartNotFoundError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import join
from meshdeform.plain.body import Joint, loose_body
from meshdeform.plain.names import means, part_of, sides_of
from meshdeform.plain.naming import find_parts
from meshdeform.plain.parts import BodyParts
from meshdeform.plain.table import OF_PARTS, TABLE, WHOLE
from meshdeform.plain.words import read_changes
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.plain.reading import body_of
from tests.unit.plain.runs import changed_positions, run
from tests.unit.plain.shapes import _box, chair, dog, plain_glb, rigged_dog
from training.shapes import lathe

ROOT = Path(__file__).parents[3]
Floats = NDArray[np.float64]


def nodes(parts: dict[str, TriangleMesh]) -> bytes:
    """A file with a node for each part."""
    builder = Builder()
    for name, mesh in parts.items():
        faces = mesh.faces.astype(np.uint16)
        builder.node(builder.mesh(builder.primitive(mesh.verts, faces)), name=name)
    return builder.glb()


def wheel(x: float, z: float) -> TriangleMesh:
    """A wheel of radius 0.25 whose axle is along X."""
    mesh = lathe([(0, -0.08), (0.25, -0.08), (0.25, 0.08), (0, 0.08)], 24)
    turned = mesh.verts[:, [1, 0, 2]] * [1, -1, 1]
    return TriangleMesh(turned + [x, 0.25, z], mesh.faces)


def car(front: int = 1) -> bytes:
    """A car of five nodes that looks along +Z, or along -Z."""
    places = {"FL": (0.5, 0.7), "FR": (-0.5, 0.7), "RL": (0.5, -0.7), "RR": (-0.5, -0.7)}
    wheels = {f"wheel_{name}": wheel(front * x, front * z) for name, (x, z) in places.items()}
    return nodes({**wheels, "car_body": _box((-0.45, 0.3, -1.1), (0.45, 1.1, 1.1))})


def extents(glb: bytes, points: Floats, name: str) -> Floats:
    """The extents of a node."""
    asset = load_asset(glb)
    pieces = asset.pieces()
    at = next(each["index"] for each in pieces.nodes if each["name"] == name)
    return np.ptp(points[np.unique(asset.surface.triangles[pieces.in_node(at)])], axis=0)


@each_case(
    "text, grows, names",
    [
        ("wider wheels", (1.35, 1, 1), {"FL", "FR", "RL", "RR"}),
        ("thinner wheels", (1 / 1.5, 1, 1), {"FL", "FR", "RL", "RR"}),
        ("bigger wheels", (1.45, 1.45, 1.45), {"FL", "FR", "RL", "RR"}),
        ("bigger front wheels", (1.45, 1.45, 1.45), {"FL", "FR"}),
        ("wider rear wheels", (1.35, 1, 1), {"RL", "RR"}),
        ("wider left wheels", (1.35, 1, 1), {"FL", "RL"}),
        ("breitere linke Räder", (1.35, 1, 1), {"FL", "RL"}),
        ("twice as wide front right wheel", (2, 1, 1), {"FR"}),
    ],
)
@each_case("front", [1, -1])
def test_wheels_grow_along_what_is_asked_for_and_only_on_that_side(
    front: int, text: str, grows: tuple[float, float, float], names: set[str]
) -> None:
    glb = car(front)
    before, after, report = changed_positions(glb, text)
    # Wheels that grow enter the body farther than they stood in it.
    assert report["verdict"]["reasons"] == ["Nothing broke."]
    for name in ("FL", "FR", "RL", "RR"):
        wanted = np.array([0.16, 0.5, 0.5]) * (grows if name in names else (1, 1, 1))
        np.testing.assert_allclose(extents(glb, after, f"wheel_{name}"), wanted, atol=1e-5)
    # The body has no arches, which could make room: its wheels stand in it.
    np.testing.assert_allclose(extents(glb, after, "car_body"), extents(glb, before, "car_body"), atol=1e-5)
    lift = 0.45 * 0.25 if text == "bigger wheels" else 0.0
    assert after[-1, 1] - before[-1, 1] == pytest.approx(lift, abs=1e-5)
    assert after[:, 1].min() == pytest.approx(0, abs=1e-6)


@each_case(
    "text, kept",
    [
        ("longer left legs", {"Leg_FR", "Leg_BR"}),
        ("longer back legs", {"Leg_FL", "Leg_FR"}),
        ("thicker front right leg", {"Leg_FL", "Leg_BL", "Leg_BR"}),
    ],
)
@each_case("rigged", [True, False])
def test_a_side_is_the_only_one_that_changes(rigged: bool, text: str, kept: set[str]) -> None:
    glb = rigged_dog() if rigged else plain_glb(join(*dog().values()))
    before, after, _ = changed_positions(glb, text, "dog")
    start, moved = 0, set()
    shift = np.median(after - before, axis=0)  # what longer legs on one side lift
    for name, mesh in dog().items():
        rows = slice(start, start := start + len(mesh.verts))
        if np.abs(after[rows] - before[rows] - shift).max() > 0.03:
            moved.add(name)
    legs = {"Leg_FL", "Leg_FR", "Leg_BL", "Leg_BR"}
    assert moved == legs - kept


def test_the_front_of_a_chair_is_away_from_its_back() -> None:
    assert BodyParts(body_of(plain_glb(chair()), "chair")).forward == 1
    turned = TriangleMesh(chair().verts * [-1, 1, -1], chair().faces)
    assert BodyParts(body_of(plain_glb(turned), "chair")).forward == -1


@each_case("text, factor", [("lower the seat", 1 / 1.4), ("raise the seat by 20 %", 1.2), ("seat 6 cm higher", 1.1)])
def test_a_seat_is_moved_with_what_it_carries_and_keeps_its_thickness(text: str, factor: float) -> None:
    before, after, report = changed_positions(plain_glb(chair()), text, "chair")
    seat, back = (before[:, 1] > 0.49) & (before[:, 1] < 0.61), before[:, 1] > 0.61
    assert after[seat, 1].max() == pytest.approx(factor * 0.6, abs=0.01)
    np.testing.assert_allclose(
        after[seat] - before[seat], np.tile((after - before)[seat][0], (seat.sum(), 1)), atol=0.02
    )
    np.testing.assert_allclose((after - before)[back], np.tile((after - before)[back][0], (back.sum(), 1)), atol=1e-5)
    np.testing.assert_allclose(after[before[:, 1] < 0.01], before[before[:, 1] < 0.01], atol=1e-5)
    assert report["verdict"]["value"] == "good", report["verdict"]


def test_a_wider_seat_takes_its_legs_along_and_keeps_their_girth() -> None:
    before, after, _ = changed_positions(plain_glb(chair()), "twice as wide seat", "chair")
    seat, foot = (before[:, 1] > 0.55) & (before[:, 1] < 0.65), (before[:, 1] < 0.01) & (before[:, 0] > 0)
    np.testing.assert_allclose(np.ptp(after[seat], axis=0)[[0, 2]], [2.0, 1.0], atol=1e-5)
    assert np.ptp(after[foot, 0]) == pytest.approx(np.ptp(before[foot, 0]), abs=1e-4)
    assert after[foot, 0].mean() == pytest.approx(0.9, abs=0.02)


def test_a_bonnet_is_longer_along_the_car_and_not_sideways() -> None:
    parts = {"Bonnet": _box((0.5, 0.6, -0.5), (1.2, 0.65, 0.5)), "Cabin": _box((-1.2, 0.2, -0.6), (0.5, 1.2, 0.6))}
    glb = nodes(parts)
    for text in ("longer bonnet", "longer hood", "longer bonet", "längere Motorhaube"):
        _, after, _ = changed_positions(glb, text)
        np.testing.assert_allclose(extents(glb, after, "Bonnet"), [0.7 * 1.4, 0.05, 1.0], rtol=0.03)
        np.testing.assert_allclose(extents(glb, after, "Cabin"), [1.7, 1.0, 1.2], rtol=0.01)


@each_case(
    "name, part, sides",
    [
        ("BackLeg.L", "leg", ("rear", "left")), ("FootBack", "foot", ("rear",)), ("Back", "back", ("rear",)),
        ("BackRest", "back", ()), ("NeckTie", None, ()), ("Head_lights", None, ("front",)), ("RoofTiles", "roof", ()),
        ("Suit_Body", "body", ()), ("l-frontleg", "leg", ("left", "front")), ("LeftForeArm.001", "forearm", ("left",)),
        ("wheel_RR", "wheel", ("right", "rear")), ("DEF-upper_arm.R.001", "arm", ("right",)), ("Plinth", None, ()),
    ],
)  # fmt: skip
def test_the_last_noun_of_a_name_says_what_it_is(name: str, part: str | None, sides: tuple[str, ...]) -> None:
    assert (part_of(name), sides_of(name)) == (part, sides)


@each_case(
    "name, part, so",
    [
        ("NeckTie", "tie", True), ("NeckTie", "neck", False), ("Head_lights", "head", False),
        ("Head_lights", "head light", True), ("upperarm.l", "upper arm", True), ("lowerarm.l", "upper arm", False),
        ("LeftUpLeg", "thigh", True), ("LeftForeArm", "forearm", True), ("1H_Sword", "sword", True),
        ("BackShoulder.L", "back", False), ("Glove_Hand_Box", "hand", False),
    ],
)  # fmt: skip
def test_a_name_means_a_part_of_a_sentence_or_another(name: str, part: str, so: bool) -> None:
    assert means(name, part) is so


@each_case("limb, is_there", [("FrontLeg.L", False), ("UpperArm.L", True)])
def test_the_chain_that_a_joint_stands_in_says_whether_it_is_a_shoulder(limb: str, is_there: bool) -> None:
    body = loose_body(load_asset(rigged_dog()))
    numbers = {joint.name: number for number, joint in enumerate(body.joints)}
    joints = list(body.joints)
    joints[numbers["Neck"]] = Joint("Shoulder.L", numbers["Hips"])
    joints[numbers["Leg_FL"]] = Joint(limb, numbers["Neck"])
    assert BodyParts(replace(body, joints=joints)).is_told("shoulder") is is_there


def test_the_back_of_a_body_and_a_node_of_clothes_are_no_parts_of_it() -> None:
    glb = rigged_dog()
    with pytest.raises(PartNotFoundError, match="The back of a body is no part"):
        run(glb, "a thicker back", noun="dog")
    body = loose_body(load_asset(glb))
    dressed = replace(body, names={"Suit_Body": body.points[:, 1] > 0.5, "NeckTie": body.points[:, 2] > 1.2})
    assert not BodyParts(dressed).is_told("body")
    assert BodyParts(dressed).is_told("tie")


@each_case("named", [True, False])
def test_no_two_parts_share_a_face(named: bool) -> None:
    glb = rigged_dog() if named else plain_glb(chair())
    asset, body = load_asset(glb), body_of(glb, "" if named else "chair")
    found = find_parts(body, read_changes)
    assert len(found) > 2
    faces = [part.faces(body.vertex_map[asset.surface.triangles]) for part in found]
    listed = [face for each in faces for face in _numbers(each)]
    assert len(listed) == len(set(listed))


def _numbers(ranges: list[int | list[int]]) -> list[int]:
    return [n for each in ranges for n in ([each] if isinstance(each, int) else range(each[0], each[1] + 1))]


def test_a_bigger_axe_is_not_a_bigger_animal() -> None:
    with pytest.raises(PartNotFoundError, match="No part called 'axe' was found, and the asset is a body"):
        run(rigged_dog(), "a bigger axe")
    assert run(rigged_dog(), "a bigger dog")[1]["changes"][0]["part"] == WHOLE


def test_the_documents_have_the_table() -> None:
    text = (ROOT / "docs/plain.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\|(.*)\|$", text, re.MULTILINE)
    found = {kind: dict(re.findall(r"(\w+): (\w+)", cells)) for kind, cells in rows}
    shapes = {op: way for op, way in TABLE[WHOLE].items() if way != "shape"}
    assert found == {**TABLE, WHOLE: shapes}
    assert set(OF_PARTS) >= {op for kind, ways in TABLE.items() if kind != WHOLE for op in ways}
