"""A member of a family that is read as itself has the parts that it was drawn with, however its file has it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.nouns.deformed import Part
from meshdeform.nouns.labels import LabelledMember, labelled_member
from meshdeform.nouns.poses import posed
from meshdeform.reading import GROUND, Evidence, Reading, read_asset
from meshdeform.reading.choice import facing
from meshdeform.reading.result import UP_TURNS
from meshdeform.vocabulary.solids import PART_NAMES
from tests.cases import each_case

pytestmark = pytest.mark.slow


def _member(noun: str, seed: int = 4321) -> LabelledMember:
    return labelled_member(noun, (), np.random.default_rng(seed))


def _areas(member: LabelledMember) -> NDArray[np.float64]:
    a, b, c = member.verts[member.faces].transpose(1, 0, 2)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1))


def _share(member: LabelledMember, alike: NDArray[np.bool_]) -> float:
    areas = _areas(member)
    return float(areas[alike].sum() / areas.sum())


@each_case("noun", ["airplane", "chair", "dog", "lamp"])
def test_a_member_read_as_itself_is_right_in_98_per_cent_of_its_area(noun: str) -> None:
    member = _member(noun)
    reading = read_asset(Part(member.verts, member.faces), {noun: 1.0}, front_azimuth_deg=0.0)
    assert _share(member, reading.labels == member.labels) >= 0.98
    assert set(reading.parts) == {PART_NAMES[number] for number in np.unique(reading.labels)}
    assert all(0 < share <= 1 for share in reading.confidence.values())
    assert reading.noun == noun
    assert reading.probability == 1.0


@pytest.fixture(scope="module")
def horse() -> LabelledMember:
    return _member("horse")


@pytest.fixture(scope="module")
def horse_reading(horse: LabelledMember) -> Reading:
    return read_asset(Part(horse.verts, horse.faces), {"horse": 1.0}, front_azimuth_deg=0.0)


def test_units_place_turn_mirror_image_and_nodes_change_nothing(horse: LabelledMember, horse_reading: Reading) -> None:
    far = Part(250.0 * horse.verts @ facing(-90.0).T + [3e3, -70.0, 1e3], horse.faces)
    mirrored = Part(horse.verts * [-1, 1, 1], horse.faces[:, ::-1].copy())
    halves = Evidence(names={"left": horse.verts[:, 0] > 0.02, "Cube.001": horse.verts[:, 1] > 0})
    for body, front, evidence in (
        (far, 90.0, None),
        (mirrored, 0.0, None),
        (Part(horse.verts, horse.faces), 0.0, halves),
    ):
        reading = read_asset(body, {"horse": 1.0}, evidence=evidence, front_azimuth_deg=front)
        assert _share(horse, reading.labels == horse_reading.labels) >= 0.98


def _in_another_order(member: LabelledMember) -> tuple[Part, NDArray[np.int64]]:
    """Return the member with its vertices and faces shuffled, and the old number (F,) of each face."""
    rng = np.random.default_rng(0)
    verts, faces = rng.permutation(len(member.verts)), rng.permutation(len(member.faces))
    shuffled = np.argsort(verts)[member.faces[faces]]
    return Part(member.verts[verts], np.stack([np.roll(face, k % 3) for k, face in enumerate(shuffled)])), faces


def _remeshed(member: LabelledMember) -> tuple[Part, NDArray[np.int64]]:
    """Return the member with its longer edges halved and a vertex in the middle of the other faces, and old numbers."""
    verts, faces, old = member.verts, member.faces, np.arange(len(member.faces))
    corners = verts[faces]
    count, ends = len(verts), np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, where = np.unique(np.sort(ends, 1), axis=0, return_inverse=True)
    ab, bc, ca = where.reshape(3, -1) + count
    a, b, c = faces.T
    large = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    quarters = np.concatenate([np.stack(k, 1) for k in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    verts = np.concatenate([verts, verts[edges].mean(1)])
    middle = len(verts) + np.arange(len(quarters))
    split = np.tile(large > np.median(large), 4)
    verts = np.concatenate([verts, verts[quarters].mean(1)])
    thirds = [np.stack([quarters[:, k], quarters[:, (k + 1) % 3], middle], 1)[split] for k in range(3)]
    faces = np.concatenate([quarters[~split], *thirds])
    return Part(verts, faces), np.concatenate([np.tile(old, 4)[~split], *[np.tile(old, 4)[split]] * 3])


def test_the_order_of_vertices_and_faces_changes_nothing(horse: LabelledMember, horse_reading: Reading) -> None:
    body, old = _in_another_order(horse)
    reading = read_asset(body, {"horse": 1.0}, front_azimuth_deg=0.0)
    labels = np.empty_like(reading.labels)
    labels[old] = reading.labels
    assert _share(horse, labels == horse_reading.labels) >= 0.98


def test_remeshing_changes_at_most_2_per_cent_of_the_area() -> None:
    member = _member("teapot")
    body, old = _remeshed(member)
    a, b, c = body.verts[body.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert areas.sum() == pytest.approx(_areas(member).sum())
    plain = read_asset(Part(member.verts, member.faces), {"teapot": 1.0}, front_azimuth_deg=0.0)
    reading = read_asset(body, {"teapot": 1.0}, front_azimuth_deg=0.0)
    assert areas[reading.labels == plain.labels[old]].sum() >= 0.98 * areas.sum()


def test_the_same_asset_is_read_alike(horse: LabelledMember, horse_reading: Reading) -> None:
    again = read_asset(Part(horse.verts, horse.faces), {"horse": 1.0}, front_azimuth_deg=0.0)
    assert np.array_equal(again.labels, horse_reading.labels)
    assert again.confidence == horse_reading.confidence


def test_noun_and_front_are_found(horse: LabelledMember) -> None:
    turned = Part(horse.verts @ facing(-90.0).T, horse.faces)
    reading = read_asset(turned, {"table": 0.5, "horse": 0.3, "car": 0.2})
    assert reading.noun == "horse"
    assert reading.probability > 10 * max(share for noun, share in reading.probabilities.items() if noun != "horse")
    assert not reading.sure
    assert reading.front_azimuth_deg == pytest.approx(90)
    assert reading.front_margin is not None
    assert reading.front_margin > 0.09


def test_a_hammer_that_lies_is_stood_up() -> None:
    hammer = _member("hammer")
    lying = Part(hammer.verts[:, [1, 2, 0]], hammer.faces)
    reading = read_asset(lying, {"hammer": 1.0})
    assert np.ptp(lying.verts @ reading.turn.T, axis=0).argmax() == 1
    assert _share(hammer, reading.labels == hammer.labels) >= 0.95


def test_the_axis_that_points_up_is_found(horse: LabelledMember, horse_reading: Reading) -> None:
    nouns = {"horse": 0.6, "table": 0.2}
    lying = Part(horse.verts @ UP_TURNS["+Z"], horse.faces)
    reading = read_asset(lying, nouns, z_up=nouns)
    assert reading.up == "+Z"
    np.testing.assert_allclose(reading.turn, UP_TURNS["+Z"], atol=1e-12)
    assert reading.front_azimuth_deg == pytest.approx(0)
    assert _share(horse, reading.labels == horse_reading.labels) >= 0.98
    assert read_asset(Part(horse.verts, horse.faces), nouns, z_up=nouns, z_share=0.8).up == "+Y"


def test_a_posed_animal_is_read(horse: LabelledMember) -> None:
    lying = posed(_member("dog"), "lying", np.random.default_rng(3))
    reading = read_asset(Part(lying.verts, lying.faces), {"dog": 1.0}, front_azimuth_deg=0.0)
    assert _share(lying, reading.labels == lying.labels) >= 0.9


def test_a_plate_under_it_is_ground(horse: LabelledMember, horse_reading: Reading) -> None:
    low = float(horse.verts[:, 1].min())
    corners = np.array([[x, low - y, z] for y in (0.0, 0.02) for x in (-2.0, 2.0) for z in (-2.0, 2.0)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    plate = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]) + len(horse.verts)
    body = Part(np.concatenate([horse.verts, corners]), np.concatenate([horse.faces, plate]))
    reading = read_asset(body, {"horse": 1.0}, front_azimuth_deg=0.0)
    assert (reading.labels[len(horse.faces) :] == GROUND).all()
    assert _share(horse, reading.labels[: len(horse.faces)] == horse_reading.labels) >= 0.99


def test_what_cannot_be_read_is_refused() -> None:
    point = Part(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    for body, nouns in ((point, {"dog": 1.0}), (_member("dog"), {})):
        with pytest.raises(ValueError, match="nothing to read"):
            read_asset(Part(body.verts, body.faces), nouns)
