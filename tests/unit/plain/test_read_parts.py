"""Parts that people painted or that were read: their faces, what they carry, and what stays where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import join
from meshdeform.nouns.labels import labelled_member
from meshdeform.plain.body import Body, Flags
from meshdeform.plain.carried import carried_by
from meshdeform.plain.change import Done, apply_changes
from meshdeform.plain.naming import faces_among, find_parts
from meshdeform.plain.parts import BodyParts
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.reader import Reader
from meshdeform.plain.words import read_changes
from meshdeform.vocabulary.solids import PART_NAMES
from tests.cases import each_case
from tests.unit.plain.reading import body_of
from tests.unit.plain.shapes import _box, dog, plain_glb, rigged_dog
from training.shapes import torus

BOXES = join(*dog().values())


def changed(body: Body, text: str) -> tuple[Body, Done]:
    sentence = read_changes(text)
    assert sentence is not None
    after, (done,) = apply_changes(body, sentence.changes)
    return after, done


def faces_of(name: str) -> Flags:
    """The faces of a box of the dog."""
    flags, start = [], 0
    for part, mesh in dog().items():
        flags.append(np.full(len(mesh.faces), part == name))
        start += len(mesh.faces)
    return np.concatenate(flags)


def painted(**parts: str) -> Body:
    """The dog of boxes, of which nobody knows what it is, with boxes that are said to be parts."""
    body = body_of(plain_glb(BOXES))
    return replace(body, painted={part: faces_of(box) for part, box in parts.items()})


def test_a_painted_part_is_just_what_was_painted() -> None:
    body = painted(antler="Head", leg="Leg_FL")
    listed = {part.name: part for part in find_parts(body, read_changes)}
    assert set(listed) == {"antler", "leg"}
    assert {part.found_by for part in listed.values()} == {"given"}
    np.testing.assert_array_equal(listed["antler"].inside, faces_of("Head"))
    np.testing.assert_array_equal(listed["leg"].inside, faces_of("Leg_FL"))


@each_case(
    "said, listed",
    [
        ("stilts", "stilts"),
        ("Antlers", "antlers"),  # a horn, where sentences are read
        ("horn", "horn"),
        ("left stilts", "stilt"),  # of which none is to the left
    ],
)
def test_a_part_is_called_what_people_call_it(said: str, listed: str) -> None:
    """Or whoever said so cannot find it in the list."""
    body = replace(body_of(plain_glb(BOXES)), painted={said: faces_of("Head")})
    (part,) = find_parts(body, read_changes)
    assert part.name == listed
    assert part.operations
    _, done = changed(body, f"bigger {listed}")
    assert done.found_by == "given"


def test_a_painted_part_grows_alone() -> None:
    body = painted(antler="Head")
    after, done = changed(body, "a bigger antler")
    assert (done.found_by, done.flips) == ("given", 0)
    assert done.got == pytest.approx(1.45, abs=0.01)
    rest = np.unique(body.faces[~faces_of("Head")])
    np.testing.assert_array_equal(after.points[rest], body.points[rest])


def test_what_is_painted_goes_before_what_is_read_and_two_names_become_one() -> None:
    read = body_of(plain_glb(BOXES), "dog")
    as_horn = replace(read, painted={"horn": faces_of("Tail")})
    listed = {part.name: part for part in find_parts(as_horn, read_changes)}
    assert "tail" not in listed
    np.testing.assert_array_equal(listed["horn"].inside, faces_of("Tail"))
    joined = {part.name: part for part in find_parts(replace(read, renamed={"neck": "tail"}), read_changes)}
    separate = {part.name: part for part in find_parts(read, read_changes)}
    assert "neck" not in joined
    assert joined["tail"].found_by == "given"
    np.testing.assert_array_equal(joined["tail"].inside, separate["tail"].inside | separate["neck"].inside)


def rows_of(*names: str) -> Flags:
    """The vertices of boxes of the dog."""
    return np.concatenate([np.full(len(mesh.verts), part in names) for part, mesh in dog().items()])


@each_case(
    "part, carried",
    [
        (("Neck",), {"Head"}),
        (("Head",), set()),
        (("Tail",), set()),
        # What stands on the ground is not carried by what does not.
        (("trunk",), {"Neck", "Head", "Tail"}),
        (("Leg_FL", "Leg_FR", "Leg_BL", "Leg_BR"), {"trunk", "Neck", "Head", "Tail"}),
        # On three legs, it still stands.
        (("Leg_FL",), set()),
    ],
)
def test_a_part_carries_what_would_fall_without_it(part: tuple[str, ...], carried: set[str]) -> None:
    body = body_of(plain_glb(BOXES))
    pieces = carried_by(body, rows_of(*part))
    total = np.logical_or.reduce([np.zeros(len(body.points), bool), *pieces])
    np.testing.assert_array_equal(total, rows_of(*carried))


def test_a_handle_stays_on_the_pot_at_both_ends() -> None:
    """Half a ring that begins and ends inside a box."""
    ring = torus(0.5, 0.08, 32, 12)
    verts = ring.verts[:, [0, 2, 1]] + [0.9, 1.0, 0.0]
    pot, handle = _box((-0.9, 0.0, -0.9), (0.9, 2.0, 0.9), 12), TriangleMesh(verts, ring.faces)
    body = body_of(plain_glb(join(pot, handle)))
    own = np.arange(len(body.faces)) >= len(pot.faces)
    after, done = changed(replace(body, painted={"handle": own}), "a bigger handle")
    assert done.flips == 0
    rows = np.unique(body.faces[own])
    moved = np.linalg.norm(after.points - body.points, axis=1)
    at_pot, out = rows[np.abs(body.points[rows, 0] - 0.9) < 0.03], rows[body.points[rows, 0] > 1.4]
    assert moved[at_pot].max() < 0.05
    assert moved[out].min() > 0.1


def test_a_trunk_stays_above_the_ground_on_which_the_rest_stands() -> None:
    trunk = _box((-0.08, 0.7, 1.4), (0.08, 2.5, 1.7), 8)
    body = body_of(plain_glb(join(BOXES, trunk)))
    own = np.arange(len(body.faces)) >= len(BOXES.faces)
    hanging = replace(body, painted={"trunk": own})
    after, done = changed(hanging, "twice as long trunk")
    assert after.points[:, 1].min() == pytest.approx(0, abs=1e-6)
    assert any("below the ground" in text for text in done.warnings)
    assert 1.1 < done.got < 1.7
    shorter, done = changed(hanging, "a shorter trunk")
    assert not done.warnings
    assert shorter.points[:, 1].min() == pytest.approx(0, abs=1e-6)


@each_case("text, moved", [("bigger middle fins", (1,)), ("bigger upper fins", (2,)), ("bigger lower fins", (0,)),
                           ("each fin bigger", (0, 1, 2))])  # fmt: skip
def test_rows_of_pieces_are_told_apart(text: str, moved: tuple[int, ...]) -> None:
    fins = [_box((0.41, y, -0.1), (0.8, y + 0.1, 0.1)) for y in (0.2, 0.9, 1.6)]
    post = _box((-0.4, 0, -0.4), (0.4, 2, 0.4))
    body = body_of(plain_glb(join(post, *fins)))
    own = np.arange(len(body.faces)) >= len(post.faces)
    after, _ = changed(replace(body, painted={"fin": own}), text)
    each = len(fins[0].verts)
    change = np.linalg.norm(after.points - body.points, axis=1)[len(post.verts) :].reshape(3, each).max(1)
    assert tuple(np.flatnonzero(change > 1e-6)) == moved


def test_rows_that_are_not_there_are_missing() -> None:
    body = painted(fin="Tail")
    with pytest.raises(PartMissingError, match="No middle fin was found"):
        changed(body, "a bigger middle fin")


@each_case("noun, part", [("lamp", "shade"), ("teapot", "spout"), ("castle", "tower"), ("rabbit", "ear")])
def test_a_part_of_a_member_grows_and_the_rest_stays(noun: str, part: str) -> None:
    member = labelled_member(noun, (), np.random.default_rng(11))
    glb = plain_glb(TriangleMesh(member.verts, member.faces))
    body = body_of(glb, noun, front_azimuth_deg=0.0)
    after, done = changed(body, f"a bigger {part}")
    assert (done.found_by, done.flips) == ("shapes", 0)
    assert done.got == pytest.approx(1.45, abs=0.05)
    parts = BodyParts(body)
    found = parts.faces(part)
    assert found is not None
    triangles = body.vertex_map[load_asset(glb).surface.triangles]
    known = (member.labels == PART_NAMES.index(part))[faces_among(triangles)]
    areas = np.linalg.norm(body.crosses, axis=1)
    assert areas[found & known].sum() > 0.95 * areas[known].sum()
    carried = [rows for piece in parts.named(part).pieces for rows in piece.carried]
    stays = np.logical_and.reduce([rows == 0 for rows in carried] or [np.ones(len(body.points), bool)])
    rest = np.unique(body.faces[~found])
    moved = np.linalg.norm(after.points - body.points, axis=1)
    assert moved[rest[stays[rest]]].max() < 0.01 * body.diagonal


def test_names_within_a_part_are_parts_and_those_of_stuffs_are_none() -> None:
    body = painted(head="Head")
    above, low = body.points[:, 1] > 2.5, body.points[:, 1] < 1.9
    names = {"Helmet_01": above, "Dark Wood": low, "Coat": body.points[:, 1] < 2.3, "HatTop": above}
    named = replace(body, names=names)
    listed = {part.name: part for part in find_parts(named, read_changes)}
    # What people painted goes before what the file names.
    assert set(listed) == {"head", "coat"}
    told = {part.name for part in find_parts(replace(named, painted={}), read_changes)}
    assert "helmet" in told or "hat top" in told
    assert not {"top", "dark wood", "wood"} & told


def test_many_loose_pieces_are_groups_where_they_are_near() -> None:
    at = np.random.default_rng(3).uniform(-0.1, 0.1, (100, 3))
    pieces = [_box(tuple(p), tuple(p + 0.03), 1) for p in at + np.repeat([[0, 0, 0], [3, 0, 0]], 50, axis=0)]
    body = body_of(plain_glb(join(*pieces)))
    groups = body.groups(np.ones(len(body.points), bool))
    assert sorted(len(rows) for rows in groups) == [400, 400]
    assert {float(np.sign(body.points[rows, 0].mean() - 1.5)) for rows in groups} == {-1.0, 1.0}


@each_case("probability, found_by", [(0.6, "joints"), (1.0, "shapes")])
def test_joints_are_overruled_by_a_reading_that_is_sure_alone(probability: float, found_by: str) -> None:
    body = body_of(rigged_dog())
    reading = body_of(plain_glb(BOXES), "dog").reader.reading
    assert reading is not None
    head, tail = PART_NAMES.index("head"), PART_NAMES.index("tail")
    labels = np.where(faces_of("Tail"), head, np.where(reading.labels == head, tail, reading.labels))
    known = {**reading.confidence, "head": 0.9}
    turned = replace(reading, labels=labels, confidence=known, probabilities={"dog": probability})
    assert BodyParts(replace(body, reader=Reader(lambda: turned))).head.found_by == found_by
