"""Growth: two ears from a plain head, a longer nose, and nothing where nothing is to grow."""

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.exemplar.growth import grown
from meshdeform.exemplar.smooth_fit import CodedSurface
from meshdeform.exemplar.sprouts import Ground, limb_of, seat_of, sprouted
from meshdeform.nouns.families.parts import ellipsoid, join, limb
from meshdeform.reading.samples import hidden, spread

_Array = NDArray[Any]
_HEAD, _BODY, _EARS = 3, 1, (101, 102)


def _animal(detail: int = 4) -> CodedSurface:
    """Return a ball for a body and one that touches it for a head, with their codes."""
    ball = trimesh.creation.icosphere(subdivisions=detail)
    verts = np.concatenate([0.3 * ball.vertices, 0.15 * ball.vertices + [0, 0.35, 0.2]])
    faces = np.concatenate([ball.faces, ball.faces + len(ball.vertices)]).astype(np.int64)
    return CodedSurface(verts, faces, np.repeat([_BODY, _HEAD], len(ball.faces)))


def _goal(length: float = 0.14) -> CodedSurface:
    """Return the same with two ears on its head."""
    body, head = ellipsoid([0, 0, 0], 0.3), ellipsoid([0, 0.35, 0.2], 0.15)
    ears = [ellipsoid([side * 0.09, 0.45 + length, 0.2], [0.03, length, 0.03]) for side in (-1, 1)]
    whole = join([body, head, *ears])
    sizes = [len(each.faces) for each in (body, head, *ears)]
    return CodedSurface(whole.verts, whole.faces, np.repeat([_BODY, _HEAD, *_EARS], sizes))


def _flipped(verts: _Array, moved: _Array, faces: _Array) -> int:
    """Return how many pairs of neighbours are folded against each other, and were not."""
    before, after = (trimesh.Trimesh(each, faces, process=False) for each in (verts, moved))
    pairs = before.face_adjacency
    was, now = (np.einsum("nj,nj->n", *each.face_normals[pairs].transpose(1, 0, 2)) for each in (before, after))
    return int(((was > 0) & (now < -0.3)).sum())


def test_two_ears_grow_apart_from_a_plain_head() -> None:
    animal, goal = _animal(), _goal()
    moved = grown(animal, goal, parents=dict.fromkeys(_EARS, _HEAD))
    top = goal.verts[:, 1].max()
    for side in (-1, 1):
        ear = moved[(side * moved[:, 0] > 0) & (moved[:, 1] > 0.6)]
        assert len(ear) > 5
        assert ear[:, 1].max() > top - 0.03
        assert np.abs(ear[:, 0] - side * 0.09).max() < 0.05  # clean: no web to the other ear
    between = moved[(np.abs(moved[:, 0]) < 0.02) & (moved[:, 2] > 0.1)]
    assert between[:, 1].max() < 0.53
    seen = spread(goal.verts, goal.faces, 4000, 0).positions
    assert cKDTree(moved).query(seen)[0].max() < 0.06
    assert _flipped(animal.verts, moved, animal.faces) < 0.002 * len(animal.faces)  # at the creases of the roots


def test_the_other_parts_stay_where_they_are() -> None:
    animal = verts, faces, codes = _animal(detail=3)
    moved = grown(animal, _goal(), parents=dict.fromkeys(_EARS, _HEAD))
    body = np.unique(faces[codes == _BODY])
    assert np.array_equal(moved[body], verts[body])


@pytest.mark.parametrize("parents", [{}, {77: _HEAD}, {_EARS[0]: 55}])
def test_without_a_part_or_its_parent_nothing_grows(parents: dict[int, int]) -> None:
    animal = _animal(detail=2)
    assert np.array_equal(grown(animal, _goal(), parents=parents), animal.verts)


def test_few_faces_give_few_but_sound_ears() -> None:
    animal = _animal(detail=1)
    moved = grown(animal, _goal(), parents=dict.fromkeys(_EARS, _HEAD))
    assert np.isfinite(moved).all()
    assert _flipped(animal.verts, moved, animal.faces) == 0


def test_a_part_that_both_have_grows_to_its_goal() -> None:
    verts, faces, codes = _animal()
    codes = np.where((codes == _HEAD) & (verts[faces].mean(1)[:, 2] > 0.32), 5, codes)
    ball = ellipsoid([0, 0.35, 0.2], 0.15)
    nose = ellipsoid([0, 0.3, 0.45], [0.06, 0.06, 0.2])
    goal = join([ball, nose])
    coded = CodedSurface(goal.verts, goal.faces, np.repeat([_HEAD, 5], [len(ball.faces), len(nose.faces)]))
    moved = grown(CodedSurface(verts, faces, codes), coded, parents={}, much=(5,))
    assert verts[:, 2].max() < 0.36
    assert moved[:, 2].max() > 0.55


def test_the_same_bytes_twice() -> None:
    animal, parents = _animal(detail=2), dict.fromkeys(_EARS, _HEAD)
    results = [grown(animal, _goal(), parents=parents).tobytes() for _ in range(2)]
    assert results[0] == results[1]


def test_a_bent_limb_knows_its_heights() -> None:
    """A quarter of a ring that grows from a ball: heights are shares of its arc, and places are found again."""
    angles = np.linspace(0, np.pi / 2, 40)
    path = np.stack([np.zeros(40), np.sin(angles), 1 - np.cos(angles)], 1)
    arc, base = limb(path, np.full(40, 0.1)), ellipsoid([0, -0.3, 0], 0.33)
    whole = join([arc, base])
    samples = spread(whole.verts, whole.faces, 4000, 0)
    own = samples.faces < len(arc.faces)
    found = limb_of(samples, own, np.zeros(4000, bool), 1.0)
    assert found is not None
    bent = np.arctan2(found.positions[:, 1], 1 - found.positions[:, 2]) / (np.pi / 2)
    assert np.corrcoef(found.heights, bent)[0, 1] > 0.99
    assert np.linalg.norm(found.points_at(found.heights, found.turns) - found.positions, axis=1).mean() < 0.03


def test_patches_of_two_limbs_are_disjoint() -> None:
    verts, faces, codes = _animal()
    goal = _goal()
    samples = spread(goal[0], goal[1], 6000, 4)
    own = goal[2][samples.faces]
    ears = [limb_of(samples, own == code, hidden(samples, own), 1.0) for code in _EARS]
    ground, head = Ground.of(verts, faces), np.unique(faces[codes == _HEAD])
    patches = []
    for ear in ears:
        assert ear is not None
        seat = seat_of(ear, ground, ground, head)
        assert seat is not None
        rivals = np.array([[-ear.root[0], 0.48, 0.2]])
        patches.append(set(sprouted(ear, seat, ground, head, 0.3, rivals).verts.tolist()))
    assert min(len(patch) for patch in patches) > 12
    assert not patches[0] & patches[1]


def test_a_limb_grows_from_what_stuck_out_and_was_flattened() -> None:
    verts, faces, codes = _animal()
    goal = _goal()
    samples = spread(goal[0], goal[1], 6000, 4)
    own = goal[2][samples.faces]
    ear = limb_of(samples, own == _EARS[1], hidden(samples, own), 1.0)
    assert ear is not None
    spike = verts + [[0, 0.08, 0]] * np.exp(-np.square(verts - [0.1, 0.45, 0.24]).sum(1, keepdims=True) / 0.0015)
    head = np.unique(faces[codes == _HEAD])
    seat = seat_of(ear, Ground.of(verts, faces), Ground.of(spike, faces), head)
    assert seat is not None
    assert np.linalg.norm(verts[seat.middle] - [0.1, 0.45, 0.24]) < 0.04
    assert spike[seat.middle, 1] > verts[seat.middle, 1] + 0.05
