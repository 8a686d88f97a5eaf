"""Run jobs of kind `family_fit`: read a collection, infer its templates and correspondences, learn its machine."""

from __future__ import annotations

import dataclasses
import json
import math
import posixpath
from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.assets import Asset, Limits, build_glb, load_asset
from meshdeform.assets.collection import MIN_COLLECTION, AssetLabels, CollectionFiles, open_collection, own_labels
from meshdeform.deformation.checkpoint import Checkpoint, dump_checkpoint, fingerprint, load_checkpoint
from meshdeform.errors import AssetError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.tensors import arrays_of, tensors_of
from meshdeform.kinds.families.collection import Collection, SampledShape, sample_shape
from meshdeform.kinds.families.fit_description import READ_STEPS, total_steps
from meshdeform.kinds.families.inference import Inference, reading_prior
from meshdeform.kinds.families.learning import Learning
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.matching import correspondences, visible_points
from meshdeform.kinds.families.params import FamilyParams
from meshdeform.kinds.families.reading import MemberReading, agreed_nouns, named_parts, read_member
from meshdeform.kinds.families.results import FamilyResults, Unfinished, labels_of
from meshdeform.kinds.families.rows import StandingShape, in_rows, simple_surface
from meshdeform.kinds.families.template import Template
from meshdeform.reading import NO_PART
from meshdeform.runs.base import ArtifactData, JobRun, RunInput, params_of
from meshdeform.runs.kept_readings import Readings
from meshdeform.runs.sheets import shown
from meshdeform.vocabulary.solids import PART_NAMES

_REST, _UNKNOWN, _GLB = "rest", "not known yet", "model/gltf-binary"
_FEWEST = 2
"""Fewer assets have nothing in common."""
_ARRAYS = ("points", "normals", "triangles", "weights", "centre")
_OF_INFERENCE = ("deformed", "variance", "mass", "parts", "crowding", "likelihood", "s1", "s2", "s3", "edges")
_OF_LEARNING = ("rate", "error", "best_error", "epoch")


def start(job_input: RunInput) -> FamilyFitRun:
    """Unpack the collection and prepare the run.

    Raises AssetError, RequestError, CheckpointError: the input cannot be run; the error says what to do.
    """
    params = params_of(job_input.request, FamilyParams)
    file = job_input.files["collection"]
    limits = job_input.limits or Limits()
    files = open_collection(file.data, limits)
    if files.labels is None:
        files = dataclasses.replace(files, labels=own_labels(files.assets, limits))
    run = fingerprint(kind="family_fit", params=params.model_dump(mode="json"), collection=file.digest)
    state = load_checkpoint(job_input.checkpoint, run) if job_input.checkpoint is not None else None
    return FamilyFitRun(files, params, limits, run, file.digest, state, job_input.readings)


class FamilyFitRun(JobRun):
    """A run in progress, created by `start`."""

    def __init__(
        self,
        files: CollectionFiles,
        params: FamilyParams,
        limits: Limits,
        run: str,
        sha256: str,
        state: Checkpoint | None,
        readings: Readings,
    ) -> None:
        self._readings = readings
        self._read_as: list[MemberReading] = []  # of the samples, not of all triangles
        self._files, self._params, self._limits, self._run, self._sha256 = files, params, limits, run, sha256
        self._every = list(files.assets)
        self._names: list[str] = []  # of those that can be read
        super().__init__(total_steps(params), 0 if state is None else state.step)
        self._shapes: list[SampledShape] = []
        self._truth: list[NDArray[np.int64]] = []
        self._inference: Inference | None = None
        self._learning: Learning | None = None
        self._wrong: AssetError | None = None
        self._simple: dict[str, TriangleMesh] = {}
        if state is not None:
            self._resume(state)

    def _steps(self) -> Iterator[dict[str, float]]:
        """Run the remaining steps: reading, then inference, then learning."""
        while self.step < self.total_steps:
            if self.step < READ_STEPS:
                yield self._read()
            elif self.step < READ_STEPS + self._params.iterations:
                yield self._infer()
            else:
                yield self._learn()

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        tensors = dump_shapes(self._shapes, self._truth)
        tensors |= dump_readings(self._read_as)
        tensors["names"] = torch.tensor([self._every.index(name) for name in self._names], dtype=torch.long)
        if self._inference is not None:
            tensors |= dump_inference(self._inference)
        if self._learning is not None:
            tensors |= dump_learning(self._learning)
        return dump_checkpoint(Checkpoint(self.step, arrays_of(tensors)), self._run, self._sha256)

    def snapshot(self) -> ArtifactData:
        """Return a GLB of the assets that were read, in the colours of their parts so far."""
        if not self._shapes:
            return ArtifactData(build_glb(FamilyResults.markers(np.zeros((1, 3)), np.zeros(1, np.int64))), _GLB)
        parts = self._part_names()
        standing = []
        for t in shown(len(self._names)):
            name, shape = self._names[t], self._shapes[t]
            if name not in self._simple:
                self._simple[name] = simple_surface(load_asset(self._files.assets[name], name, self._limits))
            mesh = self._simple[name]
            near = cKDTree(shape.points).query(mesh.verts[mesh.faces].mean(1))[1]
            standing.append(StandingShape(name, mesh.verts, mesh.faces, self._parts_so_far(t, parts)[near]))
        return ArtifactData(in_rows(standing, [*parts, _UNKNOWN]), _GLB)

    def _parts_so_far(self, t: int, parts: list[str]) -> NDArray[np.int64]:
        """Return the part of each sample of an asset, a place in `parts`, or after the last where nothing is known."""
        if self._inference is not None:
            return self._inference.parts[t].argmax(1).numpy()
        named = np.array([parts.index(name) if name in parts else len(parts) for name in (*PART_NAMES, "")])
        codes = self._read_as[t].codes
        return np.where(self._truth[t] >= 0, self._truth[t], named[np.where(codes >= 0, codes, -1)])

    def finish(self) -> dict[str, ArtifactData]:
        """Return the results, by artifact name."""
        assert self._inference is not None
        return self._results(self._inference).artifacts()

    def so_far(self) -> dict[str, ArtifactData]:
        """Return parts and correspondences of the assets that were read; nothing of a single one."""
        if len(self._names) < _FEWEST:
            return {}
        inference = self._inference
        if inference is None:
            inference = self._begun()
            inference.step()
        tried = self._every[: len(self._every) * min(self.step, READ_STEPS) // READ_STEPS]
        results = dataclasses.replace(
            self._results(inference), unread=tuple(self._every[len(tried) :]), unfinished=Unfinished.of(self)
        )
        return results.artifacts()

    def _results(self, inference: Inference) -> FamilyResults:
        learning = self._learning
        return FamilyResults(
            self._files,
            self._params,
            self._limits,
            self._sha256,
            names=self._names,
            labels=self._labels,
            parts=self._part_names(),
            shapes=self._shapes,
            truth=torch.from_numpy(np.stack(self._truth)),
            inference=inference,
            machine=None if learning is None else learning.finished(),
            best_error=math.inf if learning is None else learning.best_error,
            nouns=[each.noun for each in self._read_as],
        )

    def _read(self) -> dict[str, float]:
        """Read and sample a tenth of the assets."""
        count = len(self._every)
        for t in range(count * self.step // READ_STEPS, count * (self.step + 1) // READ_STEPS):
            name = self._every[t]
            try:
                asset = load_asset(self._files.assets[name], name, self._limits)
                positions, triangles = asset.surface.positions, asset.surface.triangles
                shape = sample_shape(positions, triangles, self._params.samples, self._params.seed * 4099 + t)
            except AssetError as error:
                self._wrong = type(error)(f"{name}: {error.detail}", advice=error.advice_text, **error.extra)
                continue
            parts = self._files.labels.parts if self._files.labels else []
            self._truth.append(labels_of(asset, name, self._labels_of(name), parts)[shape.triangles])
            self._read_as.append(self._reading(asset, name, self._params.noun, shape))
            self._shapes.append(shape)
            self._names.append(name)
        if self._wrong is not None and count - self._every.index(name) - 1 + len(self._names) < MIN_COLLECTION:
            raise self._wrong  # the others are too few
        return {"total": float(count - t - 1)}

    def _reading(self, asset: Asset, name: str, noun: str | None, shape: SampledShape) -> MemberReading:
        """Return what a member is read as, of its samples; nothing where parts are not to be read."""
        if not self._params.read:
            return MemberReading("", {}, np.full(len(shape.points), NO_PART), np.zeros(len(shape.points)))
        found = read_member(asset, self._files.assets[name], name, noun, self._readings)
        return dataclasses.replace(found, codes=found.codes[shape.triangles], sure=found.sure[shape.triangles])

    def _agree_on_nouns(self) -> None:
        """Read members again that are something else by all of the collection than they were read as."""
        for t, noun in enumerate(agreed_nouns(self._read_as)):
            if noun and noun != self._read_as[t].noun:
                name = self._names[t]
                asset = load_asset(self._files.assets[name], name, self._limits)
                self._read_as[t] = self._reading(asset, name, noun, self._shapes[t])

    def _labels_of(self, name: str) -> AssetLabels:
        by_name = self._files.labels.assets if self._files.labels else {}
        return by_name.get(name) or by_name.get(posixpath.basename(name)) or AssetLabels()

    @property
    def _labels(self) -> list[AssetLabels]:
        return [self._labels_of(name) for name in self._names]

    def _infer(self) -> dict[str, float]:
        if self._inference is None:
            if self._params.noun is None:
                self._agree_on_nouns()
            self._inference = self._begun()
        losses = self._inference.step()
        return {"total": -losses["log_likelihood"], **losses}

    def _begun(self) -> Inference:
        """Return an inference over what was read."""
        given = self._given()
        return Inference.start(self._collection(), given, self._params.points, self._part_count(), self._prior(given))

    def _learn(self) -> dict[str, float]:
        assert self._inference is not None
        if self._learning is None:
            matches = correspondences(self._inference)
            points, _ = visible_points(self._inference, matches)
            random = torch.Generator().manual_seed(self._params.seed)
            machine = BetaMachine.start(points, matches.exists, self._inference.template.labels, random)
            self._learning = Learning.start(machine, points, matches.exists, self._inference.edges, random)
        losses = self._learning.step(self._params.epochs)
        return {"total": losses["error"], **losses}

    def _collection(self) -> Collection:
        def stacked(name: str) -> Tensor:
            values = [getattr(shape, name) for shape in self._shapes]
            return torch.stack([v if isinstance(v, Tensor) else torch.from_numpy(v).float() for v in values])

        names = ("points", "normals", "features", "neighbours")
        return Collection.of(*(stacked(name) for name in names), turn=self._params.turn)

    def _prior(self, given: Tensor) -> Tensor | None:
        """Return what readings say of the parts of samples, as `reading_prior` does; None if nothing was read."""
        codes = np.stack([each.codes for each in self._read_as])
        if not (codes >= 0).any():
            return None
        every, parts = np.unique(codes[codes >= 0]), self._part_names()
        read = np.where(codes >= 0, np.searchsorted(every, codes), -1)
        names = [PART_NAMES[code] for code in every]
        own = [parts.index(name) if name in parts else -1 for name in names]
        sure = torch.from_numpy(np.stack([each.sure for each in self._read_as])).float()
        return reading_prior(torch.from_numpy(read), sure, torch.tensor(own), given, len(parts))

    def _given(self) -> Tensor:
        """Return the parts of samples (T, P) that the inference may use; AssetError: no asset has all its labels."""
        truth = torch.from_numpy(np.stack(self._truth)).clone()
        for t, labels in enumerate(self._labels):
            if labels.held_out:
                truth[t] = -1
        if self._has_rest:
            truth[(truth >= 0).any(1)[:, None] & (truth < 0)] = self._part_count() - 1
        elif (truth >= 0).any() and not (truth >= 0).all(1).any() and not self._read_parts:
            raise AssetError(
                "labels.json labels no asset completely.",
                advice="Give at least one asset, better ten, a part for every node, material or triangle.",
            )
        return truth

    @property
    def _has_rest(self) -> bool:
        """Whether what has no part is a part itself: labels are the assets' own, and those of none are complete."""
        known = np.stack(self._truth) >= 0
        own = self._files.labels is not None and not self._files.labels.assets
        return bool(own and known.any() and not known.all(1).any())

    @property
    def _read_parts(self) -> list[str]:
        """The names of the parts that readings found on enough members."""
        return [PART_NAMES[code] for code in named_parts(np.stack([each.codes for each in self._read_as]))]

    def _learns_names(self) -> bool:
        used = zip(self._truth, self._labels, strict=True)
        return any(bool((marks >= 0).any()) and not labels.held_out for marks, labels in used)

    def _part_names(self) -> list[str]:
        if self._files.labels is not None and self._learns_names():
            parts = self._files.labels.parts
            return [*parts, _REST if _REST not in parts else f"{_REST} of it"] if self._has_rest else list(parts)
        if len(found := self._read_parts) > 1:
            return found
        return [f"part {number}" for number in range(1, self._params.parts + 1)]

    def _part_count(self) -> int:
        return len(self._part_names())

    def _resume(self, state: Checkpoint) -> None:
        tensors = tensors_of(state.tensors)
        self._shapes, self._truth = load_shapes(tensors)
        self._names = [self._every[t] for t in tensors["names"].tolist()]
        self._read_as = load_readings(tensors)
        if state.step > READ_STEPS:
            given = self._given()
            self._inference = load_inference(tensors, self._collection(), given, self._part_count(), self._prior(given))
        if state.step > READ_STEPS + self._params.iterations:
            assert self._inference is not None
            self._learning = load_learning(tensors, self._inference.edges)


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
    tensors = {f"inference.{name}": getattr(inference, name).clone() for name in _OF_INFERENCE}
    template = inference.template
    tensors |= {f"template.{name}": getattr(template, name).clone() for name in ("points", "features", "labels")}
    tensors["inference.iteration"] = torch.tensor(inference.iteration)
    return tensors


def dump_readings(readings: list[MemberReading]) -> dict[str, Tensor]:
    """Return what was read so far."""
    if not readings:
        return {}
    told = json.dumps([[each.noun, each.probabilities] for each in readings]).encode()
    return {
        "read.nouns": torch.frombuffer(bytearray(told), dtype=torch.uint8),
        "read.codes": torch.from_numpy(np.stack([each.codes for each in readings])),
        "read.sure": torch.from_numpy(np.stack([each.sure for each in readings])),
    }


def load_readings(tensors: dict[str, Tensor]) -> list[MemberReading]:
    """Return what `dump_readings` was given."""
    if "read.nouns" not in tensors:
        return []
    told = json.loads(tensors["read.nouns"].numpy().tobytes())
    arrays = tensors["read.codes"].numpy(), tensors["read.sure"].numpy()
    return [MemberReading(*nouns, *values) for nouns, *values in zip(told, *arrays, strict=True)]


def load_inference(
    tensors: dict[str, Tensor], collection: Collection, truth: Tensor, parts: int, prior: Tensor | None
) -> Inference:
    """Return the inference that `dump_inference` was given."""
    points, features, labels = (tensors[f"template.{name}"] for name in ("points", "features", "labels"))
    template = Template(points, features, labels, parts)
    state = {name: tensors[f"inference.{name}"] for name in _OF_INFERENCE}
    edges = state.pop("edges")
    known = torch.empty(0) if prior is None else prior
    inference = Inference(collection, template, truth, known, **state, iteration=int(tensors["inference.iteration"]))
    inference.edges = edges  # those of the first template
    return inference


def dump_learning(learning: Learning) -> dict[str, Tensor]:
    """Return the state of a learning."""
    groups = {
        "weights": learning.machine.weights,
        "velocity": learning.velocity,
        "best": learning.best,
        "reach": learning.reach,
    }
    tensors = {f"{group}.{name}": value.clone() for group, values in groups.items() for name, value in values.items()}
    tensors |= {f"learning.{name}": getattr(learning, name).clone() for name in ("points", "exists")}
    numbers = [float(getattr(learning, name)) for name in _OF_LEARNING]
    tensors["learning.numbers"] = torch.tensor(numbers, dtype=torch.float64)
    tensors["learning.random"] = learning.random.get_state()
    tensors["learning.sees"] = learning.machine.sees.clone()
    return tensors


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
