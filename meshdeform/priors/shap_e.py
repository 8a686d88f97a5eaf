"""Make meshes of prompts with Shap-E, through diffusers.

The pipeline samples a latent of the prompt; the latent becomes the weights of a small network, whose signed distances
on a grid become a mesh by marching cubes. Its meshes have +Z up; they are turned so that +Y is.

Source: Jun and Nichol 2023, Shap-E: Generating Conditional 3D Implicit Functions; the code and the published weights
are under the MIT licence.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from meshdeform.errors import DependencyError, ModelError, PromptError, install_command
from meshdeform.priors.stable_diffusion import no_progress_bar
from meshdeform.priors.text_to_3d import GeneratedMesh

__all__ = ["GRID", "ShapE"]

GRID = 128
"""Samples along each side of the volume, as published."""

_CHANNELS = ("R", "G", "B")


class ShapE:
    """A Shap-E pipeline (`meshdeform.priors.text_to_3d.TextTo3D`).

    Parameters
    ----------
    folder : Path
    device : str

    Raises
    ------
    ModelError
        A file of the model is damaged.
    DependencyError
        The extra `sd` is not installed.
    """

    def __init__(self, folder: Path, *, device: str) -> None:
        try:
            from diffusers import ShapEPipeline
        except ImportError as error:
            raise DependencyError(
                f"Text-to-3D models need a package that cannot be imported: {error}.",
                advice=f"Install the extra: {install_command('sd')}.",
            ) from error
        self._name = folder.name
        try:
            with no_progress_bar():
                pipeline: Any = ShapEPipeline.from_pretrained(folder, local_files_only=True, use_safetensors=True)
        except Exception as error:  # a broken file can raise anything in diffusers, transformers or safetensors
            raise ModelError(
                f"The model {str(folder)!r} cannot be read: {error}",
                advice="Download it again; one of its files is damaged or belongs to another kind of model.",
            ) from error
        pipeline.set_progress_bar_config(disable=True)
        self._pipeline = pipeline.to(device)
        self._device = torch.device(device)

    @torch.no_grad()
    def generate(self, prompt: str, *, seed: int, steps: int, guidance_scale: float) -> GeneratedMesh:
        """Return a mesh of a prompt, with +Y up (`TextTo3D.generate`)."""
        tokenizer = self._pipeline.tokenizer
        length, limit = len(tokenizer(prompt).input_ids), tokenizer.model_max_length
        if length > limit:
            raise PromptError(
                f"The prompt of the target has {length - 2} tokens; this model reads {limit - 2}.",
                advice="Use fewer words.",
            )
        latents = self._pipeline(
            prompt,
            generator=torch.Generator().manual_seed(seed),
            num_inference_steps=steps,
            guidance_scale=guidance_scale,
            output_type="latent",
        ).images
        renderer = self._pipeline.shap_e_renderer
        # The decoder fails with an unclear error later on if there is no surface.
        guard = renderer.mesh_decoder.register_forward_hook(self._require_surface)
        try:
            mesh = renderer.decode_to_mesh(latents[:1], self._device, grid_size=GRID)
        finally:
            guard.remove()
        verts = mesh.verts.double().cpu().numpy()
        found = mesh.vertex_channels or {}
        colors = torch.stack([found[name] for name in _CHANNELS], 1) if set(_CHANNELS) <= found.keys() else None
        return GeneratedMesh(
            np.stack([verts[:, 0], verts[:, 2], -verts[:, 1]], 1),
            mesh.faces.long().cpu().numpy(),
            None if colors is None else colors.clamp(0, 1).double().cpu().numpy(),
        )

    def _require_surface(self, _module: Any, _inputs: Any, output: Any) -> None:
        if len(output.faces) and bool(torch.isfinite(output.verts).all()):
            return
        raise ModelError(
            f"The mesh that {self._name} made is empty.",
            advice="Try another seed (params.seed), a simpler prompt, more steps or another guidance_scale of the "
            "target, or a model with trained weights.",
        )
