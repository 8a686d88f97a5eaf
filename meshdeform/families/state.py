"""Turn the state of a fit into tensors for a checkpoint, and back."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.families.collection import Collection, SampledShape
from meshdeform.families.inference import Inference
from meshdeform.families.learning import Learning
from meshdeform.families.machine import BetaMachine
from meshdeform.families.templates import Template

_ARRAYS = ("points", "normals", "triangles", "weights", "centre")
_OF_INFERENCE = ("deformed", "variance", "mass", "parts", "crowding", "likelihood", "s1", "s2", "s3", "edges")
_OF_LEARNING = ("rate", "error", "best_error", "epoch")


def dump_shapes(shapes: list[SampledShape], truth: list[NDArray[np.int64]]) -> dict[str, Tensor]:
    """Return the samples read so far."""
    if not shapes:
        return {}
    tensors = {f"shapes.{name}": torch.from_numpy(np.stack([getattr(s, name) for s in shapes])) for name in _ARRAYS}
    tensors |= {
        f"shapes.{name}": torch.stack([getattr(s, name) for s in shapes]) for name in ("features", "neighbours")
    }
    tensors["shapes.diagonal"] = torch.tensor([s.diagonal for s in shapes], dtype=torch.float64)
    tensors["shapes.truth"] = torch.from_numpy(np.stack(truth))
    return tensors


def load_shapes(tensors: dict[str, Tensor]) -> tuple[list[SampledShape], list[NDArray[np.int64]]]:
    """Return what `dump_shapes` was given."""
    if "shapes.points" not in tensors:
        return [], []
    arrays = {name: tensors[f"shapes.{name}"].numpy() for name in _ARRAYS}
    shapes = [
        SampledShape(
            **{name: values[t] for name, values in arrays.items()},
            diagonal=float(tensors["shapes.diagonal"][t]),
            features=tensors["shapes.features"][t],
            neighbours=tensors["shapes.neighbours"][t],
        )
        for t in range(len(arrays["points"]))
    ]
    return shapes, list(tensors["shapes.truth"].numpy())


def dump_inference(inference: Inference) -> dict[str, Tensor]:
    """Return the state of an inference; its collection is made again from the samples."""
    found = {f"inference.{name}": getattr(inference, name).clone() for name in _OF_INFERENCE}
    template = inference.template
    found |= {f"template.{name}": getattr(template, name).clone() for name in ("points", "features", "labels")}
    found["inference.iteration"] = torch.tensor(inference.iteration)
    return found


def load_inference(tensors: dict[str, Tensor], collection: Collection, given: Tensor, parts: int) -> Inference:
    """Return the inference that `dump_inference` was given."""
    points, features, labels = (tensors[f"template.{name}"] for name in ("points", "features", "labels"))
    template = Template(points, features, labels, parts)
    state = {name: tensors[f"inference.{name}"] for name in _OF_INFERENCE}
    edges = state.pop("edges")
    found = Inference(collection, template, given, **state, iteration=int(tensors["inference.iteration"]))
    found.edges = edges  # those of the first template
    return found


def dump_learning(learning: Learning) -> dict[str, Tensor]:
    """Return the state of a learning."""
    groups = {
        "weights": learning.machine.weights,
        "velocity": learning.velocity,
        "best": learning.best,
        "reach": learning.reach,
    }
    found = {f"{group}.{name}": value.clone() for group, values in groups.items() for name, value in values.items()}
    found |= {f"learning.{name}": getattr(learning, name).clone() for name in ("points", "exists")}
    numbers = [float(getattr(learning, name)) for name in _OF_LEARNING]
    found["learning.numbers"] = torch.tensor(numbers, dtype=torch.float64)
    found["learning.random"] = learning.random.get_state()
    found["learning.sees"] = learning.machine.sees.clone()
    return found


def load_learning(tensors: dict[str, Tensor], edges: Tensor) -> Learning:
    """Return the learning that `dump_learning` was given."""

    def group(name: str) -> dict[str, Tensor]:
        return {key.partition(".")[2]: value for key, value in tensors.items() if key.startswith(f"{name}.")}

    rate, error, best_error, epoch = tensors["learning.numbers"].tolist()
    random = torch.Generator()
    random.set_state(tensors["learning.random"])
    return Learning(
        BetaMachine(group("weights"), tensors["learning.sees"]),
        tensors["learning.points"],
        tensors["learning.exists"],
        edges,
        random,
        group("velocity"),
        group("best"),
        group("reach"),
        rate,
        error,
        best_error,
        int(epoch),
    )
