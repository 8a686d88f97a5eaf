"""What a change of the whole does to every vertex, joint and animation, known beforehand to the last bit of a float."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.errors import PromptError
from meshdeform.geometry.shapes import icosphere, join
from tests.cases import each_case
from tests.unit.assets.playing import Player
from tests.unit.plain.runs import changed_positions, run
from tests.unit.plain.shapes import _box, chair, dog, plain_glb, rigged_dog
from training.shapes import lathe

Floats = NDArray[np.float64]


def ball_with_needles() -> bytes:
    """A ball, and a fan of triangles whose corner is a ten-thousandth from the opposite edge."""
    mesh = icosphere(2)
    verts, faces = mesh.verts, mesh.faces
    a, b = verts[faces[:40, 0]], verts[faces[:40, 1]]
    tips = (a + b) / 2 * (1 + 1e-4)
    needles = np.column_stack([faces[:40, 0], faces[:40, 1], len(verts) + np.arange(40)])
    return plain_glb(
        type(mesh)(
            np.concatenate([verts, tips]),
            np.concatenate([faces, needles]).astype(np.int64),
        )
    )


def bottle() -> bytes:
    return plain_glb(lathe([(0, 0), (0.3, 0.02), (0.33, 0.3), (0.3, 0.5), (0.1, 0.62), (0.1, 0.9), (0, 0.9)], 24))


def grown(points: Floats, factors: tuple[float, float, float]) -> Floats:
    """The points grown about the middle of the ground below them."""
    low, high = points.min(0), points.max(0)
    stays = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    return np.asarray(stays + (points - stays) * factors)


CHAIR, DOG = plain_glb(chair()), plain_glb(join(*dog().values()))


@each_case(
    "glb, noun, text, factors",
    [
        (ball_with_needles(), "ball", "half the size", (0.5, 0.5, 0.5)),
        (ball_with_needles(), "ball", "20 % wider", (1.2, 1.0, 1.0)),
        (CHAIR, "chair", "twice as tall", (1.0, 2.0, 1.0)),
        (CHAIR, "chair", "half as tall", (1.0, 0.5, 1.0)),
        (CHAIR, "chair", "1.2 times as deep", (1.0, 1.0, 1.2)),
        (CHAIR, "chair", "fatter", (1.6, 1.0, 1.6)),
        (DOG, "dog", "twice as big", (2.0, 2.0, 2.0)),
        (DOG, "dog", "half as wide", (0.5, 1.0, 1.0)),
        (DOG, "dog", "half as tall and twice as long", (1.0, 0.5, 2.0)),
        (bottle(), "bottle", "fatter", (1.6, 1.0, 1.6)),
        (bottle(), "bottle", "slimmer", (1 / 1.5, 1.0, 1 / 1.5)),
        (bottle(), "bottle", "1.8 m tall", (1.0, 2.0, 1.0)),
        (bottle(), "bottle", "33 cm wider", (1.5, 1.0, 1.0)),
    ],
)
def test_every_vertex_goes_where_one_affine_map_has_it(
    glb: bytes, noun: str, text: str, factors: tuple[float, float, float]
) -> None:
    before, after, report = changed_positions(glb, text, noun)
    np.testing.assert_allclose(after, grown(before, factors), atol=2e-6 * np.abs(before).max())
    assert (report["warnings"], report["verdict"]["value"]) == ([], "good")


@each_case("turned", [False, True])
def test_at_half_the_size_every_frame_of_an_animation_is_half_as_large(turned: bool) -> None:
    glb = rigged_dog(turned=turned)
    before, after = Player(glb), Player(run(glb, "half the size", noun="dog")[0])
    source = before.at(None, 0).verts
    stays = source - 2 * (source - grown(source, (0.5, 0.5, 0.5)))
    for time in (None, 0.0, 0.3, 1.0):
        np.testing.assert_allclose(after.at(time, 0).verts, (before.at(time, 0).verts + stays[0]) / 2, atol=1e-5)
    joints = before.root["skins"][0]["joints"]
    places = [np.array(player.worlds(None))[joints, :3, 3] for player in (before, after)]
    np.testing.assert_allclose(places[1], (places[0] + stays[0]) / 2, atol=1e-5)


@each_case("turned", [False, True])
def test_a_taller_skin_and_its_joints_are_taller_exactly_in_the_pose_that_is_shown(turned: bool) -> None:
    glb = rigged_dog(turned=turned)
    before, after = Player(glb), Player(run(glb, "twice as tall", noun="dog")[0])
    source = before.at(None, 0).verts
    wanted = grown(source, (1.0, 2.0, 1.0))
    np.testing.assert_allclose(after.at(None, 0).verts, wanted, atol=1e-5)
    joints = before.root["skins"][0]["joints"]
    places = [np.array(player.worlds(None))[joints, :3, 3] for player in (before, after)]
    lift = wanted[0, 1] - 2 * source[0, 1]
    np.testing.assert_allclose(places[1], places[0] * [1, 2, 1] + [0, lift, 0], atol=1e-5)


def test_with_keep_vertices_alone_are_moved_and_it_is_said() -> None:
    glb = rigged_dog()
    result, report = run(glb, "half the size", noun="dog", rig="keep")
    assert load_asset(result).rig_digest() == load_asset(glb).rig_digest()
    assert any("which stayed as they were" in text for text in report["warnings"])
    source = Player(glb).at(None, 0).verts
    np.testing.assert_allclose(Player(result).at(None, 0).verts, grown(source, (0.5, 0.5, 0.5)), atol=1e-5)


def test_normals_turn_with_what_is_made_wider() -> None:
    result, _ = run(DOG, "twice as wide", noun="dog")
    before, after = load_asset(DOG).surface, load_asset(result).surface
    wanted = before.normals * [0.5, 1, 1]
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    np.testing.assert_allclose(after.normals, wanted, atol=1e-6)


@each_case("name", ["asset.obj", "asset.stl"])
def test_a_length_is_refused_where_the_format_has_no_unit(name: str) -> None:
    mesh = _box((0, 0, 0), (1, 2, 1), 1)
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.verts.tolist()] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()
    ]
    if name == "asset.stl":
        corners = mesh.verts[mesh.faces].tolist()
        facets = "".join(
            "facet normal 0 0 0 outer loop "
            + " ".join(f"vertex {x} {y} {z}" for x, y, z in face)
            + " endloop endfacet\n"
            for face in corners
        )
        lines = ["solid box", facets, "endsolid"]
    with pytest.raises(PromptError, match="has no unit of length, so 5 m says nothing"):
        run("\n".join(lines).encode(), "5 m tall", name=name, noun="can")


@each_case("text", ["5 m big", "90 m tall"])
def test_a_length_that_says_no_direction_or_too_much_is_refused(text: str) -> None:
    with pytest.raises(PromptError):
        run(CHAIR, text)
