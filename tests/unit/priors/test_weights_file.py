"""Files of weights of one's own for the builtin prior: used if they have its words, and what is wrong with others."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from meshdeform.errors import KindRetiredError, ModelError
from meshdeform.priors import check_model, load_prior
from meshdeform.priors.builtin import weights_file
from meshdeform.priors.builtin.network import ModelConfig, PriorNetwork, write_weights
from meshdeform.priors.catalogue import list_models
from tests.cases import each_case

SMALL = ModelConfig(channels=(8, 16, 16), embedding=16, text_width=16)


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Untrained weights of a small network."""
    torch.manual_seed(0)
    path = tmp_path / "good.safetensors"
    write_weights(path, PriorNetwork(SMALL).state_dict(), SMALL, {"steps": "0", "seed": "0"})
    return path


def _with_header(path: Path, name: str, change: Any) -> Path:
    """Return a copy of a file whose header is changed."""
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    change(header)
    text = json.dumps(header).encode()
    copy = path.with_name(f"{name}.safetensors")
    copy.write_bytes(len(text).to_bytes(8, "little") + text + data[8 + size :])
    return copy


def test_weights_with_the_words_of_the_package_are_a_model(weights: Path) -> None:
    check_model(str(weights))
    prior = load_prior(str(weights), device="cpu")
    assert prior.identity["id"] == str(weights)
    assert prior.encode_texts("a tall vase").shape == (1, 16)
    listed = {model.id: model for model in list_models("builtin", [str(weights)], public=True)}
    assert listed["good.safetensors"].vocabulary == listed["builtin"].vocabulary


def test_weights_whose_words_were_taught_are_retired(weights: Path) -> None:
    def taught(header: dict[str, Any]) -> None:
        header["__metadata__"] |= {"words_format": "1", "words": "<pad> gnome"}

    mine = _with_header(weights, "mine", taught)
    for use in (check_model, lambda model: load_prior(model, device="cpu")):
        with pytest.raises(KindRetiredError, match=r"mine\.safetensors were taught") as refused:
            use(str(mine))
        assert str(mine) not in refused.value.detail
    model = list_models("builtin", [str(mine)])[1]
    assert (model.available, model.vocabulary) == (False, None)
    assert "meshdeform words add" in str(model.problem)


def test_files_from_elsewhere_are_refused_before_they_are_loaded(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = weights.read_bytes()
    _with_header(weights, "rows", lambda header: header["text.word.weight"].update(shape=[3, 16]))
    _with_header(weights, "words", lambda header: header["__metadata__"].update(words="<pad> vase"))
    mixed = json.dumps({"a": {"data_offsets": [0, "x"]}, "b": {"data_offsets": [0, 4]}}).encode()
    files = {
        "pickle": (pickle.dumps({"a": 1}), "not safetensors"),
        "empty": (b"", "not safetensors"),
        "cut": (good[:-100], "not whole"),
        "huge-header": ((2**62).to_bytes(8, "little") + b"{}", "not safetensors|not whole"),
        "mixed": (len(mixed).to_bytes(8, "little") + mixed + b"1234", "not safetensors"),
        "rows": (None, "for [0-9]+ words"),
        "words": (None, "another vocabulary"),
    }
    for name, (data, words) in files.items():
        path = tmp_path / f"{name}.safetensors"
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(ModelError, match=words):
            check_model(str(path))
    save_file({"first_stage_model.weight": torch.zeros(2)}, tmp_path / "sd.safetensors")
    with pytest.raises(ModelError, match="no weights of the builtin prior") as refused:
        check_model(str(tmp_path / "sd.safetensors"))
    assert "from_single_file" in refused.value.advice_text
    with pytest.raises(ModelError, match="There is no file"):
        check_model(str(tmp_path / "nowhere.safetensors"))
    monkeypatch.setattr(weights_file, "MAX_FILE_BYTES", 1000)
    with pytest.raises(ModelError, match="at most 1,000"):
        check_model(str(weights))


@each_case(
    ("change", "words"),
    [
        (lambda state: state.pop("stem.bias"), "do not fit"),
        (lambda state: state.update({"stem.bias": state["stem.bias"][:1].clone()}), "do not fit"),
        (lambda state: state["stem.bias"].fill_(float("nan")), "not finite"),
    ],
)
def test_tensors_that_do_not_fit_are_refused(weights: Path, change: Any, words: str) -> None:
    with safe_open(weights, framework="pt") as file:
        metadata = file.metadata()
    state = load_file(weights)
    change(state)
    changed = weights.with_name("changed.safetensors")
    save_file(state, changed, metadata)
    with pytest.raises(ModelError, match=words):
        load_prior(str(changed), device="cpu")
