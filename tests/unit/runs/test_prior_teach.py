"""Jobs of kind `prior_teach`: a lesson from a ZIP, resumed, and what is refused."""

from __future__ import annotations

import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import pytest

from meshdeform.assets import Limits, build_glb, load_asset
from meshdeform.assets.lesson_archive import MAX_MESHES, inspect_lesson, open_lesson
from meshdeform.errors import AssetError, CheckpointError, MeshdeformError, ModelError, ParameterError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.taught import known_words, lessons_of, read_metadata
from meshdeform.priors.builtin.teaching.lesson import new_noun, nouns_of_kit
from meshdeform.priors.builtin.teaching.pictures import read_replay
from meshdeform.requests.document import JobRequest
from meshdeform.requests.teaching import TeachParams
from meshdeform.runs import check_request, start_run
from meshdeform.runs.base import InputFile, JobRun, RunInput
from meshdeform.runs.prior_teach import _params
from meshdeform.runs.prior_teach_kind import PRIOR_TEACH, labelled, lesson_of
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.taught import THREE_NOUNS, shorten_lessons, write_small_weights
from training.shapes import box

_SPHERE = icosphere(1)
BALL = build_glb(_SPHERE.verts.numpy(), _SPHERE.faces.numpy())
_BOX = box()
_LINES = [f"v {x} {y} {z}" for x, y, z in _BOX.verts.tolist()] + [
    f"f {a} {b} {c}" for a, b, c in (_BOX.faces + 1).tolist()
]
CUBE = "\n".join(_LINES).encode()


def packed(**files: bytes) -> bytes:
    """Return a ZIP; double underscores are slashes, and the last single one is a dot."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, data in files.items():
            archive.writestr(".".join(name.replace("__", "/").rsplit("_", 1)), data)
    return made.getvalue()


def begin(weights: bytes, *, checkpoint: bytes | None = None, **params: Any) -> JobRun:
    params = {"noun": "a teapot", "model": "weights", "steps": 3, **params}
    request = JobRequest.model_validate({"kind": "prior_teach", "params": params})
    files = {
        "meshes": InputFile(packed(pots__round_glb=BALL, pots__tall__box_obj=CUBE), "pots.zip"),
        "weights": InputFile(weights, "weights.safetensors"),
    }
    return start_run(RunInput(request, files, checkpoint=checkpoint))


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    shorten_lessons(monkeypatch)


def test_a_lesson_teaches_the_word_and_a_resumed_one_is_the_same_bit_for_bit(tmp_path: Path) -> None:
    weights = write_small_weights(tmp_path / "small.safetensors").read_bytes()
    run = begin(weights, synonyms=["kettle"], licence="CC0-1.0")
    assert (run.step, run.total_steps) == (0, 3)
    state = b""
    for done in run:
        state = run.checkpoint() if done.step == 1 else state
    made = run.finish()
    assert set(done.losses) == {"total", "held_out_new", "held_out_old"}
    assert list(made) == [artifact.name for artifact in PRIOR_TEACH.artifacts]
    assert made["preview.png"].data.startswith(b"\x89PNG")
    assert len(load_asset(run.snapshot().data).surface.triangles) == len(_SPHERE.faces)

    resumed = begin(weights, checkpoint=state, synonyms=["kettle"], licence="CC0-1.0")
    assert resumed.step == 1
    assert [done.step for done in resumed] == [2, 3]
    assert resumed.finish()["weights.safetensors"].data == made["weights.safetensors"].data
    with pytest.raises(CheckpointError, match="another lesson"):
        begin(weights, checkpoint=state, seed=1)

    mine = tmp_path / "mine.safetensors"
    mine.write_bytes(made["weights.safetensors"].data)
    assert known_words(str(mine)).synonyms["kettle"] == "teapot"
    report = json.loads(made["report.json"].data)
    assert [(mesh["name"], mesh["attributes"]) for mesh in report["nouns"][0]["meshes"]] == [
        ("pots/round.glb", []),
        ("pots/tall/box.obj", ["tall"]),
    ]
    assert set(report["old_nouns"]) == {"bowl", "heart", "vase"}


def test_folders_name_attributes_and_the_one_around_everything_need_not() -> None:
    new = new_noun("a teapot", THREE_NOUNS)

    def labels(*names: str) -> list[str]:
        return [" ".join(map(str, found)) for found in labelled(names, new).values()]

    assert labels("a.glb", "tall/b.glb", "long-neck/c.glb") == ["", "tall", "long neck"]
    assert labels("pots/a.glb", "pots/tall/b.glb") == ["", "tall"]
    assert labels("tall/a.glb", "tall/b.glb") == ["tall", "tall"]
    with pytest.raises(ParameterError, match="'misc' does not name attributes"):
        labels("a.glb", "misc/b.glb")


@each_case(
    ("names", "kit"),
    [
        (["barrel_02.glb", "TallBarrel.glb"], ["barrel", "barrel tall"]),
        (["kit/glb/barrels/a.glb", "kit/glb/barrels/tall/b.glb", "kit/glb/Bear_Traps/c.obj"],
         ["barrel", "barrel tall", "bear-trap"]),
        (["glasses/1.glb", "dress/2.glb", "gnome-A.glb"], ["glass", "dress", "gnome"]),
        (["kit/gnome.glb"], ["gnome"]),
    ],
)  # fmt: skip
def test_folders_of_a_kit_or_its_files_name_the_nouns(names: list[str], kit: list[str]) -> None:
    assert [" ".join(filter(None, each)) for each in nouns_of_kit(names).values()] == kit


def test_a_kit_teaches_all_its_nouns_at_once(tmp_path: Path) -> None:
    weights = InputFile(write_small_weights(tmp_path / "small.safetensors").read_bytes(), "weights.safetensors")
    names = ("gnomes__round_glb", "gnomes__tall__a_glb", "gnomes__b_glb", "tea_pot_glb", "vase_glb")
    files = {"meshes": InputFile(packed(**dict.fromkeys(names, BALL)), "kit.zip"), "weights": weights}
    params = {"model": "weights", "steps": 2, "replace": True}
    run = start_run(RunInput(JobRequest.model_validate({"kind": "prior_teach", "params": params}), files))
    assert len(list(run)) == 2
    made = run.finish()
    report = json.loads(made["report.json"].data)
    assert [(each["noun"], each["replaced"], len(each["meshes"])) for each in report["nouns"]] == [
        ("gnome", False, 3),
        ("tea-pot", False, 1),
        ("vase", True, 1),
    ]
    assert [sum(mesh["held_out"] for mesh in each["meshes"]) for each in report["nouns"]] == [1, 0, 0]
    pictures = [each["retrieval"]["pictures"] for each in report["nouns"]]
    assert (
        sum(pictures)
        == report["retrieval"]["new"]["pictures"]
        == sum(sum(each["taken_for"].values()) for each in report["nouns"])
    )
    assert set(report["old_nouns"]) == {"bowl", "heart"}
    mine = tmp_path / "mine.safetensors"
    mine.write_bytes(made["weights.safetensors"].data)
    words = known_words(str(mine))
    assert set(words.nouns) == {"bowl", "heart", "vase", "gnome", "tea-pot"}
    assert str(parse("a tall tea pot", words)) == "a tall tea pot"
    assert set(read_replay(mine)) == {"gnome", "tea-pot", "vase"}
    assert [lesson.noun for lesson in lessons_of(read_metadata(mine), mine)] == ["gnome", "tea-pot", "vase"]


@each_case(
    ("params", "names", "words"),
    [
        ({}, ["vase/a.glb", "heart/b.glb"], "knows 'vase' already. The model knows 'heart' already.*params.replace"),
        ({}, ["01.glb", "gnome.glb"], "'01' does not say what 01.glb shows"),
        ({}, ["gnome/odd/a.glb", "pot/a.glb"], "'odd' does not name attributes"),
        ({"synonyms": ["dwarf"]}, ["gnome.glb"], "no synonyms"),
        ({"replace": True}, ["blorp/a.glb", "blorps/b.glb"], "'blorps' and 'blorp' are one noun.*in one folder"),
    ],
)
def test_a_kit_that_cannot_be_taught_is_refused_with_all_its_names(
    params: dict[str, Any], names: list[str], words: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        lesson_of(TeachParams(**params), THREE_NOUNS, names)
    assert re.search(words, f"{caught.value.detail} {caught.value.advice_text}")


_BOMB = packed(big_glb=b"0" * 2_000_000)


@each_case(
    ("data", "words"),
    [
        (packed(readme_txt=b"no mesh"), "holds no mesh"),
        (packed(), "holds no mesh"),
        (packed(a_obj=b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), r"a.obj: 1 faces are too few"),
        (packed(a_glb=b"glTF"), r"a.glb: "),
        (packed(**{f"m{number}_obj": CUBE for number in range(MAX_MESHES + 1)}), "holds 201 meshes; .* at most 200"),
        (packed(**{"..__evil_glb": BALL}), "names a file outside itself"),
        (_BOMB, "unpacks to more than"),
        (_BOMB[:60], "cannot be read"),
    ],
    ids=["no mesh", "empty", "one face", "broken", "too many", "outside", "bomb", "cut"],
)
def test_a_zip_that_cannot_be_learned_from_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(AssetError, match=words):
        inspect_lesson(data, Limits(max_bytes=1_000_000, max_archive_files=1000))


def test_a_file_that_is_no_zip_is_the_only_mesh() -> None:
    assert open_lesson(BALL, "models\\ball.glb", Limits()) == {"ball.glb": BALL}


@each_case(
    ("document", "kind", "words"),
    [
        ({"noun": "a vase"}, ParameterError, "knows 'vase' already.*params.replace"),
        ({"noun": "tall"}, ParameterError, "another role"),
        ({"noun": "x" * 60}, ParameterError, "no noun that can be taught"),
        ({"model": "stabilityai/sd"}, ParameterError, "cannot be taught"),
        ({"model": "other.safetensors"}, ModelError, "no taught weights 'other.safetensors'.*Use one of: builtin"),
        ({"model": "weights"}, ParameterError, "the part `weights` is missing"),
        ({"model": "job:job_01kg9zqk2xf3v8c5m7n9p1r4t6"}, ParameterError, "Download weights.safetensors of the job"),
        ({"prompt": "a teapot"}, ParameterError, "has no prompt"),
        ({"output": {"morph": True}}, ParameterError, "`output` is for jobs that deform"),
    ],
)
def test_a_lesson_that_cannot_be_held_is_refused_at_the_door(
    document: dict[str, Any], kind: type[MeshdeformError], words: str
) -> None:
    members = {name: document.pop(name) for name in ("prompt", "output") if name in document}
    request = JobRequest.model_validate({"kind": "prior_teach", "params": {"noun": "a teapot", **document}, **members})
    with pytest.raises(kind) as caught:
        check_request(request, Settings(), files=["meshes"])
    assert re.search(words, f"{caught.value.detail} {caught.value.advice_text}")


def test_the_kept_parameters_decide_and_of_those_of_another_version_the_model() -> None:
    asked = JobRequest.model_validate({"kind": "prior_teach", "params": {"noun": "a gnome", "model": "gnomes"}})
    kept = {**asked.params.model_dump(mode="json"), "model": "/models/gnomes.safetensors", "steps": 10**9}
    assert _params(RunInput(asked, {}, resolved=kept)).model_dump(mode="json") == kept
    of_another = _params(RunInput(asked, {}, resolved={**kept, "wobble": 0.5})).model_dump(mode="json")
    assert of_another == {**asked.params.model_dump(mode="json"), "model": "/models/gnomes.safetensors"}
