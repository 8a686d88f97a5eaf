"""Nouns from public collections: which file shows what, who may learn from it, and members drawn from it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.priors.builtin.teaching.deformed import Part, normalised
from meshdeform.priors.builtin.teaching.pictures import four_views
from tests.cases import each_case
from training.collections.members import RealShapes
from training.collections.nouns import noun_of
from training.collections.scan import Drawn, Found, counts, same, scan, set_fronts
from training.collections.sources import HELD_OUT, JUDGE, PRIOR, collection_of, pack_of, split_of
from training.prior.families import member

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


def test_a_pack_is_an_authors_set_of_things() -> None:
    assert pack_of(f"{KAYKIT}/chair_A.gltf") == "KayKit-Game-Assets+Furniture/furniture"
    assert pack_of("trebeljahr+quaternius-showcase/public/glb/ships_pack/Boat.glb").endswith("showcase/ships_pack")
    assert pack_of("pmndrs+market-assets/files/models/pan/model.gltf") == "pmndrs+market-assets"
    collection = collection_of(f"{KENNEY}/chair.glb")
    assert collection is not None
    assert collection.author == "Kenney"
    assert collection_of("somebody+else/chair.glb") is None


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


def _turned(part: Part, quarters: int) -> Part:
    for _ in range(quarters % 4):
        part = Part(part.verts[:, [2, 1, 0]] * [1.0, 1.0, -1.0], part.faces)
    return part


def _seen(noun: str, part: Part, path: str = "", pack: str = "pack") -> tuple[Found, Drawn]:
    return Found(path or noun, noun, "Kenney", pack, "name"), Drawn.of(normalised(part))


def test_copies_are_known_by_their_shape_whatever_their_size_turn_and_triangles() -> None:
    chair = normalised(member("chair", (), np.random.default_rng(1)))
    middles = chair.verts[chair.faces].mean(1)
    split = np.concatenate(
        [np.c_[chair.faces[:, [k, (k + 1) % 3]], np.arange(len(middles)) + len(chair.verts)] for k in range(3)]
    )
    copy = normalised(_turned(Part(3.0 * np.concatenate([chair.verts, middles]), split), 1))
    other = normalised(member("chair", (), np.random.default_rng(2)))
    assert same(Drawn.of(chair), Drawn.of(copy))
    assert not same(Drawn.of(chair), Drawn.of(other))


def test_a_packs_habit_turns_its_files_and_a_clear_front_turns_one() -> None:
    rng = np.random.default_rng(0)
    files = [_seen(noun, _turned(member(noun, (), rng), 1), noun) for noun in ("chair", "sofa", "armchair", "penguin")]
    files.append(_seen("wardrobe", _turned(member("cabinet", (), rng), 1), "without a family"))
    files.append(_seen("chair", member("chair", (), rng), "alone", pack="other"))
    set_fronts(files)
    fronts = {found.path: found.front_deg for found, _ in files}
    assert {fronts[noun] for noun in ("chair", "sofa", "armchair", "penguin", "without a family")} == {90}
    assert fronts["alone"] == 0


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


def test_members_are_drawn_from_the_shapes_of_one_split(scanned: Path) -> None:
    real = RealShapes(scanned, JUDGE)
    assert ("vase" in real, "chair" in real) == (True, False)
    one, again, other = (real.draw("vase", (), np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one.verts, again.verts)
    assert not np.array_equal(one.verts, other.verts)
    assert np.linalg.norm(one.verts, axis=1).max() == pytest.approx(1.0)
    tall = real.draw("vase", [Attribute("whole", "tall")], np.random.default_rng(1))
    heights = [np.ptp(part.verts[:, 1]) / np.ptp(part.verts[:, 0]) for part in (one, tall)]
    assert heights[1] > 1.3 * heights[0]
    assert "vase" not in RealShapes(scanned, PRIOR)
    assert four_views(one).shape == (4, 64, 64, 3)
