"""Text-to-3D models: found without torch, run on Shap-E's real classes with small random weights."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from meshdeform.errors import ModelError, PromptError
from meshdeform.priors import shap_e
from meshdeform.priors.catalogue import list_models
from meshdeform.priors.text_to_3d import GeneratedMesh, check_generator, is_generator, load_generator, model_state
from tests.tiny_shap_e import build_tiny_shap_e

GRID = 16


@pytest.fixture
def copy(tiny_shap_e: Path, tmp_path: Path) -> Path:
    """A model to break."""
    return shutil.copytree(tiny_shap_e, tmp_path / "shap-e")


def generate(folder: Path, prompt: str = "a shark", seed: int = 0, steps: int = 2) -> GeneratedMesh:
    return load_generator(str(folder), device="cpu").generate(prompt, seed=seed, steps=steps, guidance_scale=4.0)


def test_a_mesh_is_closed_and_upright(tiny_shap_e: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shap_e, "GRID", GRID)
    mesh = generate(tiny_shap_e)
    extent = np.ptp(mesh.verts, axis=0)
    # The decoder's shape is tallest along its +Z, and deeper than wide.
    assert extent[1] > 1.2 * extent[2] > 1.2 * extent[0]
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert mesh.colors is not None
    assert mesh.colors.shape == mesh.verts.shape


def test_seed_and_prompt_decide(tiny_shap_e: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shap_e, "GRID", GRID)
    model = load_generator(str(tiny_shap_e), device="cpu")
    options = {"steps": 2, "guidance_scale": 4.0}
    first, again, other, word = (
        model.generate(prompt, seed=seed, **options).verts
        for prompt, seed in (("a shark", 0), ("a shark", 0), ("a shark", 1), ("a chair", 0))
    )
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.array_equal(first, other)
    assert first.shape != word.shape or not np.array_equal(first, word)
    with pytest.raises(PromptError, match="this model reads 75"):
        model.generate("x" * 90, seed=0, **options)


def test_an_empty_mesh_is_an_error_that_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shap_e, "GRID", 8)
    with pytest.raises(ModelError, match="is empty") as caught:
        generate(build_tiny_shap_e(tmp_path / "empty", empty=True))
    assert "another seed" in caught.value.advice_text


def test_what_is_no_such_model_is_refused(copy: Path, tmp_path: Path) -> None:
    check_generator(str(copy))
    assert is_generator(str(copy))
    before = model_state(str(copy))
    weights = next((copy / "shap_e_renderer").glob("*.safetensors"))
    kept = weights.read_bytes()
    weights.unlink()
    assert model_state(str(copy)) != before
    with pytest.raises(ModelError, match="no safetensors weights in shap_e_renderer/"):
        check_generator(str(copy))
    weights.write_bytes(kept[: len(kept) // 2])
    with pytest.raises(ModelError, match="cannot be read"):
        load_generator(str(copy), device="cpu")
    (copy / "model_index.json").write_text(json.dumps({"_class_name": "StableDiffusionPipeline"}))
    with pytest.raises(ModelError, match="is a StableDiffusionPipeline"):
        check_generator(str(copy))
    with pytest.raises(ModelError, match="There is no folder"):
        check_generator(str(tmp_path / "nothing"))


def test_the_list_says_what_it_is_for_and_under_which_licence(tiny_shap_e: Path) -> None:
    builtin, model = list_models("builtin", [str(tiny_shap_e)])
    assert (builtin.purpose, builtin.licence) == ("guidance", "Apache-2.0")
    assert (model.purpose, model.licence, model.available) == ("target", "mit", True)
