"""Use any Stable Diffusion 1 or 2 checkpoint as a prior, through diffusers.

::

    z0      = scaling_factor * E[posterior(2 image - 1)]
    eps_hat = uncond + s (text - uncond)             eps = sqrt(abar) v + sqrt(1 - abar) z_t   for v-prediction

The posterior's mean is used, not a sample: its standard deviation is about a ten-thousandth of the latents' for the
published autoencoders, far below the noise that score distillation adds, and the mean is deterministic.

Views have a background and a light that change with every view, as in the paper (`rendering/scenes.py`); they show
clay or the colours of the asset (`appearance`).

Sources: Rombach et al. 2022, section 3 (latents); Ho & Salimans 2022, eq. 6, in diffusers' convention of s;
Salimans & Ho 2022, appendix D (v-prediction).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from textwrap import shorten
from typing import TYPE_CHECKING, Any, cast

import torch
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import DependencyError, ModelError, PromptError, ShapeError, install_command
from meshdeform.priors.model_files import ModelFiles, find
from meshdeform.priors.precision import scaled_backward
from meshdeform.rendering.shading import RenderStyle

if TYPE_CHECKING:
    from meshdeform.rendering.cameras import Cameras

_PREDICTIONS = ("epsilon", "v_prediction")


class StableDiffusionPrior:
    """A Stable Diffusion checkpoint.

    `model`: folder in diffusers' layout, or hub id of a checkpoint in the local Hugging Face cache. Nothing is
    downloaded. `revision`: branch, tag or commit of a hub model; `dtype`, "auto", "float32", "float16" or "bfloat16":
    precision of the networks. `auto` is float32 on the CPU, bfloat16 on a GPU that supports it, else float16.
    Raises ModelError: the checkpoint is missing, incomplete or of another kind. Raises DependencyError: the extra `sd`
    is not installed.
    """

    def __init__(
        self,
        model: str,
        *,
        device: str | torch.device = "cpu",
        revision: str = "",
        dtype: str = "auto",
    ) -> None:
        self.device = torch.device(device)
        self.dtype = _dtype(dtype, self.device)
        files = find(model, revision, half=self.dtype is not torch.float32)
        self._load(files)
        self.identity = {"id": model, "revision": files.revision, "sha256": files.sha256()}

    def _load(self, files: ModelFiles) -> None:
        try:
            from diffusers import AutoencoderKL, DDPMScheduler, UNet2DConditionModel
            from transformers import CLIPTextModel, CLIPTokenizer
        except ImportError as error:
            raise DependencyError(
                f"Stable Diffusion models need a package that cannot be imported: {error}.",
                advice=f"Install the extra: {install_command('sd')}.",
            ) from error
        try:
            with _no_progress_bar():
                self._unet = self._network(UNet2DConditionModel, files, "unet")
                self._vae = self._network(AutoencoderKL, files, "vae")
                self._text_encoder = self._network(CLIPTextModel, files, "text_encoder")
            self._tokenizer = CLIPTokenizer.from_pretrained(files.folder / "tokenizer", local_files_only=True)
            scheduler = DDPMScheduler.from_pretrained(files.folder / "scheduler", local_files_only=True)
        except ModelError:
            raise
        except Exception as error:  # a broken file can raise anything in diffusers, transformers or safetensors
            raise ModelError(
                f"The model {files.model!r} cannot be read: {error}",
                advice="Download it again; one of its files is damaged or belongs to another kind of model.",
            ) from error
        self._prediction: str = scheduler.config.prediction_type
        self.num_timesteps = int(scheduler.config.num_train_timesteps)
        self.alphas_cumprod: Tensor = scheduler.alphas_cumprod.to(self.device, torch.float32)
        latents = self._vae.config.latent_channels
        if self._prediction not in _PREDICTIONS or self._unet.config.in_channels != latents:
            raise ModelError(
                f"The model {files.model!r} predicts {self._prediction} from {self._unet.config.in_channels} channels.",
                advice=f"Use a text-to-image checkpoint that predicts {' or '.join(_PREDICTIONS)} from {latents}.",
            )
        self._check_conditions(files.model)
        self._graphs: dict[tuple[torch.Size, ...], Callable[..., Tensor]] = {}
        shrink = 2 ** (len(self._vae.config.block_out_channels) - 1)
        self.image_size = _side(self._unet.config.sample_size, files.model) * shrink
        self.style = RenderStyle(view_size=self.image_size // 2, supersample=1, shading="lambert", scene="varied")

    def _check_conditions(self, model: str) -> None:
        """Refuse networks that need more than a text, or the text of another encoder."""
        unet, width = self._unet.config, self._text_encoder.config.hidden_size
        further = [name for name in ("addition_embed_type", "class_embed_type", "encoder_hid_dim_type") if unet[name]]
        if further:
            raise ModelError(
                f"The U-Net of the model {model!r} needs more than a text: its {further[0]} is {unet[further[0]]!r}.",
                advice="Use a text-to-image checkpoint of the Stable Diffusion 1 or 2 family.",
            )
        if unet.cross_attention_dim != width:
            raise ModelError(
                f"The U-Net of the model {model!r} reads texts of width {unet.cross_attention_dim}, and its text "
                f"encoder writes {width}.",
                advice="Download it again; its text_encoder and its unet are of different models.",
            )

    def _network(self, kind: Any, files: ModelFiles, name: str) -> Any:
        network, report = kind.from_pretrained(
            files.folder / name,
            variant=files.networks[name].variant or None,
            use_safetensors=True,
            local_files_only=True,
            dtype=self.dtype,
            output_loading_info=True,
        )
        # diffusers and transformers only log this, and continue with random numbers for missing tensors.
        if lacking := [*report["missing_keys"], *(str(entry) for entry in report["mismatched_keys"])]:
            raise ModelError(
                f"The weights in {name}/ of {files.model!r} lack {len(lacking)} tensors, such as {min(lacking)}.",
                advice="Download it again; its config.json and its weights do not belong together.",
            )
        return network.to(self.device).eval().requires_grad_(requires_grad=False)

    @torch.no_grad()
    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        """Return text embeddings (1 + others, tokens, E) of the prompt and of each other text.

        Raises PromptError: a text is too long for the text encoder.
        """
        limit, texts = self._tokenizer.model_max_length, [prompt, *others]
        for text in texts:
            length = len(self._tokenizer(text).input_ids)
            if length > limit:
                raise PromptError(
                    f"The text {shorten(text, 60)!r} has {length - 2} tokens; this model reads {limit - 2}.",
                    advice="Use fewer words.",
                )
        tokens = self._tokenizer(texts, padding="max_length", max_length=limit, return_tensors="pt").input_ids
        embedding: Tensor = self._text_encoder(tokens.to(self.device))[0]
        return embedding

    def encode_image(self, image: Tensor) -> Tensor:
        """Encode pictures as latents (B, C, H, W) float32, differentiably and deterministically.

        Pictures are resized to the model's size (bilinear, antialiased) if necessary. Raises ShapeError: `image` is not
        (B, 3, S, S).
        """
        if image.ndim != 4 or image.shape[1] != 3:
            raise ShapeError(f"expected pictures (B, 3, S, S), got {tuple(image.shape)}")
        image = image.to(self.device)
        if image.shape[2:] != (self.image_size, self.image_size):
            size = (self.image_size, self.image_size)
            image = functional.interpolate(image, size, mode="bilinear", align_corners=False, antialias=True)
        return scaled_backward(self._latents, image)

    def _latents(self, image: Tensor) -> Tensor:
        posterior = self._vae.encode((image * 2.0 - 1.0).to(self.dtype)).latent_dist
        latents: Tensor = posterior.mean.float() * self._vae.config.scaling_factor
        return latents

    @torch.no_grad()
    def predict_noise(
        self,
        z_t: Tensor,
        timestep: Tensor,
        embedding: Tensor,
        cameras: Cameras,  # noqa: ARG002
    ) -> tuple[Tensor, ...]:
        """Predict the noise in z_t for each text, all of them in one batch.

        `z_t` is (B, C, H, W) float32; `timestep` is (B,) int64; `embedding`, (N, tokens, E): rows of `encode_texts`;
        `cameras`: unused.
        """
        noisy, count = z_t.to(self.device), len(embedding)
        steps = timestep.to(self.device)
        embeddings = embedding.repeat_interleave(len(z_t), 0)
        inputs = noisy.to(self.dtype).repeat(count, 1, 1, 1)
        run = self._run_unet if self.device.type == "cpu" else self._replay_unet
        output = run(inputs, steps.repeat(count), embeddings)
        predictions: tuple[Tensor, ...] = output.to(torch.float32, copy=True).chunk(count)
        if self._prediction == "epsilon":
            return predictions
        level = self.alphas_cumprod[steps].view(-1, 1, 1, 1)
        signal, sigma = level.sqrt(), (1 - level).sqrt()
        return tuple(signal * velocity + sigma * noisy for velocity in predictions)

    def _run_unet(self, inputs: Tensor, steps: Tensor, embeddings: Tensor) -> Tensor:
        output: Tensor = self._unet(inputs, steps, encoder_hidden_states=embeddings).sample
        return output

    def _replay_unet(self, *inputs: Tensor) -> Tensor:
        """Run the U-Net as one CUDA graph: kernel by kernel, a GPU waits most of the time for the next launch."""
        # The next call overwrites the result.
        shapes = tuple(tensor.shape for tensor in inputs)
        if shapes not in self._graphs:
            samples = tuple(tensor.clone() for tensor in inputs)
            graphed = torch.cuda.make_graphed_callables(self._run_unet, samples)
            self._graphs[shapes] = cast("Callable[..., Tensor]", graphed)
        return self._graphs[shapes](*inputs)


def _dtype(name: str, device: torch.device) -> torch.dtype:
    """Return the torch dtype of a setting; `auto` is float32 on the CPU, else bfloat16 if supported, else float16."""
    if name != "auto":
        dtype: torch.dtype = getattr(torch, name)
        return dtype
    if device.type == "cpu":
        return torch.float32
    # bfloat16 has the range of float32, so nothing overflows.
    return torch.bfloat16 if torch.cuda.is_bf16_supported(including_emulation=False) else torch.float16


def _side(sample_size: Any, model: str) -> int:
    """Return the side of the latents from a U-Net's configuration: a number, or a pair of equal numbers."""
    sides = set(sample_size) if isinstance(sample_size, list | tuple) else {sample_size}
    if len(sides) != 1 or not all(isinstance(side, int) and side > 0 for side in sides):
        raise ModelError(
            f"The model {model!r} has the sample_size {sample_size!r} in unet/config.json, which is not square.",
            advice="Use a checkpoint for square pictures whose configuration gives their size, such as 64.",
        )
    side: int = sides.pop()
    return side


@contextmanager
def _no_progress_bar() -> Iterator[None]:
    """Keep transformers from printing its own progress bar on standard error."""
    from transformers.utils import logging

    shown = logging.is_progress_bar_enabled()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        if shown:
            logging.enable_progress_bar()
