"""Every form in which Stable Diffusion checkpoints lie on disks, the whole way through the command line and a service.

The networks are of the real classes, small and with random weights; the files around them have the published forms.
"""

from __future__ import annotations

import json
import shutil
import uuid
from collections.abc import Callable
from pathlib import Path

import pytest
import safetensors.torch
import torch
from typer.testing import CliRunner

from meshdeform.assets import build_glb
from meshdeform.cli.app import app
from meshdeform.errors import ModelError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from tests.cases import each_case
from tests.fakes import build_tiny_stable_diffusion

SCHEDULER = {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear", "num_train_timesteps": 1000}
PNDM = SCHEDULER | {"_class_name": "PNDMScheduler", "skip_prk_steps": True, "set_alpha_to_one": False}
DDIM = SCHEDULER | {"_class_name": "DDIMScheduler", "clip_sample": False, "steps_offset": 1}
VELOCITY = DDIM | {"prediction_type": "v_prediction"}
EULER = SCHEDULER | {"_class_name": "EulerDiscreteScheduler", "timestep_spacing": "trailing"}
DISTILLED = ("distilled for a few steps", "distilled from")
TAKEN = ("sd15", "sd21-base", "sd21-v", "zero-snr", "sd21-fp16", "sd15-parts")


def change(path: Path, **members: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | members))


def in_half_precision(folder: Path) -> None:
    """Leave the fp16 files alone, as `hf download --include "*.fp16.safetensors"` does."""
    for path in [*folder.glob("*/model.safetensors"), *folder.glob("*/diffusion_pytorch_model.safetensors")]:
        tensors = {name: tensor.half() for name, tensor in safetensors.torch.load_file(path).items()}
        safetensors.torch.save_file(tensors, path.with_suffix(".fp16.safetensors"), {"format": "pt"})
        path.unlink()


def in_parts(folder: Path) -> None:
    """Split the U-Net's weights into two files with an index."""
    path = folder / "unet" / "diffusion_pytorch_model.safetensors"
    tensors = safetensors.torch.load_file(path)
    placed = {name: f"part-{number % 2}.safetensors" for number, name in enumerate(sorted(tensors))}
    for part in set(placed.values()):
        chosen = {name: tensors[name] for name in tensors if placed[name] == part}
        safetensors.torch.save_file(chosen, path.with_name(part), {"format": "pt"})
    path.with_name(f"{path.name}.index.json").write_text(json.dumps({"metadata": {}, "weight_map": placed}))
    path.unlink()


@pytest.fixture(scope="session")
def layouts(tiny_stable_diffusion: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of checkpoints, named as in `TAKEN`."""
    place = tmp_path_factory.mktemp("layouts")
    second = build_tiny_stable_diffusion(place / "sd21-base", edition=2, sample_size=8)

    def like(model: Path, name: str, scheduler: dict[str, object]) -> Path:
        folder = model if model.name == name else shutil.copytree(model, place / name)
        (folder / "scheduler" / "scheduler_config.json").write_text(json.dumps(scheduler))
        return folder

    like(second, "sd21-base", PNDM | {"prediction_type": "epsilon"})
    change(like(second, "sd21-v", VELOCITY) / "unet" / "config.json", sample_size=12)
    like(second, "zero-snr", VELOCITY | {"rescale_betas_zero_snr": True, "timestep_spacing": "trailing"})
    in_half_precision(like(second, "sd21-fp16", DDIM))
    first = like(tiny_stable_diffusion, "sd15", PNDM)
    change(
        first / "model_index.json",
        safety_checker=["stable_diffusion", "StableDiffusionSafetyChecker"],
        feature_extractor=["transformers", "CLIPImageProcessor"],
    )
    in_parts(like(first, "sd15-parts", PNDM))
    assert {path.name for path in place.iterdir()} == set(TAKEN)
    return place


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh = icosphere(1)
    path = tmp_path_factory.mktemp("ball") / "ball.glb"
    path.write_bytes(build_glb(mesh.verts, mesh.faces))
    return path


def test_each_layout_goes_through_run(layouts: Path, ball: Path, tmp_path: Path) -> None:
    moved = {}
    for name in TAKEN:
        out = tmp_path / f"{name}.glb"
        given = ["run", str(ball), "a pear", "--model", str(layouts / name), "-o", str(out), "--steps", "1"]
        done = CliRunner().invoke(app, [*given, "--preset", "preview", "--param", "safeguard=none", "--json", "-q"])
        assert done.exit_code == 0, done.output
        assert json.loads(done.stdout)["steps"] == 1
        moved[name] = out.read_bytes()
    # The same weights in several files make the same result; another edition, schedule or precision another one.
    assert moved["sd15-parts"] == moved["sd15"]
    assert len(set(moved.values())) == len(TAKEN) - 1


def test_a_schedule_that_ends_in_pure_noise_gives_finite_noise(layouts: Path) -> None:
    """At the last timestep nothing of the picture is left, and the velocity is minus the picture."""
    prior = StableDiffusionPrior(str(layouts / "zero-snr"))
    assert float(prior.alphas_cumprod[-1]) == pytest.approx(0, abs=1e-6)
    z_t = torch.randn(1, 4, 8, 8, generator=torch.Generator().manual_seed(0))
    (noise,) = prior.predict_noise(z_t, torch.tensor([999]), prior.encode_texts("a pear"), None)  # type: ignore[arg-type]
    assert torch.allclose(noise, z_t, atol=1e-2)


def scheduled(folder: Path, **more: object) -> None:
    (folder / "scheduler" / "scheduler_config.json").write_text(json.dumps(EULER | more))


def xl_network(folder: Path) -> None:
    """A U-Net that also reads sizes, as SDXL's does, under the name of the older pipeline."""
    from diffusers import UNet2DConditionModel

    config = UNet2DConditionModel.load_config(folder / "unet")
    added = {
        "addition_embed_type": "text_time",
        "addition_time_embed_dim": 8,
        "projection_class_embeddings_input_dim": 80,
    }
    UNet2DConditionModel.from_config(config, **added).save_pretrained(folder / "unet")


def another_text_encoder(folder: Path) -> None:
    from transformers import CLIPTextConfig, CLIPTextModel

    config = CLIPTextConfig.from_pretrained(folder / "text_encoder").to_dict() | {"hidden_size": 48}
    CLIPTextModel(CLIPTextConfig(**config)).save_pretrained(folder / "text_encoder")


@each_case(
    ("spoil", "message", "advice"),
    [
        (
            lambda folder: change(folder / "model_index.json", _class_name="StableDiffusionXLPipeline"),
            "is a StableDiffusionXLPipeline",
            "names StableDiffusionPipeline",
        ),
        (lambda folder: change(folder / "unet/config.json", _name_or_path="a/sd-turbo"), *DISTILLED),
        (lambda folder: scheduled(folder, _class_name="LCMScheduler"), *DISTILLED),
        (lambda folder: change(folder / "unet/config.json", time_cond_proj_dim=256), *DISTILLED),
        (xl_network, "addition_embed_type is 'text_time'", "Stable Diffusion 1 or 2"),
        (another_text_encoder, "texts of width 32, and its text encoder writes 48", "different models"),
    ],
)
def test_what_cannot_work_is_refused_before_the_first_step(
    layouts: Path, tmp_path: Path, spoil: Callable[[Path], None], message: str, advice: str
) -> None:
    copy = shutil.copytree(layouts / "sd21-base", tmp_path / uuid.uuid4().hex)
    spoil(copy)
    with pytest.raises(ModelError, match=message) as caught:
        load_prior(str(copy), device="cpu")
    assert advice in caught.value.advice_text


@pytest.mark.parametrize("name", ["v1-5-pruned-emaonly.safetensors", "v2-1_512-ema-pruned.ckpt"])
def test_a_single_file_is_refused_with_the_command_that_converts_it(name: str, ball: Path, tmp_path: Path) -> None:
    file = tmp_path / name
    if file.suffix == ".safetensors":
        weights = {"model.diffusion_model.input_blocks.0.0.weight": torch.zeros(2)}
        safetensors.torch.save_file(weights, file)
    else:
        file.write_bytes(b"PK\x03\x04")
    done = CliRunner().invoke(app, ["run", str(ball), "a pear", "--model", str(file), "-o", str(tmp_path / "out.glb")])
    assert done.exit_code != 0
    words = " ".join(done.output.split())
    assert "from_single_file" in words
    assert "save_pretrained" in words
    assert ("can run any code" in words) is (file.suffix == ".ckpt")
    assert not (tmp_path / "out.glb").exists()
