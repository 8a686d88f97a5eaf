"""A service offers taught weights by the name of their file, and opens no other file for a client."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from meshdeform.errors import ModelError, VocabularyError
from meshdeform.requests.document import JobRequest
from meshdeform.runs import check_request
from meshdeform.settings import Settings
from tests.taught import write_small_weights


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
