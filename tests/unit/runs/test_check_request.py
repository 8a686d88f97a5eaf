"""What is refused at the door, before anything is stored."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from meshdeform.errors import (
    KindRetiredError,
    MeshdeformError,
    ModelError,
    ParameterError,
    PromptError,
    VocabularyError,
)
from meshdeform.priors.builtin.network import WEIGHTS
from meshdeform.requests.document import JobRequest
from meshdeform.runs import check_request, start_run
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.settings import Settings
from tests.cases import each_case


def check(request: dict[str, Any], *, has_target: bool = False, **settings: Any) -> None:
    check_request(
        JobRequest.model_validate(request), Settings(**settings), files=["asset", "target"] if has_target else ["asset"]
    )


GUIDANCE = ["params", "guidance"]


def vase(**guidance: str) -> dict[str, Any]:
    return {"prompt": "a tall vase", "params": {"guidance": guidance}}


@each_case(
    ("request", "files", "error", "words", "place"),
    [
        ({"prompt": "a mushroom"}, [], ParameterError, "`asset` is missing", ["asset"]),
        ({"prompt": "a mushroom"}, ["asset", "pose"], ParameterError, "does not read `pose`", ["pose"]),
        (
            {"params": {"guidance": {"kind": "target"}}},
            ["asset"],
            ParameterError,
            "second mesh",
            ["params", "guidance"],
        ),
        ({"prompt": "a mushroom"}, ["asset", "target"], ParameterError, "A target was sent", GUIDANCE),
        ({"prompt": "  \n"}, ["asset"], PromptError, "prompt", ["prompt"]),
        ({"prompt": "a quixotic zeitgeist"}, ["asset"], VocabularyError, "quixotic", ["prompt"]),
        (vase(negative_prompt="blurry"), ["asset"], VocabularyError, "blurry", [*GUIDANCE, "negative_prompt"]),
        (vase(negative_prompt="tall"), ["asset"], PromptError, "means the same", [*GUIDANCE, "negative_prompt"]),
        (vase(source_noun="zeitgeist"), ["asset"], VocabularyError, "zeitgeist", [*GUIDANCE, "source_noun"]),
    ],
)
def test_what_cannot_run_is_refused_with_its_place(
    request: dict[str, Any], files: list[str], error: type[MeshdeformError], words: str, place: list[str]
) -> None:
    with pytest.raises(error, match=words) as caught:
        check_request(JobRequest.model_validate(request), Settings(), files=files)
    assert [each["loc"] for each in caught.value.extra.get("errors", [{"loc": place}])] == [place]


def test_what_can_run_passes() -> None:
    check({"prompt": "a tall thin vase"})
    check({"prompt": "a mushroom", "params": {"guidance": {"model": "builtin"}}}, model="some/other")
    check({"params": {"guidance": {"kind": "target"}}}, has_target=True)
    check({"prompt": "anything at all", "params": {"guidance": {"kind": "target"}}}, has_target=True)
    check(vase(negative_prompt="fat"))
    check(vase(source_noun="dog", negative_prompt="a dog"))


def test_a_model_that_the_server_does_not_run_is_refused_with_those_that_it_does() -> None:
    with pytest.raises(ModelError) as caught:
        check(
            {"prompt": "x", "params": {"guidance": {"model": "some/body"}}},
            model="my/default",
            allowed_models=["also/this"],
        )
    assert caught.value.extra["models"] == ["builtin", "my/default", "also/this"]
    assert "MESHDEFORM_ALLOWED_MODELS" in caught.value.advice_text


@pytest.mark.parametrize("params", [{}, {"guidance": {"model": "also/this"}}])
def test_a_model_that_is_allowed_but_not_there_is_refused(params: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("diffusers")
    with pytest.raises(ModelError, match="not on this machine"):
        check({"prompt": "x", "params": params}, model=f"nobody/{tmp_path.name}", allowed_models=["also/this"])


def test_the_check_loads_neither_torch_nor_numpy() -> None:
    code = (
        "import sys; from meshdeform.runs import check_request; from meshdeform.requests.document import JobRequest;"
        "from meshdeform.settings import Settings;"
        "check_request(JobRequest(prompt='a mushroom'), Settings(), files=['asset']);"
        "print(sorted({'torch', 'numpy', 'diffusers'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout.strip() == "[]"


# Files of weights: a service uses those that it offers, by their names, and opens no other file for a client.


def guided(model: str, prompt: str = "a tall vase") -> JobRequest:
    return JobRequest.model_validate({"prompt": prompt, "params": {"guidance": {"kind": "sds", "model": model}}})


def test_a_service_reads_only_the_files_of_weights_that_it_offers(tmp_path: Path) -> None:
    mine = shutil.copy(WEIGHTS, tmp_path / "mine.safetensors")
    other = shutil.copy(WEIGHTS, tmp_path / "other.safetensors")
    settings = Settings(allowed_models=[str(mine)])
    for name in ("mine.safetensors", str(mine)):
        resolved: Any = check_request(guided(name), settings, files=["asset"])
        assert resolved.model == str(mine)
    with pytest.raises(VocabularyError, match="zeitgeist"):
        check_request(guided("mine.safetensors", "a zeitgeist"), settings, files=["asset"])
    answers = []
    for path in (other, tmp_path / "nowhere.safetensors"):
        with pytest.raises(KindRetiredError, match="does not run the model") as refused:
            check_request(guided(str(path)), settings, files=["asset"])
        answers.append(refused.value.detail.replace(path.name, ""))
        assert str(mine) not in refused.value.detail + refused.value.advice_text
    assert answers[0] == answers[1]  # nobody learns which files exist
    mine.write_bytes(b"broken")
    with pytest.raises(ModelError, match="not safetensors") as broken:
        check_request(guided("mine.safetensors"), settings, files=["asset"])
    assert str(tmp_path) not in broken.value.detail


@each_case(
    ("model", "files"),
    [("weights", ["asset", "weights"]), ("job:job_1", ["asset"]), ("builtin", ["asset", "weights"])],
)
def test_taught_weights_are_refused_at_the_door_and_in_a_worker(model: str, files: list[str]) -> None:
    with pytest.raises(KindRetiredError) as refused:
        check_request(guided(model, "a gnome"), Settings(), files=files)
    assert (refused.value.status, refused.value.code) == (422, "kind_retired")
    assert "meshdeform words add" in refused.value.advice_text
    with pytest.raises(KindRetiredError):
        start_run(RunInput(guided(model, "a gnome"), dict.fromkeys(files, InputFile(b"", "a.glb"))))
