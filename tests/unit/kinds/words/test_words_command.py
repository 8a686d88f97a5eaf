"""`meshdeform words`, and a run with a word: it is made, named, kept with the job, carried elsewhere and removed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from meshdeform.assets import build_glb
from meshdeform.geometry.shapes import icosphere
from meshdeform.words import Word, WordFolder
from tests.unit.cli.lines import done, refused
from tests.unit.words.words import BOX, WEDGE, box, word

BALL = icosphere(2)


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> WordFolder:
    monkeypatch.setenv("MESHDEFORM_WORDS", str(tmp_path / "words"))
    for module in ("runs.reading", "kinds.words.making"):
        monkeypatch.setattr(f"meshdeform.{module}.read_source", lambda *_, **__: None)  # which takes time
    return WordFolder(tmp_path / "words")


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    folder = tmp_path / "fruit"
    (folder / "more").mkdir(parents=True)
    for name, height in (("a.glb", 1.0), ("more/b.glb", 2.0)):
        (folder / name).write_bytes(build_glb(BALL.verts * [1.0, height, 1.0], BALL.faces))
    (folder / "notes.txt").write_text("no mesh")
    return folder


def test_a_folder_of_meshes_is_a_word_at_once(meshes: Path, store: WordFolder) -> None:
    told = json.loads(done(f"words add {meshes} --noun Dragon-Fruit --synonym pitaya --licence CC0 --json").stdout)
    (kept,) = store.words()
    assert (kept.noun, kept.synonyms, kept.faces) == ("dragon-fruit", ("pitaya",), (320, 320))
    assert told[0]["sha256"] == kept.sha256
    assert [each["source"] for each in told[0]["sources"]] == ["a.glb", "b.glb"]
    shown = done("words show dragon-fruit").stdout
    assert kept.sha256 in shown
    assert "CC0" in shown
    assert "dragon-fruit" in done("words list").stdout
    done("words remove dragon-fruit")
    assert store.words() == []


def test_nothing_is_kept_of_a_folder_with_a_damaged_mesh(meshes: Path, store: WordFolder) -> None:
    (meshes / "c.glb").write_bytes(b"glTF")
    (meshes / "d.obj").write_bytes(b"v 0 0 0\n")
    said = refused(f"words add {meshes} --noun dragonfruit")
    assert "2 of 4 files cannot be used" in said
    assert "c.glb: " in said
    assert "d.obj: " in said
    assert not store.folder.exists()


def test_a_noun_that_is_taken_is_refused_before_anything_is_read(store: WordFolder, tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(b"no mesh")
    store.add([WEDGE])
    assert "noun of ours" in refused(f"words add {tmp_path / 'a.glb'} --noun dog")
    assert "would be one" in refused(f"words add {tmp_path / 'a.glb'} --noun wedges")
    assert "no noun of ours" in refused(f"words add {tmp_path / 'a.glb'} --noun guanaco --like quux")


def test_words_go_from_one_machine_to_another(
    store: WordFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.add([WEDGE, BOX])
    file = tmp_path / "two.word"
    done(f"words export wedge dragon-box -o {file}")
    assert "exists" in refused(f"words export wedge -o {file}")
    monkeypatch.setenv("MESHDEFORM_WORDS", str(tmp_path / "others"))
    done(f"words import {file}")
    other = WordFolder(tmp_path / "others")
    assert other.words() == store.words()
    assert "You have" in refused(f"words import {file}")
    other.add([word("wedge", box())], replace=True)
    done(f"words import {file} --replace")
    assert other.words() == store.words()
    file.write_bytes(file.read_bytes()[:-1])
    assert "damaged" in refused(f"words import {file} --replace")


def test_a_run_names_the_word_and_keeps_it_as_it_was(store: WordFolder, meshes: Path, tmp_path: Path) -> None:
    store.add([WEDGE])
    result = tmp_path / "out.glb"

    def report() -> dict[str, object]:
        asset = meshes / "a.glb"
        done(f"run {asset} -o {result} --force --quiet", "a doorstop")
        told: dict[str, object] = json.loads((tmp_path / "out.report.json").read_bytes())
        return told

    first = report()
    assert first["exemplars"][0]["member"]["noun"] == "wedge"  # type: ignore[index]
    assert first["params"]["words"] == {"wedge": WEDGE.sha256}  # type: ignore[index]
    once = result.read_bytes()
    assert report()["result"] == first["result"]
    assert result.read_bytes() == once
    other: Word = word("wedge", box(5, 1, 1), synonyms=("doorstop",))
    store.add([other], replace=True)
    assert report()["params"]["words"] == {"wedge": other.sha256}  # type: ignore[index]
    assert result.read_bytes() != once
