"""Words that a user taught: names, folders, files of weights and what is wrong with them, training, forgetting."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from meshdeform.assets import check_asset_subprocess
from meshdeform.errors import (
    AssetEmptyError,
    AssetFormatError,
    MeshdeformError,
    ModelError,
    ParameterError,
    VocabularyError,
)
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.priors import check_model, load_prior
from meshdeform.priors.builtin import taught
from meshdeform.priors.builtin.grammar import BUILTIN_WORDS, ParsedPrompt, Words, parse, parse_negative, tokenise
from meshdeform.priors.builtin.taught import Lesson, known_words, lessons_of, metadata_of, words_of
from meshdeform.priors.builtin.teaching import teacher
from meshdeform.priors.builtin.teaching.lesson import attributes_of_folder, new_noun
from meshdeform.priors.builtin.teaching.pictures import seen_turned, shape_of, shipped_pictures
from meshdeform.priors.builtin.teaching.views import PictureSet
from tests.cases import each_case
from tests.taught import THREE_NOUNS, write_small_weights
from training.prior.held_out import FOURTH_EDITION, THIRD_EDITION
from training.prior.rehearsal import rehearsal


@each_case(("name", "noun"), [("a gnome", "gnome"), ("The Teddy Bear", "teddy-bear"), ("teddy-bear", "teddy-bear")])
def test_a_name_becomes_one_noun(name: str, noun: str) -> None:
    new = new_noun(name, BUILTIN_WORDS, synonyms=["dwarf", name])
    assert (new.noun, new.synonyms, new.replaces) == (noun, ("dwarf",), False)
    assert new.words.tokens == (*BUILTIN_WORDS.tokens, noun)
    assert new.words.synonyms["dwarf"] == noun
    again = new_noun("a chair", BUILTIN_WORDS, replace_known=True)
    assert (again.replaces, again.words.tokens) == (True, BUILTIN_WORDS.tokens)
    synonym, meaning = next(iter(BUILTIN_WORDS.synonyms.items()))
    own = new_noun(synonym, BUILTIN_WORDS)
    assert (own.replaces, synonym in own.words.synonyms, meaning in own.words.nouns) == (False, False, True)


@each_case(
    ("name", "synonyms", "words"),
    [
        ("", [], "no noun"),
        ("a théière", [], "no noun"),
        ("x" * 41, [], "no noun"),
        ("one two three four five", [], "no noun"),
        ("a neck", [], "another role"),
        ("chairs", [], "knows 'chair' already"),
        ("a gnome", ["vase"], "a noun of its own"),
        ("a gnome", ["neck"], "another role"),
    ],
)
def test_a_name_that_cannot_be_taught_is_refused(name: str, synonyms: list[str], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        new_noun(name, BUILTIN_WORDS, synonyms=synonyms)


def test_folders_are_named_by_attributes() -> None:
    new = new_noun("a gnome", BUILTIN_WORDS)
    found = {name: [str(a) for a in attributes_of_folder(name, new)] for name in ("tall", "Tall_Thin", "long-neck")}
    assert found == {"tall": ["tall"], "Tall_Thin": ["tall", "thin"], "long-neck": ["long neck"]}
    for wrong in ("downloads", "tall short", "a"):
        with pytest.raises(ParameterError, match="does not name attributes"):
            attributes_of_folder(wrong, new)


@each_case(
    "change",
    [
        {"words_format": "2"},
        {"words": "teapot"},
        {"nouns": "{"},
        {"nouns": "[]"},
        {"nouns": '{"nouns": {"vase": 1}, "synonyms": {}, "lessons": []}'},
        {"nouns": '{"nouns": {"../x": []}, "synonyms": {}, "lessons": []}'},
        {"nouns": '{"nouns": {"vase": ["wheel of fortune"]}, "synonyms": {}, "lessons": []}'},
    ],
)
def test_words_and_lessons_come_back_from_a_file_unless_they_contradict_each_other(change: dict[str, str]) -> None:
    new = new_noun("a gnome", BUILTIN_WORDS, synonyms=["dwarf"]).with_parts(["nose"])
    lesson = Lesson("gnome", ("dwarf",), ("tall",), ("a.glb",), "CC0-1.0", "2026-01-02", 300, 7)
    metadata = metadata_of(new.words, [lesson])
    assert words_of(metadata, Path("x")) == new.words
    assert new.words.nouns["gnome"] == ("nose",)
    assert lessons_of(metadata, Path("x")) == (lesson,)
    with pytest.raises(ModelError):
        words_of(metadata_of(THREE_NOUNS, []) | change, Path("x"))


def test_weights_of_an_older_edition_keep_their_fewer_words_and_parts(tmp_path: Path) -> None:
    second = [word for word in BUILTIN_WORDS.tokens if word not in (THIRD_EDITION | FOURTH_EDITION) - {"crown"}]
    nouns = {noun: parts for noun, parts in BUILTIN_WORDS.nouns.items() if noun in second}
    older = Words({**nouns, "dragon": ("wings",)}, {}, (*second, "dragon"))
    prior = load_prior(str(write_small_weights(tmp_path / "second.safetensors", older)), device="cpu")
    assert prior.words == older
    assert len(prior.encode_texts("a tall dragon with big wings", "fat")) == 2
    with pytest.raises(VocabularyError):
        prior.encode_texts("a bear")
    new = new_noun("a gnome", older)
    assert new.words.tokens[-1] == "gnome"
    assert [str(attribute) for attribute in attributes_of_folder("long-nose", new)] == ["long nose"]
    with pytest.raises(ParameterError, match="do not know: beak"):
        attributes_of_folder("long-beak", new)
    with pytest.raises(ModelError, match="contradict"):
        words_of(metadata_of(Words({**nouns, "dragon": ("beak",)}, {}, older.tokens), []), Path("x"))


def test_files_from_elsewhere_are_refused_before_they_are_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = write_small_weights(tmp_path / "good.safetensors").read_bytes()
    size = int.from_bytes(good[:8], "little")
    header = json.loads(good[8 : 8 + size])
    fewer = {**header, "__metadata__": metadata_of(BUILTIN_WORDS, [])}
    files = {
        "pickle": (pickle.dumps({"a": 1}), "not safetensors"),
        "empty": (b"", "not safetensors"),
        "cut": (good[:-100], "not whole"),
        "huge-header": ((2**62).to_bytes(8, "little") + b"{}", "not safetensors|not whole"),
        "rows": (_packed(fewer, good[8 + size :]), "for [0-9]+ words"),
        "mixed": (
            _packed({"a": {"data_offsets": [0, "x"]}, "b": {"data_offsets": [0, 4]}}, b"1234"),
            "not safetensors",
        ),
    }
    for name, (data, words) in files.items():
        path = tmp_path / f"{name}.safetensors"
        path.write_bytes(data)
        with pytest.raises(ModelError, match=words):
            check_model(str(path))
    save_file({"first_stage_model.weight": torch.zeros(2)}, tmp_path / "sd.safetensors")
    with pytest.raises(ModelError, match="no weights of the builtin prior") as refused:
        check_model(str(tmp_path / "sd.safetensors"))
    assert "from_single_file" in refused.value.advice_text
    with pytest.raises(ModelError, match="There is no file"):
        check_model(str(tmp_path / "nowhere.safetensors"))
    monkeypatch.setattr(taught, "MAX_FILE_BYTES", 1000)
    with pytest.raises(ModelError, match="at most 1,000"):
        check_model(str(tmp_path / "good.safetensors"))


def test_numbers_that_are_no_weights_are_refused_when_they_are_sent(tmp_path: Path) -> None:
    """As the service checks a file: before a worker has it."""
    good = write_small_weights(tmp_path / "good.safetensors")
    assert check_asset_subprocess(good, content="weights").format == "safetensors"
    data = good.read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    name = next(name for name, each in header.items() if name != "__metadata__" and each["dtype"] == "F16")
    integers = _packed({**header, name: {**header[name], "dtype": "I16"}}, data[8 + size :])
    broken = bytearray(data)
    at = 8 + size + header[name]["data_offsets"][0]
    broken[at : at + 2] = b"\x00\x7c"  # infinity in half precision
    for changed, words in ((integers, "not float"), (bytes(broken), "not finite")):
        path = tmp_path / "sent.safetensors"
        path.write_bytes(changed)
        with pytest.raises(AssetFormatError, match=words):
            check_asset_subprocess(path, content="weights")


def _packed(header: dict[str, Any], rest: bytes) -> bytes:
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + rest


@each_case(
    ("change", "words"),
    [
        (lambda state: state.pop("stem.bias"), "do not fit"),
        (lambda state: state.update({"stem.bias": state["stem.bias"][:1].clone()}), "do not fit"),
        (lambda state: state["stem.bias"].fill_(float("nan")), "not finite"),
    ],
)
def test_tensors_that_do_not_fit_are_refused(tmp_path: Path, change: Any, words: str) -> None:
    path = write_small_weights(tmp_path / "a.safetensors")
    with safe_open(path, framework="pt") as file:
        metadata = file.metadata()
    state = load_file(path)
    change(state)
    save_file(state, path, metadata)
    with pytest.raises(ModelError, match=words):
        load_prior(str(path), device="cpu")


def test_a_prior_with_taught_words_reads_its_own_words_only(tmp_path: Path) -> None:
    path = write_small_weights(tmp_path / "mine.safetensors")
    prior = load_prior(str(path), device="cpu")
    assert prior.identity["id"] == str(path)
    assert prior.encode_texts("a tall vase").shape[0] == 1
    with pytest.raises(MeshdeformError, match="giraffe"):
        prior.encode_texts("a giraffe")
    assert known_words(str(path)) == THREE_NOUNS
    assert known_words("builtin") is BUILTIN_WORDS


@each_case("negative", ["", "a giraffe"])
def test_a_refusal_names_the_words_that_were_taught_and_where_all_are_listed(negative: str) -> None:
    known = new_noun("tea pot", THREE_NOUNS).words
    assert parse("a tall tea pot", known) == parse("a tall tea-pot", known)
    with pytest.raises(VocabularyError) as caught:
        parse_negative(negative, "a tea pot", known) if negative else parse("a giraffe", known)
    assert "It was taught: tea-pot." in caught.value.advice_text
    assert "meshdeform models FILE" in caught.value.advice_text
    assert "models builtin" not in caught.value.advice_text
    with pytest.raises(VocabularyError) as caught:
        parse("a quixotic zeitgeist")
    assert "All words: meshdeform models builtin" in caught.value.advice_text


class _Oracle(torch.nn.Module):
    """Predicts the clean picture if the noun is the right one, and grey otherwise."""

    def __init__(self, clean: Tensor, right: int) -> None:
        super().__init__()
        self.place = torch.zeros(1)
        self._clean, self._right = clean, right

    def text(self, tokens: Tensor) -> Tensor:
        return tokens[:, :1]

    def forward(self, noisy: Tensor, _timestep: Tensor, text: Tensor, *_: Tensor) -> Tensor:
        right = (text[:, 0] == self._right)[:, None, None, None]
        return torch.where(right, self._clean.expand_as(noisy), torch.zeros_like(noisy))


def test_a_picture_is_taken_for_the_noun_that_explains_it_best() -> None:
    images = torch.randint(0, 256, (1, 3, 16, 16), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    tokens = torch.tensor([tokenise(ParsedPrompt("vase"), THREE_NOUNS)])
    pictures = PictureSet(images, tokens, torch.zeros(1), torch.zeros(1, dtype=torch.bool))
    oracle: Any = _Oracle(images.float() / 127.5 - 1, THREE_NOUNS.tokens.index("heart"))
    assert teacher.retrieved(oracle, THREE_NOUNS, pictures, list(THREE_NOUNS.nouns)) == ["heart"]
    low, high = teacher.interval(9, 10)
    assert (round(low, 3), round(high, 3)) == (0.596, 0.982)  # Wilson 1927
    assert teacher.interval(0, 0) == (0.0, 1.0)


def _wedge(turn_deg: float = 0.0) -> TriangleMesh:
    """A prism with a high back and a low front at +Z, turned about Y."""
    x, y = [-1.0, 1.0], [(0.0, 0.4), (1.6, -0.8), (0.0, -0.8)]
    verts = np.array([(a, h, z) for a in x for h, z in y])
    faces = [(0, 2, 1), (3, 4, 5), (0, 1, 3), (1, 4, 3), (1, 2, 4), (2, 5, 4), (2, 0, 5), (0, 3, 5)]
    angle = np.radians(turn_deg)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return TriangleMesh(torch.from_numpy(verts @ turn.T), torch.tensor(faces))


def test_a_mesh_that_faces_another_way_than_the_others_is_named() -> None:
    shapes = [shape_of(_wedge(turn), f"{n}.glb") for n, turn in enumerate((0, 0, 90, 0))]
    assert seen_turned(shapes) == {"2.glb": 90}
    told = [shape_of(_wedge(90), f"{n}.glb", front_deg=90.0) for n in range(3)]
    assert seen_turned([*told, shapes[0]]) == {}
    assert seen_turned(shapes[1:3]) == {}


def test_a_mesh_of_which_nothing_can_be_seen_is_refused() -> None:
    wedge = _wedge()
    with pytest.raises(AssetEmptyError, match="2 faces"):
        shape_of(TriangleMesh(wedge.verts, wedge.faces[:2]), "a.glb")
    speck = TriangleMesh(
        torch.cat([wedge.verts * 0.01, wedge.verts * 0.01 + 40]), torch.cat([wedge.faces, wedge.faces + 6])
    )
    with pytest.raises(AssetEmptyError, match="nearly nothing but background"):
        shape_of(speck, "speck.glb")
    flat = TriangleMesh(wedge.verts * torch.tensor([1.0, 1.0, 0.0]), wedge.faces)
    with pytest.raises(AssetEmptyError, match="nearly nothing but background"):
        shape_of(flat, "flat.glb")


def test_the_shipped_rehearsal_shows_every_noun_and_is_what_its_command_draws(tmp_path: Path) -> None:
    shipped = shipped_pictures(BUILTIN_WORDS)
    assert set(shipped) == set(BUILTIN_WORDS.nouns)
    drawn = tmp_path / "rehearsal.zip"
    drawn.write_bytes(rehearsal([next(iter(shipped))]))
    (noun, again), *others = shipped_pictures(BUILTIN_WORDS, drawn).items()
    assert not others
    for one, other in ((again.training, shipped[noun].training), (again.held_out, shipped[noun].held_out)):
        # Another processor may round a pixel otherwise.
        assert (one.images.int() - other.images.int()).abs().float().mean() < 1
        assert torch.equal(one.tokens, other.tokens)
        assert torch.equal(one.single, other.single)
    assert len(again.training) == 6
    assert len(again.held_out) == 2
    damaged = tmp_path / "damaged.zip"
    damaged.write_bytes(b"no zip")
    with pytest.raises(ModelError, match=r"damaged.zip.*cannot be read"):
        shipped_pictures(BUILTIN_WORDS, damaged)
