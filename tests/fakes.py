"""Provide fakes for tests and benchmarks.

`FakePrior` is a fast diffusion prior whose optimum is known. `build_tiny_stable_diffusion` writes a Stable Diffusion
checkpoint of the real classes with random weights.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.geometry.appearance import Appearance, Paint
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.rendering.views import combine_views

if TYPE_CHECKING:
    from meshdeform.rendering.cameras import Cameras


class FakePrior:
    """A pixel prior with one picture per camera: the ideal denoiser of a distribution with a single member.

    For the picture x (scaled to [-1, 1]) the best noise prediction is ``(z_t - sqrt(abar) x) / sqrt(1 - abar)``. The
    gradient of score distillation is then ``sqrt(abar (1 - abar)) (z0 - x)`` for any noise: it vanishes only at x and
    points away from it everywhere else, so that descent reaches x. The prompt and the guidance scale have no effect
    (both branches predict the same).

    Parameters
    ----------
    optimum : TriangleMesh, or (1, 3, S, S) float32 in [0, 1], optional
        A mesh, whose renders are the pictures, in the frame where the cameras see the unit sphere; or one picture for
        all cameras. Default: an upright spheroid, 0.5 wide and 1 tall.
    view_size : int
        Side of a mesh's renders in pixels.

    Attributes
    ----------
    prompts : list of tuple of str
        The texts of every call of `encode_texts`: the prompt and the others.
    timesteps : list of int
        The timestep of every call of `predict_noise`.
    """

    num_timesteps = 1000
    dtype = torch.float32

    def __init__(self, optimum: TriangleMesh | Tensor | None = None, *, view_size: int = 24) -> None:
        if optimum is None:
            sphere = icosphere(3)
            optimum = TriangleMesh(sphere.verts * [0.5, 1.0, 0.5], sphere.faces)
        self._optimum = optimum
        if isinstance(optimum, Tensor):
            view_size = optimum.shape[-1] // 2
            content = optimum.numpy().tobytes()
        else:
            content = optimum.verts.tobytes() + optimum.faces.tobytes()
        self.style = RenderStyle(view_size=view_size, supersample=1, shading="normals")
        self.alphas_cumprod = torch.linspace(0.999, 0.001, self.num_timesteps)
        self.identity = {"id": "fake", "revision": "", "sha256": hashlib.sha256(content).hexdigest()}
        self.prompts: list[tuple[str, ...]] = []
        self.timesteps: list[int] = []

    def picture(self, cameras: Cameras) -> Tensor:
        """Return the optimum as the cameras see it, (1, 3, S, S) float32 in [0, 1]."""
        if isinstance(self._optimum, Tensor):
            return self._optimum
        renderer = Renderer(faces_of(self._optimum), len(self._optimum.verts), self.style)
        with torch.no_grad():
            return combine_views(renderer.render(verts_of(self._optimum), cameras))

    def singles(self, cameras: Cameras) -> Tensor:
        """Return the optimum as seen by each camera, at the size of the 2x2 grid, (B, 3, S, S) float32."""
        if isinstance(self._optimum, Tensor):
            return self._optimum.expand(len(cameras.azimuths_deg), -1, -1, -1)
        style = replace(self.style, view_size=2 * self.style.view_size)
        renderer = Renderer(faces_of(self._optimum), len(self._optimum.verts), style)
        with torch.no_grad():
            return renderer.render(verts_of(self._optimum), cameras).permute(0, 3, 1, 2)

    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        """Record the call and return one dummy row (1,) per text."""
        self.prompts.append((prompt, *others))
        return torch.zeros(1 + len(others), 1)

    def encode_image(self, image: Tensor) -> Tensor:
        """Scale from [0, 1] to [-1, 1]."""
        return image * 2.0 - 1.0

    @torch.no_grad()
    def predict_noise(
        self,
        z_t: Tensor,
        timestep: Tensor,
        embedding: Tensor,
        cameras: Cameras,
    ) -> tuple[Tensor, ...]:
        """Return the noise that leads back to the optimum, the same for every text."""
        self.timesteps += timestep.tolist()
        level = self.alphas_cumprod[timestep].view(-1, 1, 1, 1)
        picture = self.picture(cameras) if len(z_t) == 1 and len(cameras.azimuths_deg) > 1 else self.singles(cameras)
        noise = (z_t - level.sqrt() * self.encode_image(picture)) / (1 - level).sqrt()
        return (noise,) * len(embedding)


def build_tiny_stable_diffusion(
    folder: str | Path,
    *,
    edition: Literal[1, 2] = 1,
    prediction_type: Literal["epsilon", "v_prediction"] = "epsilon",
    sample_size: int = 16,
    seed: int = 0,
) -> Path:
    """Write a checkpoint of Stable Diffusion's own classes with random weights, about 4 MB.

    Needs the extra `sd`. The tokenizer is CLIP's, over single bytes. Encoding and prediction take milliseconds; the
    predictions are meaningless.

    Parameters
    ----------
    folder : str or pathlib.Path
        The folder to write, in diffusers' layout with safetensors weights.
    edition : 1 or 2
        Which Stable Diffusion the networks are like: 2 has a head size for each level, linear projections, attention at
        the fine level, and another activation in the text encoder.
    prediction_type : "epsilon" or "v_prediction"
        The scheduler's `prediction_type`. The weights do not depend on it.
    sample_size : int
        Side of the latents. Pictures have eight times that (Stable Diffusion: 64 and 512).
    seed : int
        Seed of the weights. The caller's random state does not change.
    """
    from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
    from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

    with tempfile.TemporaryDirectory() as scratch:
        vocabulary = _write_byte_tokenizer(Path(scratch))
        tokenizer = CLIPTokenizer.from_pretrained(scratch, model_max_length=77)
    # Attention at the coarse level makes smaller weights; at the fine one, it is where the published networks have it.
    levels: dict[str, tuple[str, ...]] = {
        "down": ("DownBlock2D", "CrossAttnDownBlock2D")[:: 1 if edition == 1 else -1],
        "up": ("CrossAttnUpBlock2D", "UpBlock2D")[:: 1 if edition == 1 else -1],
    }
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        text_encoder = CLIPTextModel(
            CLIPTextConfig(
                vocab_size=len(vocabulary), hidden_size=32, intermediate_size=37, num_hidden_layers=2,
                num_attention_heads=4, projection_dim=32, max_position_embeddings=77,
                hidden_act="quick_gelu" if edition == 1 else "gelu",
                bos_token_id=vocabulary[_START], eos_token_id=vocabulary[_END], pad_token_id=vocabulary[_END],
            )
        )  # fmt: skip
        unet = UNet2DConditionModel(
            sample_size=sample_size, in_channels=4, out_channels=4, block_out_channels=(32, 64), layers_per_block=1,
            down_block_types=levels["down"], up_block_types=levels["up"],
            cross_attention_dim=32, norm_num_groups=8,
            attention_head_dim=8 if edition == 1 else (4, 8), use_linear_projection=edition == 2,
        )  # fmt: skip
        vae = AutoencoderKL(
            down_block_types=("DownEncoderBlock2D",) * 4, up_block_types=("UpDecoderBlock2D",) * 4,
            block_out_channels=(8, 8, 16, 16), layers_per_block=1, norm_num_groups=4, latent_channels=4,
            sample_size=8 * sample_size,
        )  # fmt: skip
    scheduler = DDIMScheduler(
        beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear", clip_sample=False,
        set_alpha_to_one=False, steps_offset=1, prediction_type=prediction_type,
    )  # fmt: skip
    folder = Path(folder)
    parts = {"scheduler": scheduler, "text_encoder": text_encoder, "tokenizer": tokenizer, "unet": unet, "vae": vae}
    index: dict[str, object] = {"_class_name": "StableDiffusionPipeline", "requires_safety_checker": False}
    for name, part in parts.items():
        part.save_pretrained(folder / name)
        index[name] = [type(part).__module__.partition(".")[0], type(part).__name__]
    index |= {name: [None, None] for name in ("safety_checker", "feature_extractor", "image_encoder")}
    (folder / "model_index.json").write_text(json.dumps(index, indent=2))
    return folder


_START, _END = "<|startoftext|>", "<|endoftext|>"


def _write_byte_tokenizer(folder: Path) -> dict[str, int]:
    """Write CLIP's vocabulary of single bytes, inside and at the end of a word, without merges."""
    printable = [*range(33, 127), *range(161, 173), *range(174, 256)]
    others = [byte for byte in range(256) if byte not in printable]
    letters = [chr(byte) for byte in printable] + [chr(256 + n) for n in range(len(others))]
    words = [*letters, *(letter + "</w>" for letter in letters), _START, _END]
    vocabulary = {word: number for number, word in enumerate(words)}
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    return vocabulary


def plain_appearance(vertices: int, triangles: NDArray[np.int64]) -> Appearance:
    """Return the look of neutral clay for a surface of `vertices` vertices and (T, 3) triangles."""
    return Appearance(
        np.arange(vertices),
        triangles,
        np.zeros((vertices, 2), np.float32),
        np.ones((vertices, 4), np.float32),
        np.zeros(len(triangles), np.int64),
        (Paint(),),
    )
