"""Finding a checkpoint: what is complete is found without torch, what is not is refused with what to do."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from meshdeform.errors import DependencyError, ModelError
from meshdeform.priors import check_model
from meshdeform.priors.builtin.vocabulary import BUILTIN_WORDS, tokenise
from meshdeform.priors.builtin.vocabulary import NOUNS as PRIOR_NOUNS
from meshdeform.priors.catalogue import EXAMPLES, list_models, shapes_vocabulary
from meshdeform.priors.model_files import find
from meshdeform.vocabulary.grammar import parse
from meshdeform.vocabulary.lookup import ATTRIBUTES
from meshdeform.vocabulary.nouns import NOUNS
from meshdeform.words import in_use
from tests.cases import each_case
from tests.unit.words.words import WEDGE

HUB_ID = "somebody/tiny-stable-diffusion"
COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    """The files that are looked at; nothing here reads the weights."""
    folder = tmp_path / "checkpoint"
    documents = {
        "model_index.json": {"_class_name": "StableDiffusionPipeline"},
        "scheduler/scheduler_config.json": {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear"},
        "tokenizer/tokenizer.json": {},
        "text_encoder/config.json": {},
        "unet/config.json": {},
        "vae/config.json": {},
    }
    for name, document in documents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(json.dumps(document))
    for name in ("text_encoder/model", "unet/diffusion_pytorch_model", "vae/diffusion_pytorch_model"):
        (folder / f"{name}.safetensors").write_bytes(name.encode())
    return folder


@pytest.fixture
def hub_cache(checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A Hugging Face cache that holds the checkpoint under `HUB_ID`."""
    from huggingface_hub import constants

    cache = tmp_path / "hub"
    repository = cache / f"models--{HUB_ID.replace('/', '--')}"
    shutil.copytree(checkpoint, repository / "snapshots" / COMMIT)
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text(COMMIT)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(cache))
    return cache


def test_a_complete_folder_is_found_and_hashed(checkpoint: Path) -> None:
    check_model(str(checkpoint))
    files = find(str(checkpoint))
    assert {part: [path.name for path in files.networks[part].files] for part in files.networks} == {
        "text_encoder": ["model.safetensors"],
        "unet": ["diffusion_pytorch_model.safetensors"],
        "vae": ["diffusion_pytorch_model.safetensors"],
    }
    content = b"text_encoder/model" + b"unet/diffusion_pytorch_model" + b"vae/diffusion_pytorch_model"
    assert files.sha256() == hashlib.sha256(content).hexdigest()


def test_a_hub_id_is_found_in_the_cache_with_its_commit(hub_cache: Path) -> None:
    for revision in ("", "main", COMMIT):
        check_model(HUB_ID, revision)
        assert find(HUB_ID, revision).revision == COMMIT
    with pytest.raises(ModelError, match="at revision v2 is not"):
        check_model(HUB_ID, "v2")


@each_case("revision", ["", "fp16"])
def test_a_hub_id_that_is_not_here_names_the_command_and_the_setting(revision: str) -> None:
    with pytest.raises(ModelError, match="is not on this machine") as caught:
        check_model("nobody/nothing", revision)
    command = f"hf download nobody/nothing{' --revision fp16' if revision else ''}"
    assert command in caught.value.advice_text
    assert "MESHDEFORM_MODEL" in caught.value.advice_text
    found = list_models("nobody/nothing")[0]
    assert (found.title, found.available, found.vocabulary) == ("nothing", False, None)


@each_case("name", ["/no/such/folder", "./nothing", "a/b/c", "../up", "two words", "-rf/x"])
def test_what_is_neither_a_folder_nor_a_hub_id_is_refused(name: str) -> None:
    with pytest.raises(ModelError, match="There is no folder"):
        check_model(name)


def test_pickled_weights_are_refused_by_name(checkpoint: Path) -> None:
    weights = checkpoint / "unet" / "diffusion_pytorch_model.safetensors"
    for pickle in ("diffusion_pytorch_model.bin", "weights.ckpt"):
        weights = weights.rename(weights.with_name(pickle))
        with pytest.raises(ModelError, match=rf"only {pickle}.*needs safetensors") as caught:
            check_model(str(checkpoint))
        assert "save_pretrained" in caught.value.advice_text


@each_case(
    "missing",
    [
        "model_index.json",
        "scheduler/scheduler_config.json",
        "tokenizer/tokenizer.json",
        "unet/config.json",
        "vae/config.json",
        "text_encoder/config.json",
        "unet/diffusion_pytorch_model.safetensors",
        "vae/diffusion_pytorch_model.safetensors",
        "text_encoder/model.safetensors",
    ],
)
def test_an_incomplete_folder_is_refused(checkpoint: Path, missing: str) -> None:
    content = (checkpoint / missing).read_bytes()
    (checkpoint / missing).unlink()
    with pytest.raises(ModelError, match=missing.partition("/")[0].removesuffix(".json")):
        check_model(str(checkpoint))
    (checkpoint / missing).write_bytes(content)


def test_files_of_half_precision_are_taken_if_asked_for_or_where_there_are_no_others(checkpoint: Path) -> None:
    for name in ("text_encoder/model", "unet/diffusion_pytorch_model", "vae/diffusion_pytorch_model"):
        shutil.copy(checkpoint / f"{name}.safetensors", checkpoint / f"{name}.fp16.safetensors")
    assert {network.variant for network in find(str(checkpoint)).networks.values()} == {""}
    assert {network.variant for network in find(str(checkpoint), half=True).networks.values()} == {"fp16"}
    (checkpoint / "vae" / "diffusion_pytorch_model.safetensors").unlink()
    networks = find(str(checkpoint)).networks
    assert (networks["vae"].variant, networks["unet"].variant) == ("fp16", "")


def test_weights_in_several_files_are_all_needed(checkpoint: Path) -> None:
    folder = checkpoint / "unet"
    (folder / "diffusion_pytorch_model.safetensors").rename(folder / "part-1.safetensors")
    index = {"weight_map": {"a": "part-1.safetensors", "b": "part-2.safetensors", "c": "part-1.safetensors"}}
    (folder / "diffusion_pytorch_model.safetensors.index.json").write_text(json.dumps(index))
    with pytest.raises(ModelError, match="lacks unet/part-2"):
        check_model(str(checkpoint))
    (folder / "part-2.safetensors").write_bytes(b"")
    names = [path.name for path in find(str(checkpoint)).networks["unet"].files]
    assert names == ["part-1.safetensors", "part-2.safetensors"]


@each_case(
    ("file", "text", "words"),
    [
        ("model_index.json", "{", r"model_index\.json"),
        ("model_index.json", "[]", r"model_index\.json"),
        ("model_index.json", '{"_class_name": "StableDiffusionXLPipeline"}', "is a StableDiffusionXLPipeline"),
        (
            "unet/diffusion_pytorch_model.safetensors",
            "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 3460000000\n",
            "git-lfs pointer",
        ),
    ],
)
def test_a_file_that_is_no_such_file_is_one_clear_error(checkpoint: Path, file: str, text: str, words: str) -> None:
    before = (checkpoint / file).read_text()
    (checkpoint / file).write_text(text)
    with pytest.raises(ModelError, match=words):
        check_model(str(checkpoint))
    (checkpoint / file).write_text(before)


def without(monkeypatch: pytest.MonkeyPatch, *missing: str) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, package=None: None if name in missing else real(name, package)
    )


def test_a_missing_extra_is_named_and_where_no_models_run_it_is_left_to_the_worker(
    checkpoint: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "diffusers", "transformers")
    with pytest.raises(DependencyError, match="diffusers and transformers") as caught:
        check_model(str(checkpoint))
    assert 'pip install -e ".[sd]"' in caught.value.advice_text
    without(monkeypatch, "torch", "diffusers", "transformers")
    for name in ("nobody/nothing", "/only/on/the/worker", "builtin"):
        check_model(name)
    assert list_models("owner/one")[0].available is None, "nothing is claimed"


def test_checking_loads_neither_torch_nor_numpy(checkpoint: Path) -> None:
    program = (
        "import sys; from meshdeform.errors import ModelError; from meshdeform.priors import check_model\n"
        f"check_model({str(checkpoint)!r})\n"
        "try:\n    check_model('nobody/nothing')\nexcept ModelError: pass\n"
        "print(*sorted({'torch', 'numpy', 'diffusers', 'transformers'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert result.stdout.strip() == ""


# The models in words: what is said about them is true.


def test_the_builtin_model_is_there_and_says_all_that_it_understands() -> None:
    (model,) = list_models("builtin")
    assert (model.id, model.available, model.problem) == ("builtin", True, None)
    assert model.vocabulary is not None
    assert model.vocabulary.parts == PRIOR_NOUNS
    assert sorted(noun for nouns in model.vocabulary.groups.values() for noun in nouns) == sorted(PRIOR_NOUNS)
    for prompt in (*EXAMPLES, *(f"a {noun}" for noun in model.vocabulary.nouns)):
        tokenise(parse(prompt, BUILTIN_WORDS))


def test_prompts_can_say_all_that_there_are_shapes_of_and_words_of_ones_own_first() -> None:
    found = shapes_vocabulary({"wedge": ("head",)})
    assert found.nouns[0] == "wedge"
    assert set(found.nouns) == {"wedge", *NOUNS}
    assert next(iter(found.groups.items())) == ("yours", ("wedge",))
    with in_use([WEDGE]):
        for noun in found.nouns:
            assert parse(f"a {noun}").noun == noun
            for part in found.parts[noun]:
                assert [a for a in found.attributes if a.endswith(f" {part}")], (noun, part)
    for text, attribute in zip(found.attributes, ATTRIBUTES, strict=True):
        noun = next(noun for noun in NOUNS if attribute.part in ("whole", *NOUNS[noun]))
        prompt = f"a {text} {noun}" if attribute.part == "whole" else f"a {noun} with a {text}"
        assert parse(prompt).attributes == (attribute,)
    assert [str(parse(example)) for example in EXAMPLES] == list(EXAMPLES)


def test_the_default_comes_first_each_model_once_and_a_folder_has_the_licence_of_its_card(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("---\nlicense: mit\n---\nA model.")
    found = list_models("owner/one", ["owner/two", "builtin", "owner/one", str(tmp_path)])
    assert [model.id for model in found] == ["owner/one", "builtin", "owner/two", str(tmp_path)]
    assert [model.title for model in found[:3]] == ["one", "Builtin", "two"]
    assert [model.licence for model in found[1::2]] == ["Apache-2.0", "mit"]
