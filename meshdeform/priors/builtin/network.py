"""Define the network of the builtin prior: a small convolutional U-Net, conditioned on prompt and azimuth.

It predicts the clean picture of a noisy one, 128 x 128 pixels with three channels of camera-space normals in [-1, 1]:
a 2 x 2 grid of four views, azimuth a + {0, 90, 180, 270} degrees, 64 pixels each, or a single view. Single views are
marked by a learned vector and a learned position map. A strided stem reduces the picture to 32 x 32 at once and a pixel
shuffle restores its size, so a forward pass is cheap on one core.

Sources: Ho et al. 2020 (DDPM), Dhariwal & Nichol 2021 (adaptive group norm), Salimans & Ho 2022
(v-prediction, eq. 11), Ho & Salimans 2022 (classifier-free guidance), Shi et al. 2016 (pixel shuffle).

Its weights are half precision safetensors that record their vocabulary.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn import functional

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.vocabulary import SEQUENCE_LENGTH, VOCABULARY
from meshdeform.priors.builtin.weights_file import MAX_FILE_BYTES, check
from meshdeform.support.files import write_files

IMAGE_SIZE = 128
_CAMERA_CHANNELS = 8
_HEADS = 4
WEIGHTS = Path(__file__).parent / "weights" / "prior.safetensors"
_LARGEST = 512

_ADVICE = (
    "Install meshdeform again (the weights are part of the package), or train them: python -m training.prior.train."
)


@dataclass(frozen=True)
class ModelConfig:
    """Sizes of the network; the defaults are those of the shipped weights."""

    channels: tuple[int, int, int] = (48, 96, 160)
    embedding: int = 192
    heads: int = 4
    text_layers: int = 2
    text_width: int = 128


def null_tokens(batch: int) -> Tensor:
    """Return the tokens of the empty prompt: (batch, SEQUENCE_LENGTH) int64 of padding."""
    return torch.zeros(batch, SEQUENCE_LENGTH, dtype=torch.int64)


def camera_map(azimuth_deg: Tensor, single: Tensor | None, side: int) -> Tensor:
    """Return each pixel's position in its view and the azimuth of that view.

    `azimuth_deg`, (B,) float32: azimuth of the first or only view, degrees. `single`, (B,) bool: whether each picture
    is a single view; by default none is. Returns (B, 8, side, side) float32: sin a, cos a, x, y, x sin a, x cos a, y
    sin a, y cos a; x to the right and y downward, both from -1 to 1 across the view.
    """
    device = azimuth_deg.device
    whole = (torch.arange(side, device=device) + 0.5) / side * 2 - 1
    half = (2 * whole + 1).where(whole < 0, 2 * whole - 1)
    second = (whole > 0).float()
    view = second[None, :] + 2 * second[:, None]
    if single is None:
        single = torch.zeros(len(azimuth_deg), dtype=torch.bool, device=device)
    alone = single[:, None, None]
    angle = torch.deg2rad(azimuth_deg.float())[:, None, None] + (math.pi / 2) * view.where(~alone, 0.0)
    across = whole.where(alone, half).expand_as(angle)
    down = whole[:, None].where(alone, half[:, None]).expand_as(angle)
    sine, cosine = angle.sin(), angle.cos()
    channels = [sine, cosine, across, down, across * sine, across * cosine, down * sine, down * cosine]
    return torch.stack(channels, 1)


class TextEncoder(nn.Module):
    """Encoder of token numbers (B, SEQUENCE_LENGTH) as one vector (B, width) per prompt.

    Word and position embeddings, a small transformer and a mean over the words present. A prompt without words has its
    own learned vector.
    """

    def __init__(self, width: int, layers: int, out: int) -> None:
        super().__init__()
        self.word = nn.Embedding(len(VOCABULARY), width)
        self.position = nn.Parameter(torch.randn(SEQUENCE_LENGTH, width) * 0.02)
        self.blocks = nn.ModuleList(TextBlock(width) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        self.project = nn.Linear(width, out)
        self.nothing = nn.Parameter(torch.zeros(out))

    def forward(self, tokens: Tensor) -> Tensor:
        """Encode token numbers (B, SEQUENCE_LENGTH) as vectors (B, out), differentiably in the embeddings."""
        present = tokens > 0
        # The first position is never masked, so that a row of padding attends to something.
        visible = present.clone()
        visible[:, 0] = True
        x = self.word(tokens) + self.position
        for block in self.blocks:
            x = block(x, visible)
        x = self.norm(x)
        pooled = (x * visible[..., None]).sum(1) / visible.sum(1, keepdim=True)
        return torch.where(present.any(1, keepdim=True), self.project(pooled), self.nothing)


class TextBlock(nn.Module):
    """Pre-norm self-attention and a two-layer perceptron."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm_attention = nn.LayerNorm(width)
        self.qkv = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)
        self.norm_mlp = nn.LayerNorm(width)
        self.mlp = nn.Sequential(nn.Linear(width, 2 * width), nn.SiLU(), nn.Linear(2 * width, width))

    def forward(self, x: Tensor, visible: Tensor) -> Tensor:
        """Transform (B, N, C), where `visible` (B, N) marks the words that may be attended to."""
        batch, length, width = x.shape
        qkv = self.qkv(self.norm_attention(x)).reshape(batch, length, 3, _HEADS, width // _HEADS)
        query, key, value = qkv.permute(2, 0, 3, 1, 4).unbind(0)
        mixed = functional.scaled_dot_product_attention(query, key, value, attn_mask=visible[:, None, None, :])
        x = x + self.out(mixed.transpose(1, 2).reshape(batch, length, width))
        mlp: Tensor = self.mlp(self.norm_mlp(x))
        return x + mlp


class ResidualBlock(nn.Module):
    """Two convolutions; the condition scales and shifts the second group norm (adaptive group norm)."""

    def __init__(self, inner: int, outer: int, embedding: int) -> None:
        super().__init__()
        self.norm_in = nn.GroupNorm(8, inner)
        self.conv_in = nn.Conv2d(inner, outer, 3, padding=1)
        self.condition = nn.Linear(embedding, 2 * outer)
        self.norm_out = nn.GroupNorm(8, outer)
        self.conv_out = nn.Conv2d(outer, outer, 3, padding=1)
        self.skip = nn.Conv2d(inner, outer, 1) if inner != outer else nn.Identity()
        nn.init.zeros_(self.conv_out.weight)
        nn.init.zeros_(self.conv_out.bias)  # type: ignore[arg-type]  # a convolution with a bias has one

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """Map (B, inner, H, W) to (B, outer, H, W)."""
        h = self.conv_in(functional.silu(self.norm_in(x)))
        scale, shift = self.condition(condition)[:, :, None, None].chunk(2, dim=1)
        h = self.norm_out(h) * (1 + scale) + shift
        result: Tensor = self.skip(x) + self.conv_out(functional.silu(h))
        return result


class AttentionBlock(nn.Module):
    """Self-attention over all pixels, which connects the four views of an object."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = nn.GroupNorm(8, channels)
        self.qkv = nn.Conv2d(channels, 3 * channels, 1)
        self.out = nn.Conv2d(channels, channels, 1)
        nn.init.zeros_(self.out.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) to the same shape."""
        batch, channels, height, width = x.shape
        qkv = self.qkv(self.norm(x)).reshape(batch, 3, self.heads, channels // self.heads, height * width)
        query, key, value = qkv.transpose(-1, -2).unbind(1)
        mixed = functional.scaled_dot_product_attention(query, key, value)
        result: Tensor = x + self.out(mixed.transpose(-1, -2).reshape(batch, channels, height, width))
        return result


class PriorNetwork(nn.Module):
    """Predictor of the clean grid of views, or the clean single view, of a noisy one."""

    def __init__(self, config: ModelConfig | None = None) -> None:
        super().__init__()
        self.config = config or ModelConfig()
        c0, c1, c2 = self.config.channels
        e, heads = self.config.embedding, self.config.heads
        self.text = TextEncoder(self.config.text_width, self.config.text_layers, e)
        self.azimuth = nn.Linear(4, e)
        self.time = nn.Sequential(nn.Linear(64, e), nn.SiLU(), nn.Linear(e, e))
        self.stem = nn.Conv2d(3, c0, 8, stride=4, padding=2)
        self.down0 = ResidualBlock(c0, c0, e)
        self.pool0 = nn.Conv2d(c0, c1, 3, stride=2, padding=1)
        self.down1 = nn.ModuleList([ResidualBlock(c1, c1, e), ResidualBlock(c1, c1, e)])
        self.pool1 = nn.Conv2d(c1, c2, 3, stride=2, padding=1)
        self.middle = nn.ModuleList(ResidualBlock(c2, c2, e) for _ in range(3))
        self.attention = nn.ModuleList(AttentionBlock(c2, heads) for _ in range(2))
        # The position of a pixel in the picture determines its view.
        self.place = nn.Parameter(torch.zeros(1, c2, IMAGE_SIZE // 16, IMAGE_SIZE // 16))
        # Additional conditions of a single view; initially zero, so that weights without them keep their meaning.
        self.single = nn.Parameter(torch.zeros(e))
        self.single_place = nn.Parameter(torch.zeros(1, c2, IMAGE_SIZE // 16, IMAGE_SIZE // 16))
        # Which side of a view shows the front depends on position and azimuth together. With conditions that are equal
        # for all pixels, the network did not learn this product: the first edition confused left and right.
        self.camera_fine = nn.Conv2d(_CAMERA_CHANNELS, c0, 1)
        self.camera_coarse = nn.Conv2d(_CAMERA_CHANNELS, c2, 1)
        for layer in (self.camera_fine, self.camera_coarse):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]  # a convolution with a bias has one
        self.up1 = nn.ModuleList([ResidualBlock(c2 + c1, c1, e), ResidualBlock(c1, c1, e)])
        self.up0 = nn.ModuleList([ResidualBlock(c1 + c0, c0, e), ResidualBlock(c0, c0, e)])
        self.norm = nn.GroupNorm(8, c0)
        self.activation = nn.SiLU()
        self.out = nn.Conv2d(c0, 3 * 16, 3, padding=1)
        nn.init.zeros_(self.out.weight)

    def forward(
        self, x: Tensor, timestep: Tensor, text: Tensor, azimuth_deg: Tensor, single: Tensor | None = None
    ) -> Tensor:
        """Predict x0.

        `x`, (B, 3, 128, 128) float32: noisy picture, [-1, 1] before noise; `timestep`, (B,) int64: 0 .. 999. `text`,
        (B, embedding) float32: output of `self.text`; encoded once per job, not once per step. `azimuth_deg`, (B,)
        float32: azimuth of the first or only view, degrees. `single`, (B,) bool: whether each picture is a single view;
        by default none is. Returns (B, 3, 128, 128) float32, whatever the layers compute in (`computing_in`).
        """
        condition, dtype = self._condition(timestep, text, azimuth_deg), self.place.dtype
        if single is not None:
            condition = condition + single[:, None] * self.single
        condition = functional.silu(condition).to(dtype)
        cameras = camera_map(azimuth_deg, single, IMAGE_SIZE // 4).to(dtype)
        h0 = self.down0(self.stem(x.to(dtype)) + self.camera_fine(cameras), condition)
        h1 = self.pool0(h0)
        for block in self.down1:
            h1 = block(h1, condition)
        h = self.pool1(h1) + self.place + self.camera_coarse(functional.avg_pool2d(cameras, 4))
        if single is not None:
            h = h + single[:, None, None, None] * self.single_place
        h = self.attention[0](self.middle[0](h, condition))
        h = self.attention[1](self.middle[1](h, condition))
        h = self.middle[2](h, condition)
        h = torch.cat([functional.interpolate(h, scale_factor=2.0), h1], 1)
        for block in self.up1:
            h = block(h, condition)
        h = torch.cat([functional.interpolate(h, scale_factor=2.0), h0], 1)
        for block in self.up0:
            h = block(h, condition)
        return functional.pixel_shuffle(self.out(self.activation(self.norm(h))).float(), 4)

    def computing_in(self, dtype: torch.dtype) -> PriorNetwork:
        """Convert the layers on pictures, in place; texts, times and azimuths, which cost nothing, stay in float32."""
        for name, layer in self.named_children():
            if name not in ("text", "time", "azimuth"):
                layer.to(dtype)
        for position in (self.place, self.single_place):
            position.data = position.data.to(dtype)
        return self

    def _condition(self, timestep: Tensor, text: Tensor, azimuth_deg: Tensor) -> Tensor:
        frequency = torch.exp(-math.log(1e4) * torch.arange(32, device=timestep.device) / 32)
        phase = timestep[:, None].float() * frequency
        angle = torch.deg2rad(azimuth_deg.float())
        # The first and second harmonic separate front from back, and side from front.
        turn = torch.stack([angle.sin(), angle.cos(), (2 * angle).sin(), (2 * angle).cos()], 1)
        condition: Tensor = self.time(torch.cat([phase.sin(), phase.cos()], 1)) + text + self.azimuth(turn)
        return condition


def vocabulary_hash() -> str:
    """Hash the token numbering of this grammar; weights of another numbering misread every prompt."""
    return hashlib.sha256(" ".join(VOCABULARY).encode()).hexdigest()[:16]


def write_weights(path: Path, state: Mapping[str, Tensor], config: ModelConfig, provenance: Mapping[str, str]) -> None:
    """Write the weights of a network as float16, atomically; `provenance`: metadata about the training."""
    metadata = {
        **provenance,
        "config": json.dumps(asdict(config)),
        "vocabulary": vocabulary_hash(),
        "words": " ".join(VOCABULARY),
    }
    halved = {name: tensor.detach().half().contiguous() for name, tensor in state.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_files({path: _in_order(save(halved, metadata))})


def _in_order(data: bytes) -> bytes:
    """Return safetensors with the header sorted by name: the library writes metadata in another order each time."""
    length = int.from_bytes(data[:8], "little")
    header = json.dumps(json.loads(data[8 : 8 + length]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)  # tensors begin at a multiple of 8
    return len(header).to_bytes(8, "little") + header + data[8 + length :]


def _config(metadata: Mapping[str, str]) -> ModelConfig:
    """Return the sizes of a network; a file from elsewhere must not make an enormous one."""
    document = json.loads(metadata["config"])
    config = ModelConfig(**{**document, "channels": tuple(document["channels"])})
    sizes = [*config.channels, *(value for name, value in asdict(config).items() if name != "channels")]
    if len(config.channels) != 3 or not all(isinstance(size, int) and 0 < size <= _LARGEST for size in sizes):
        raise ValueError(f"its sizes are not from 1 to {_LARGEST}")
    return config


def read_network(path: Path = WEIGHTS) -> tuple[PriorNetwork, dict[str, str]]:
    """Read the network in float32 for inference, and the file's metadata.

    Raises ModelError: the file is missing or too large, not safetensors, of another vocabulary, or its tensors are not
    those of the network, or not finite.
    """
    state, metadata = read_tensors(path)
    check(path)
    try:
        network = PriorNetwork(_config(metadata))
        network.load_state_dict(state)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:300]
        raise ModelError(f"The weights in {path} do not fit the network: {reason}", advice=_ADVICE) from error
    if not all(bool(tensor.isfinite().all()) for tensor in network.state_dict().values()):
        raise ModelError(f"The weights in {path} contain numbers that are not finite.", advice=_ADVICE)
    network.eval().requires_grad_(requires_grad=False)
    return network.to(memory_format=torch.channels_last), metadata  # type: ignore[call-overload]


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read the tensors, floating-point ones in float32, and the metadata of a file of weights of any vocabulary.

    Raises ModelError: the file is missing or not safetensors.
    """
    if not path.is_file():
        raise ModelError(
            f"The builtin prior's weights are missing: there is no {path.name} in {path.parent}.", advice=_ADVICE
        )
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise ModelError(
            f"The file {path} has {size:,} bytes; weights have at most {MAX_FILE_BYTES:,}.", advice=_ADVICE
        )
    try:
        with safe_open(path, framework="pt") as file:
            metadata = dict(file.metadata() or {})
            loaded = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
    except SafetensorError as error:
        raise ModelError(f"The builtin prior's weights in {path} cannot be read: {error}.", advice=_ADVICE) from error
    return {name: t.float() if t.is_floating_point() else t for name, t in loaded.items()}, metadata
