"""Clients name a model in a folder by its id and do not learn where the folder is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import pytest

from meshdeform import priors
from meshdeform.errors import ModelError
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import check_request, start_run, text_deform_check
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.settings import Settings
from tests.integration.conftest import serving


@pytest.fixture
def folders(tmp_path: Path) -> list[Path]:
    """Return two folders of the same name and one of another; they hold no model."""
    found = [tmp_path / "private" / "sd21", tmp_path / "other" / "sd21", tmp_path / "other" / "sd15"]
    for folder in found:
        folder.mkdir(parents=True)
    return found


@pytest.fixture
def settings(tmp_path: Path, folders: list[Path]) -> Settings:
    allowed = [str(folders[1]), f"{folders[2]}/", "owner/hub"]
    return Settings(data_dir=tmp_path, model=str(folders[0]), allowed_models=allowed)


def test_no_answer_shows_a_model_folder(
    redis_url: str, settings: Settings, folders: list[Path], sphere: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def post(route: str, **params: Any) -> httpx.Response:
        request = json.dumps({"prompt": "x", "params": grouped(params)})
        return http.post(route, files={"asset": ("a.glb", sphere), "request": (None, request)})

    settings = settings.model_copy(update={"redis_url": redis_url})
    with serving(settings) as url, httpx.Client(base_url=url, timeout=240) as http:
        listed = http.get("/v1/models")
        ids = [model["id"] for model in listed.json()["models"]]
        assert listed.json()["default"] == ids[0]
        assert [name.partition("-")[0] for name in ids] == ["sd21", "builtin", "sd21", "sd15", "owner/hub"]
        assert len(set(ids)) == 5
        named = [*ids[2:4], str(folders[1]), "nobody/else"]
        answers = [listed, *(post(r, model=m) for r in ("/v1/jobs", "/v1/jobs:validate") for m in named)]
        assert {answer.status_code for answer in answers[1:]} == {422}
        assert {answer.json()["code"] for answer in answers[1:]} == {"model_unavailable"}
        assert "does not run" in answers[-1].text
        assert not any("does not run" in answer.text for answer in answers[1:4])
        monkeypatch.setattr(text_deform_check, "check_model", lambda *_: None)
        valid = [post("/v1/jobs:validate", model=ids[2]), post("/v1/jobs:validate"), post("/v1/jobs", model=ids[3])]
        assert [answer.status_code for answer in valid] == [200, 200, 202]
        assert [answer.json()["params"]["model"] for answer in valid[:2]] == [ids[2], ids[0]]
        assert valid[2].json()["params"]["guidance"]["model"] == ids[3]
        for answer in (*answers, *valid):
            assert not any(str(folder.parent) in answer.text for folder in folders), answer.text


def test_a_model_is_found_by_its_id_and_by_its_path(
    settings: Settings, folders: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text_deform_check, "check_model", lambda *_: None)
    for name in ("sd15", f"{folders[2]}/"):
        request = JobRequest.model_validate({"prompt": "x", "params": {"guidance": {"model": name}}})
        checked: Any = check_request(request, settings, files=["asset"])
        assert checked.model == f"{folders[2]}/"


def test_a_worker_names_a_broken_model_by_its_id(folders: list[Path], sphere: bytes) -> None:
    pytest.importorskip("diffusers")
    request = JobRequest.model_validate({"prompt": "x", "params": {"guidance": {"model": "sd15"}}})
    resolved = {"model": str(folders[2]), "no longer": "a parameter"}  # of another version

    def load(model: str) -> Any:
        return priors.load_prior(model, device="cpu")

    given = RunInput(request, {"asset": InputFile(sphere, "a.glb")}, resolved=resolved, load_prior=load)
    with pytest.raises(ModelError, match="The model 'sd15'") as caught:
        start_run(given)
    assert str(folders[2]) not in caught.value.detail + caught.value.advice_text
