"""Use MV-Adapter over a Stable Diffusion 2.1 checkpoint as a prior that sees six sides of a shape at once.

An image model sees four views in one picture and knows nothing of their sides: a face may grow on each. This one
predicts the views of six cameras together, and is told which is which, so the sides agree.

Everything is as in its authors' published scripts: six views of 512 pixels, at azimuths 0, 45, 90, 180, 270, 315 and
elevation 0, orthographic, on grey; shapes span 0.5 of half sides of 0.55; one text for all views; and a schedule whose
signal-to-noise ratio falls further, to an eighth of the checkpoint's own at the last timestep::

    snr'_t = snr_t 8^(-t / (T - 1))         abar'_t = abar_t / (abar_t + (1 - abar_t) 8^(t / (T - 1)))

Sources: Huang et al. 2024, MV-Adapter: Multi-view consistent image generation made easy, and its published scripts
(cameras, background, schedule); Shi et al. 2024, MVDream: Multi-view diffusion for 3D generation (score distillation
with several views, one timestep for all).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from meshdeform.errors import ModelError, ShapeError
from meshdeform.priors.multiview.adapter_file import ADAPTER, find_adapter
from meshdeform.priors.multiview.network import attach, camera_planes
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.rendering.cameras import CameraRig
from meshdeform.rendering.shading import RenderStyle

if TYPE_CHECKING:
    from meshdeform.priors.model_files import ModelFiles
    from meshdeform.rendering.cameras import Cameras

__all__ = ["RIG", "MultiViewPrior", "shifted"]

RIG = CameraRig(azimuths_deg=(0.0, 45.0, 90.0, 180.0, 270.0, 315.0), elevation_deg=0.0, share=0.5 / 0.55)
"""The cameras of the published scripts."""

_SIDE = 64
"""Side of the latents: 512 pixels. Base networks for larger pictures see this size, too."""
_GREY = (0.5, 0.5, 0.5)
_SHIFT = 8.0


class MultiViewPrior(StableDiffusionPrior):
    """A Stable Diffusion 2.1 checkpoint with the adapter in its folder.

    Parameters and errors are those of `StableDiffusionPrior`; `ModelError` also if there is no adapter, or it does not
    fit. The identity has the adapter's file name and SHA-256 as `adapter` and `adapter_sha256`.
    """

    def __init__(
        self, model: str, *, device: str | torch.device = "cpu", revision: str = "", dtype: str = "auto"
    ) -> None:
        super().__init__(model, device=device, revision=revision, dtype=dtype)
        self.identity |= {"adapter": ADAPTER, "adapter_sha256": self._adapter.sha256()}

    def _load(self, files: ModelFiles) -> None:
        adapter = find_adapter(files)
        if adapter is None:
            raise ModelError(f"The model {files.model!r} has no {ADAPTER}.")
        super()._load(files)
        self._adapter = adapter
        shrink = self.image_size // self._latent_side
        self._latent_side = min(self._latent_side, _SIDE)
        self.image_size = shrink * self._latent_side
        self._encoder_of_cameras = attach(
            self._unet, adapter, views=len(RIG.azimuths_deg), shrink=shrink, model=files.model
        )
        self._features: tuple[tuple[float, ...], list[Tensor]] | None = None
        self.alphas_cumprod = shifted(self.alphas_cumprod)
        self.style = RenderStyle(view_size=self.image_size, supersample=1, shading="lambert", background=_GREY, rig=RIG)

    def _conditions(self, cameras: Cameras, texts: int) -> dict[str, Any]:
        """Return the features of the cameras, added at each resolution of the U-Net.

        Raises
        ------
        ShapeError
            There is not one camera for each view of the rig.
        """
        places = (*cameras.azimuths_deg, *cameras.elevation_deg)
        if len(cameras.azimuths_deg) != len(RIG.azimuths_deg):
            raise ShapeError(f"expected the {len(RIG.azimuths_deg)} cameras of the model, got {len(places) // 2}")
        if self._features is None or self._features[0] != places:
            planes = camera_planes(cameras.azimuths_deg, cameras.elevation_deg, self.image_size)
            self._features = places, self._encoder_of_cameras(planes.to(self.device, self.dtype))
        return {"down_intrablock_additional_residuals": [each.repeat(texts, 1, 1, 1) for each in self._features[1]]}


def shifted(alphas_cumprod: Tensor) -> Tensor:
    """Return abar' (T,) float32 of a schedule whose signal-to-noise ratio falls to an eighth at its end."""
    level = alphas_cumprod.double()
    growth = _SHIFT ** torch.linspace(0, 1, len(level), dtype=torch.float64, device=level.device)
    return (level / (level + (1 - level) * growth)).float()
