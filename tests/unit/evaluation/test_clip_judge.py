"""CLIP R-precision with a CLIP model of the real class, tiny and with random weights."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import torch

from meshdeform.errors import ModelError, ParameterError
from tests.fakes import build_tiny_stable_diffusion
from tests.unit.evaluation.tiny_clip import build_tiny_clip
from training.evaluation.clip_judge import ClipJudge, draw, refuse_the_guides_own
from training.shapes import box

pytestmark = pytest.mark.training

PROMPTS = ("a giraffe", "a dragon", "an octopus")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_tiny_clip(tmp_path_factory.mktemp("clip"))


def test_the_picture_is_what_transformers_own_processor_makes_of_it(folder: Path) -> None:
    from transformers import CLIPImageProcessor, CLIPModel, CLIPTokenizer

    from meshdeform.rendering.cameras import fixed_cameras

    judge, mesh = ClipJudge(folder), box(2)
    view = draw(mesh, fixed_cameras((0.0,), 20.0), 32)[0]
    processor = CLIPImageProcessor.from_pretrained(folder)
    pixels = processor(view.permute(2, 0, 1), do_rescale=False, return_tensors="pt").pixel_values
    model = CLIPModel.from_pretrained(folder).eval()
    tokens = CLIPTokenizer.from_pretrained(folder)(list(PROMPTS), padding=True, return_tensors="pt")
    with torch.no_grad():
        logits = model(pixel_values=pixels, **tokens).logits_per_image[0] / model.logit_scale.exp()
    assert judge.similarities(mesh, PROMPTS)[0].tolist() == pytest.approx(logits.tolist(), abs=1e-3)


def test_a_damaged_model_is_refused(folder: Path, tmp_path: Path) -> None:
    broken = shutil.copytree(folder, tmp_path / "broken")
    (broken / "model.safetensors").write_bytes(b"nothing")
    with pytest.raises(ModelError, match="cannot be read"):
        ClipJudge(broken)


def test_the_guides_own_text_encoder_may_not_judge(folder: Path, tmp_path: Path) -> None:
    guide = tmp_path / "guide"
    build_tiny_stable_diffusion(guide)
    refuse_the_guides_own(folder, str(guide))
    with pytest.raises(ParameterError, match="judge its own work"):
        refuse_the_guides_own(guide / "text_encoder", str(guide))
