"""What is refused at the door, before anything is stored."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from meshdeform.errors import ModelError, ParameterError, PromptError, VocabularyError
from meshdeform.requests.document import JobRequest
from meshdeform.runs import check_request
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.taught import write_small_weights


def check(request: dict[str, Any], *, has_target: bool = False, **settings: Any) -> None:
    check_request(
        JobRequest.model_validate(request), Settings(**settings), files=["asset", "target"] if has_target else ["asset"]
    )


def test_files_that_a_kind_needs_or_does_not_read_are_refused() -> None:
    request = JobRequest(prompt="a mushroom")
    with pytest.raises(ParameterError, match="`asset` is missing"):
        check_request(request, Settings(), files=[])
    with pytest.raises(ParameterError, match="does not read `pose`") as caught:
        check_request(request, Settings(), files=["asset", "pose"])
    assert caught.value.extra["errors"][0]["loc"] == ["pose"]


def test_what_can_run_passes() -> None:
    check({"prompt": "a tall thin vase"})
    check({"prompt": "a mushroom", "params": {"guidance": {"model": "builtin"}}}, model="some/other")
    check({"params": {"guidance": {"kind": "target"}}}, has_target=True)
    check({"prompt": "anything at all", "params": {"guidance": {"kind": "target"}}}, has_target=True)


def test_a_negative_prompt_of_the_builtin_prior_is_of_its_grammar() -> None:
    check({"prompt": "a vase", "params": {"guidance": {"negative_prompt": "fat"}}})
    with pytest.raises(VocabularyError, match="blurry") as caught:
        check({"prompt": "a vase", "params": {"guidance": {"negative_prompt": "blurry"}}})
    assert [error["loc"] for error in caught.value.extra["errors"]] == [["params", "guidance", "negative_prompt"]]
    with pytest.raises(PromptError, match="means the same"):
        check({"prompt": "a tall vase", "params": {"guidance": {"negative_prompt": "tall"}}})


def test_what_the_source_is_must_be_a_word_of_the_builtin_prior() -> None:
    check({"prompt": "a giraffe", "params": {"guidance": {"source_noun": "dog", "negative_prompt": "a dog"}}})
    with pytest.raises(VocabularyError, match="zeitgeist") as caught:
        check({"prompt": "a giraffe", "params": {"guidance": {"source_noun": "zeitgeist"}}})
    assert [error["loc"] for error in caught.value.extra["errors"]] == [["params", "guidance", "source_noun"]]


@each_case("prompt", ["", "  \n"])
def test_an_empty_prompt_is_refused(prompt: str) -> None:
    with pytest.raises(PromptError):
        check({"prompt": prompt})


def test_a_prompt_outside_the_vocabulary_is_refused_with_the_vocabulary() -> None:
    with pytest.raises(VocabularyError) as caught:
        check({"prompt": "a quixotic zeitgeist"})
    assert "mushroom" in caught.value.extra["nouns"]
    assert "Stable Diffusion" in caught.value.advice_text


def test_target_and_guidance_go_together() -> None:
    with pytest.raises(ParameterError, match="second mesh") as caught:
        check({"params": {"guidance": {"kind": "target"}}})
    assert caught.value.extra["errors"][0]["loc"] == ["params", "guidance"]
    with pytest.raises(ParameterError, match="A target was sent"):
        check({"prompt": "a mushroom"}, has_target=True)


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


# A service offers taught weights by the name of their file, and opens no other file for a client.


def test_a_service_reads_only_the_taught_files_that_it_offers(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    mine = write_small_weights(tmp_path / "models" / "mine.safetensors")
    other = write_small_weights(tmp_path / "other.safetensors")
    settings = Settings(models=str(tmp_path / "models"))

    def check(prompt: str, model: str) -> Any:
        request = JobRequest.model_validate({"prompt": prompt, "params": {"guidance": {"model": model}}})
        return check_request(request, settings, files=["asset"])

    for name in ("mine.safetensors", str(mine)):
        resolved = check("a tall vase", name)
        assert resolved.model == str(mine)
        assert resolved.steps == check("a tall vase", "builtin").steps
    with pytest.raises(VocabularyError, match="giraffe"):
        check("a giraffe", "mine.safetensors")
    answers = []
    for path in (other, tmp_path / "nowhere.safetensors"):
        with pytest.raises(ModelError, match="does not run the model") as refused:
            check("a vase", str(path))
        answers.append(refused.value.detail.replace(path.name, ""))
        assert str(mine) not in refused.value.detail + refused.value.advice_text
    assert answers[0] == answers[1]  # nobody learns which files exist
    mine.write_bytes(b"broken")
    with pytest.raises(ModelError, match="not safetensors") as broken:
        check("a vase", "mine.safetensors")
    assert str(tmp_path) not in broken.value.detail
    write_small_weights(tmp_path / "models" / "new.safetensors")
    assert check("a vase", "new.safetensors").model.endswith("new.safetensors")
