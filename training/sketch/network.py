"""Look at a drawing: one convolutional trunk, a head for the family, and two heads for each family's parameters.

The heads are those of Huang et al. 2017 (appendix B of the thesis): one linear output for each continuous parameter,
and one softmax for each discrete one. Their two AlexNets on 227 x 227 pixels are one small trunk on 64 x 64 here, which
all families share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from safetensors.torch import save
from torch import Tensor, nn

from meshdeform.assets.drawing import SIDE
from meshdeform.kinds.sketch.families import FAMILIES
from meshdeform.kinds.sketch.looking import WIDTHS, parameters_hash
from meshdeform.support.files import write_files

_FEATURES = 192


@dataclass(frozen=True)
class Look:
    """The network's answer for B drawings."""

    family: Tensor  # (B, families): logits
    numbers: Mapping[str, Tensor]  # of each family (B, N): its continuous parameters as shares of their ranges
    choices: Mapping[str, list[Tensor]]  # of each family (B, options): logits of its discrete parameters


class SketchNetwork(nn.Module):
    """The network; its input is (B, 1, SIDE, SIDE) float32, 1 where there is ink."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = 1
        for index, (width, stride) in enumerate(WIDTHS):
            kernel = 5 if index == 0 else 3
            layers += [
                nn.Conv2d(before, width, kernel, stride, kernel // 2, bias=False),
                nn.BatchNorm2d(width),
                nn.ReLU(inplace=True),
            ]
            before = width
        side = SIDE // 2 ** sum(stride == 2 for _, stride in WIDTHS)
        self.trunk = nn.Sequential(
            *layers, nn.Flatten(), nn.Dropout(0.2), nn.Linear(before * side * side, _FEATURES), nn.ReLU(inplace=True)
        )
        self.family = nn.Linear(_FEATURES, len(FAMILIES))
        self.numbers = nn.ModuleDict({name: nn.Linear(_FEATURES, len(f.numbers)) for name, f in FAMILIES.items()})
        self.choices = nn.ModuleDict(
            {name: nn.Linear(_FEATURES, sum(len(c.options) for c in f.choices)) for name, f in FAMILIES.items()}
        )

    def forward(self, pictures: Tensor) -> Look:
        """Look at drawings (B, 1, SIDE, SIDE)."""
        features = self.trunk(pictures)
        choices = {
            name: list(self.choices[name](features).split([len(c.options) for c in family.choices], 1))
            for name, family in FAMILIES.items()
        }
        numbers = {name: head(features) + 0.5 for name, head in self.numbers.items()}
        return Look(self.family(features), numbers, choices)


def write_network(path: Path, network: SketchNetwork, about: Mapping[str, str]) -> None:
    """Write weights in half precision as safetensors, with `about` and the families' hash as metadata."""
    state = {name: t.half() if t.is_floating_point() else t for name, t in network.state_dict().items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    data = save({name: t.contiguous() for name, t in state.items()}, {**about, "families": parameters_hash()})
    write_files({path: data})
