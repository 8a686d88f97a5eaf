"""Compute CLIP R-precision: retrieval by a CLIP model that is independent of the guidance.

Views of lit clay on a light background are encoded, their unit vectors averaged, and the prompts ranked by cosine. A
CLIP model that shares its text encoder with the diffusion model would judge its own work, and is refused.

Sources: Radford et al. 2021 (CLIP); Park et al. 2021 and Jain et al. 2022, Dream Fields, section 4 (R-precision by a
model that was not optimised); Poole et al. 2023, DreamFusion, table 1 (its use for score distillation).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import DependencyError, ModelError, ParameterError, install_command
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from training.evaluation.retrieval import ranked

_AZIMUTHS_DEG = (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)
_ELEVATION_DEG = 20.0
_GROUND = (0.95, 0.95, 0.95)
_WEIGHTS = "model.safetensors"
_EMBEDDING = "token_embedding.weight"


class ClipJudge:
    """A CLIP model in a folder on this machine.

    Parameters
    ----------
    folder : Path
        As written by transformers' `CLIPModel.save_pretrained` and `CLIPProcessor.save_pretrained`, with
        `model.safetensors`.
    device : str

    Raises
    ------
    ModelError
        The model is missing or incomplete, or has no safetensors weights.
    DependencyError
        The extra `sd` is not installed.
    """

    def __init__(self, folder: Path, *, device: str = "cpu") -> None:
        weights = folder / _WEIGHTS
        if not weights.is_file():
            raise ModelError(
                f"There is no CLIP model with safetensors weights in {folder}.",
                advice="Give --clip a folder with config.json, model.safetensors and the tokenizer's files.",
            )
        try:
            from transformers import CLIPImageProcessor, CLIPModel, CLIPTokenizer
        except ImportError as error:
            raise DependencyError(
                f"CLIP R-precision needs a package that cannot be imported: {error}.",
                advice=f"Install the extra: {install_command('sd')}.",
            ) from error
        try:
            model, loading = CLIPModel.from_pretrained(
                folder, use_safetensors=True, local_files_only=True, output_loading_info=True
            )
            self._tokenizer = CLIPTokenizer.from_pretrained(folder, local_files_only=True)
            images = CLIPImageProcessor.from_pretrained(folder, local_files_only=True)
        except Exception as error:  # a broken file can raise anything in transformers or safetensors
            raise ModelError(
                f"The CLIP model in {folder} cannot be read: {error}",
                advice="Download it again; one of its files is damaged or belongs to another kind of model.",
            ) from error
        if lacking := [*loading["missing_keys"], *map(str, loading["mismatched_keys"])]:
            raise ModelError(
                f"The weights in {folder} lack {len(lacking)} tensors, such as {min(lacking)}.",
                advice="Download it again; its config.json and its weights do not belong together.",
            )
        self._device = torch.device(device)
        self._model = model.to(self._device).eval().requires_grad_(requires_grad=False)
        self._size = int(model.config.vision_config.image_size)
        self._mean = torch.tensor(images.image_mean).view(1, 3, 1, 1)
        self._std = torch.tensor(images.image_std).view(1, 3, 1, 1)
        self._cameras = fixed_cameras(_AZIMUTHS_DEG, _ELEVATION_DEG)
        self.identity = {"id": folder.name, "sha256": hashlib.sha256(weights.read_bytes()).hexdigest()}

    @torch.no_grad()
    def similarities(self, mesh: TriangleMesh, prompts: Sequence[str]) -> Tensor:
        """Return the cosine between each view and each prompt, (8, P) float32."""
        tokens = self._tokenizer(list(prompts), padding=True, truncation=True, return_tensors="pt").to(self._device)
        views = draw(mesh, self._cameras, self._size).permute(0, 3, 1, 2)
        pixels = ((views - self._mean) / self._std).to(self._device)
        text = functional.normalize(_vectors(self._model.get_text_features(**tokens)), dim=-1)
        image = functional.normalize(_vectors(self._model.get_image_features(pixel_values=pixels)), dim=-1)
        cosines: Tensor = (image @ text.T).float().cpu()
        return cosines

    def judgement(self, mesh: TriangleMesh, prompts: Sequence[str], prompt: str) -> dict[str, Any]:
        """Return rank, hit and probability of the prompt by the mean cosine, and the share of views that are hits.

        The probability is a softmax at the temperature that CLIP learned.
        """
        cosines = self.similarities(mesh, prompts)
        sharpness = float(self._model.logit_scale.exp())
        scores = dict(zip(prompts, (cosines.mean(0).double() * sharpness).tolist(), strict=True))
        index = list(prompts).index(prompt)
        return {
            **ranked(scores, prompt),
            "cosine": float(cosines[:, index].mean()),
            "views_hit": float((cosines.argmax(1) == index).double().mean()),
        }


@torch.no_grad()
def draw(mesh: TriangleMesh, cameras: Cameras, size: int) -> Tensor:
    """Render views (B, size, size, 3) float32 in [0, 1] of a mesh, centred and scaled to fill them."""
    verts, faces = verts_of(mesh), faces_of(mesh)
    used = verts[faces.reshape(-1)]
    centre = (used.amin(0) + used.amax(0)) / 2
    placed = (verts - centre) / (used - centre).norm(dim=1).max().clamp_min(1e-12)
    style = RenderStyle(view_size=size, supersample=2, shading="lambert", background=_GROUND)
    return Renderer(faces, len(verts), style).render(placed, cameras).clamp(0, 1)


def refuse_the_guides_own(folder: Path, model: str, revision: str = "") -> None:
    """Refuse a CLIP model with the same text encoder as the guiding diffusion model.

    Raises
    ------
    ParameterError
        The token embeddings are equal to the precision in which they are stored.
    ModelError
        The diffusion model is not on this machine.
    """
    from meshdeform.priors.model_files import find

    guide = find(model, revision).folder
    judge_embedding, guides = _embedding(folder), _embedding(guide / "text_encoder")
    same = judge_embedding is not None and guides is not None and judge_embedding.shape == guides.shape
    if same and torch.allclose(judge_embedding, guides, rtol=1e-2, atol=1e-4):  # type: ignore[arg-type]
        raise ParameterError(
            f"The CLIP model in {folder} has the same text encoder as the guidance: it would judge its own work.",
            advice="Give --clip another model: for Stable Diffusion 1 any but CLIP ViT-L/14.",
        )


def _embedding(folder: Path) -> Tensor | None:
    """Read the float32 token embeddings of a CLIP model or text encoder; return None if there are none."""
    from safetensors import safe_open

    for path in sorted(folder.glob("*.safetensors")):
        with safe_open(path, "pt") as file:
            for name in file.keys():  # noqa: SIM118 - not a dict
                if name.endswith(_EMBEDDING):
                    embedding: Tensor = file.get_tensor(name).float()
                    return embedding
    return None


def _vectors(features: Any) -> Tensor:
    """Return the projected vectors, which newer versions of transformers wrap with other outputs."""
    vectors: Tensor = getattr(features, "pooler_output", features)
    return vectors
