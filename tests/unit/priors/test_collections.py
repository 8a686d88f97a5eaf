"""Nouns from public collections: which file shows what, who may learn from it, and members drawn from it."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.nouns.deformed import Part, normalised
from meshdeform.nouns.families import member
from meshdeform.vocabulary.nouns import NOUNS
from tests.cases import each_case
from training.collections.nouns import NAMED, noun_of
from training.collections.scan import Drawn, counts, same, scan, shape_of
from training.collections.sources import HELD_OUT, JUDGE, split_of

EXAMPLES = Path(__file__).parents[3] / "examples"
KAYKIT, KENNEY = "KayKit-Game-Assets+Furniture/addons/furniture/Assets/gltf", "Kenney-CCO+Kenney-CCO.glb"


@each_case(
    ("name", "noun"),
    [
        ("Table_RoundLarge", "table"),
        ("loungeSofaLong", "sofa"),
        ("SMG_1", "rifle"),
        ("bottle_A_labeled_green.gltf", "bottle"),
        ("Spaceship_FinnTheFrog-transformed", "spaceship"),
        ("wallCornerGate", None),
        ("hex_road_B", None),
        ("Body_Pistol_1", None),
        ("", None),
    ],
)
def test_the_words_of_a_name_say_what_a_file_shows(name: str, noun: str | None) -> None:
    assert noun_of(name) == noun


def test_names_tell_every_noun_and_no_other_word() -> None:
    assert NOUNS.keys() == NAMED


def test_the_judge_sees_other_authors_than_the_prior_or_another_pack() -> None:
    several = [(f"q{k}", "Quaternius", "p") for k in range(40)]
    several += [("y", "Kay Lousberg", "f"), ("t", "Tim Steer", "b"), ("k", "Kenney", "c")]
    split = split_of(several)
    assert [path for path, who in split.items() if who == JUDGE] == ["y", "t"]
    assert 0 < sum(who == HELD_OUT for who in split.values()) < 12
    assert split == split_of(several)
    assert split_of([*several[:40], several[-1]])["k"] == JUDGE
    one = [("a", "Quaternius", "large"), ("b", "Quaternius", "large"), ("c", "Quaternius", "small")]
    assert split_of(one)["c"] == JUDGE
    assert JUDGE not in split_of(one[:2]).values()


def test_copies_are_known_by_their_shape_whatever_their_size_turn_and_triangles() -> None:
    chair = normalised(member("chair", (), np.random.default_rng(1)))
    middles = chair.verts[chair.faces].mean(1)
    split = np.concatenate(
        [np.c_[chair.faces[:, [k, (k + 1) % 3]], np.arange(len(middles)) + len(chair.verts)] for k in range(3)]
    )
    quarter = np.concatenate([chair.verts, middles])[:, [2, 1, 0]] * [3.0, 3.0, -3.0]
    other = normalised(member("chair", (), np.random.default_rng(2)))
    assert same(Drawn.of(chair), Drawn.of(normalised(Part(quarter, split))))
    assert not same(Drawn.of(chair), Drawn.of(other))


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of collections with a copy, an unreadable file, a tile and an asset of the tests; its index."""
    folder = tmp_path_factory.mktemp("collections")
    for name in (f"{KAYKIT}/vase_A.glb", f"{KENNEY}/vase.glb", f"{KENNEY}/wallCorner.glb", f"{KENNEY}/bench.glb"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(EXAMPLES / "vase.glb", folder / name)
    shutil.copy(EXAMPLES / "sphere.glb", folder / KENNEY / "rock.glb")
    (folder / KENNEY / "chair.glb").write_bytes(b"glTF")
    scan(folder, folder / "out", [EXAMPLES / "sphere.glb"])
    return folder / "out"


def test_a_scan_keeps_each_shape_once_and_says_what_it_left_out(scanned: Path) -> None:
    import json

    index = json.loads((scanned / "members.json").read_text())
    assert [(each["noun"], each["author"]) for each in index["members"]] == [
        ("vase", "Kay Lousberg"),
        ("bench", "Kenney"),
    ]
    assert index["left_out"] == [f"{KENNEY}/rock.glb", f"{KENNEY}/vase.glb"]
    assert list(index["refused"]) == [f"{KENNEY}/chair.glb"]
    assert counts(index["members"]).splitlines()[1].startswith("bench | ")


def test_a_mesh_of_which_nothing_can_be_seen_is_refused() -> None:
    ball = icosphere(2)
    assert np.linalg.norm(shape_of(ball, "ball.glb").verts, axis=1).max() == pytest.approx(1.0)
    with pytest.raises(AssetEmptyError, match="2 faces"):
        shape_of(TriangleMesh(ball.verts, ball.faces[:2]), "a.glb")
    far = join(*(replace(ball, verts=ball.verts * 0.01 + 40 * number) for number in range(2)))
    for mesh in (far, replace(ball, verts=ball.verts * np.array([1.0, 1.0, 0.0]))):
        with pytest.raises(AssetEmptyError, match="nearly nothing but background"):
            shape_of(mesh, "speck.glb")
