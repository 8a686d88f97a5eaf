"""Write the results of `family_fit`: arrays, the machine, the report, the picture, and the labelled assets."""

from __future__ import annotations

import io
import json
import zipfile
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.assets import Asset, Limits, Primitive, load_asset
from meshdeform.assets.collection import AssetLabels, CollectionFiles
from meshdeform.assets.family_file import FamilyFile, dump_family, surface_digest
from meshdeform.assets.wall import WallShape
from meshdeform.families.boundary import without_strays
from meshdeform.families.collection import SampledShape
from meshdeform.families.inference import Inference
from meshdeform.families.machine import BetaMachine
from meshdeform.families.matching import (
    Correspondences,
    correspondences,
    strangers,
    triangle_parts,
    unlike,
    visible_points,
)
from meshdeform.requests.family import FamilyParams
from meshdeform.runs.base import ArtifactData
from meshdeform.runs.family_labels import labels_of
from meshdeform.runs.family_picture import COLOURS, family_png
from meshdeform.runs.family_wall import shown, wall, wall_shape
from meshdeform.runs.report import versions

__all__ = ["FamilyResults", "packed_arrays"]

_PICTURED = 36
_MARKER = 0.008


@dataclass(frozen=True)
class FamilyResults:
    """What a finished run has found. Attributes as in `FamilyFitRun`; all lists are in the order of `names`."""

    files: CollectionFiles
    params: FamilyParams
    limits: Limits
    sha256: str
    names: list[str]
    labels: list[AssetLabels]
    parts: list[str]
    shapes: list[SampledShape]
    truth: Tensor
    inference: Inference
    machine: BetaMachine
    best_error: float

    def artifacts(self) -> dict[str, ArtifactData]:
        """Return all artifacts by name."""
        segments: dict[str, NDArray[np.uint8]] = {}
        pictures: list[tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]] = []
        labelled = io.BytesIO()
        stride = -(-len(self.names) // _PICTURED)
        digests: list[str] = []
        accuracy: list[float | None] = []
        hung = shown(len(self.names))
        shapes: list[WallShape] = []
        paths = Counter(map(_as_glb, self.names))  # a.obj may lie beside a.glb
        with zipfile.ZipFile(labelled, "w", zipfile.ZIP_DEFLATED) as archive:
            for t, name in enumerate(self.names):
                asset = load_asset(self.files.assets[name], name, self.limits)
                found, score = self._segment(t, asset)
                segments[f"{t:04d}"] = found
                accuracy.append(score)
                digests.append(surface_digest(asset.surface))
                if t % stride == 0:
                    pictures.append((asset.surface.positions, asset.surface.triangles, found))
                if t in hung:
                    shapes.append(self._wall_shape(t, asset, found, len(hung)))
                if self.params.embed_labels:
                    path = _as_glb(name)
                    if path != name and paths[path] > 1:
                        path = f"{name}.glb"
                    archive.writestr(zipfile.ZipInfo(path), _embedded(asset, found))
        names = np.array(self.names)
        npz = "application/x-npz"
        result = {
            "report.json": ArtifactData(self._report(accuracy, segments), "application/json"),
            "preview.png": ArtifactData(family_png(pictures, self.parts), "image/png"),
            "wall.glb": wall(shapes, self.parts, self.inference.template.labels.numpy(), len(self.names)),
            "segmentation.npz": ArtifactData(
                packed_arrays({"names": names, "parts": np.array(self.parts), **segments}), npz
            ),
            "correspondences.npz": ArtifactData(packed_arrays({"names": names, **self._correspondence_arrays()}), npz),
            "descriptors.npz": ArtifactData(
                packed_arrays({"names": names, "descriptors": self._descriptors.numpy()}), npz
            ),
            "family.safetensors": ArtifactData(
                self._family(digests, list(segments.values())), "application/octet-stream"
            ),
        }
        if self.params.embed_labels:
            result["labelled.zip"] = ArtifactData(labelled.getvalue(), "application/zip")
        return result

    @cached_property
    def _matched(self) -> Correspondences:
        return correspondences(self.inference)

    @cached_property
    def _visible(self) -> tuple[Tensor, Tensor]:
        return visible_points(self.inference, self._matched)

    @cached_property
    def _descriptors(self) -> Tensor:
        return self.machine.describe(self._visible[0], self._matched.exists)

    def _segment(self, t: int, asset: Asset) -> tuple[NDArray[np.uint8], float | None]:
        """Return the part of each triangle, given or found; and the accuracy by area where labels are held out."""
        shape, surface, labels = self.shapes[t], asset.surface, self.labels[t]
        corners = surface.positions[surface.triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(cross, axis=1)
        normals = cross / np.maximum(areas, 1e-300)[:, None]
        found = triangle_parts(
            (corners.mean(1) - shape.centre) / shape.diagonal,
            normals,
            shape.points,
            shape.normals,
            self.inference.parts[t].numpy(),
        )
        found = without_strays(surface.positions, surface.triangles, found)
        if self.files.labels is None or self.parts != self.files.labels.parts:
            return found, None
        given = labels_of(asset, self.names[t], labels, self.parts)
        known = given >= 0
        if labels.held_out:
            weight = areas[known].sum()
            return found, float(areas[known][found[known] == given[known]].sum() / weight) if weight > 0 else None
        return np.where(known, given, found).astype(np.uint8), None

    def _wall_shape(self, t: int, asset: Asset, parts: NDArray[np.uint8], count: int) -> WallShape:
        shape, collection = self.shapes[t], self.inference.collection
        return wall_shape(
            self.names[t],
            asset.surface.positions,
            asset.surface.triangles,
            parts,
            collection.points[t, self._matched.samples[t]].double().numpy(),
            (self._matched.confidence[t] * self._matched.exists[t]).numpy(),
            centre=shape.centre,
            diagonal=shape.diagonal,
            turn=float(collection.turns[t]),
            count=count,
        )

    def _correspondence_arrays(self) -> dict[str, NDArray[Any]]:
        chosen = self._matched.samples.numpy()
        rows = range(len(self.shapes))
        return {
            "positions": np.stack(
                [self.shapes[t].points[chosen[t]] * self.shapes[t].diagonal + self.shapes[t].centre for t in rows]
            ),
            "triangles": np.stack([self.shapes[t].triangles[chosen[t]] for t in rows]),
            "weights": np.stack([self.shapes[t].weights[chosen[t]] for t in rows]),
            "confidence": self._matched.confidence.numpy(),
            "exists": self._matched.exists.numpy().astype(bool),
            "part": self.inference.template.labels.numpy(),
        }

    def _family(self, digests: list[str], segments: list[NDArray[np.uint8]]) -> bytes:
        template, collection = self.inference.template, self.inference.collection
        rows = torch.arange(len(self.shapes))[:, None]
        family = FamilyFile(
            names=self.names,
            parts=self.parts,
            digests=digests,
            machine={name: value.numpy() for name, value in self.machine.weights.items()}
            | {"sees": self.machine.sees.numpy()},
            labels=template.labels.numpy(),
            scaling=self._visible[1].numpy(),
            points=collection.points[rows, self._matched.samples].double().numpy(),
            triangles=self._correspondence_arrays()["triangles"],
            exists=self._matched.exists.numpy().astype(bool),
            centres=np.stack([shape.centre for shape in self.shapes]),
            diagonals=np.array([shape.diagonal for shape in self.shapes]),
            turns=collection.turns.double().numpy(),
            descriptors=self._descriptors.numpy(),
            segments=segments,
        )
        more = {
            "template.points": template.points.numpy(),
            "template.features": template.features.numpy(),
            "box": collection.boxes.mean(0).numpy(),
        }
        return dump_family(family, more)

    def _report(self, accuracy: list[float | None], segments: dict[str, NDArray[np.uint8]]) -> bytes:
        likelihood = self.inference.likelihood
        other, warnings = self._strangers()
        fit = self.machine.log_likelihood(self._visible[0], self._matched.exists)
        turns = torch.rad2deg(self.inference.collection.turns)
        assets = []
        for t, name in enumerate(self.names):
            used = np.unique(segments[f"{t:04d}"])
            assets.append(
                {
                    "name": name,
                    "labels": "held out"
                    if self.labels[t].held_out
                    else "given"
                    if (self.truth[t] >= 0).any()
                    else "none",
                    "parts": [self.parts[part] for part in used],
                    "turn_deg": round(float(turns[t]), 3),
                    "log_likelihood": float(likelihood[t]),
                    "machine_log_likelihood": float(fit[t]),
                    "points": int(self._matched.exists[t].sum()),
                    **({"accuracy": accuracy[t]} if accuracy[t] is not None else {}),
                }
            )
        if turned := int((turns != 0).sum()):
            warnings.append(
                f"{turned} of {len(self.names)} assets were turned around the vertical axis to face as the others do."
            )
        scores = [score for score in accuracy if score is not None]
        report = {
            "kind": "family_fit",
            "versions": versions(),
            "params": self.params.model_dump(mode="json"),
            "input": {"sha256": self.sha256, "assets": len(self.names)},
            "parts": self.parts,
            "assets": assets,
            "strangers": [self.names[t] for t in other],
            "accuracy": {"held_out": len(scores), "parts": float(np.mean(scores))} if scores else None,
            "classes": self._class_accuracy(),
            "machine": {"reconstruction_error": self.best_error, "descriptor_size": self._descriptors.shape[1]},
            "warnings": warnings,
        }
        return json.dumps(report, indent=1, allow_nan=False).encode()

    def _strangers(self) -> tuple[list[int], list[str]]:
        """Return the assets that seem to be of another family, and the warning about them."""
        labelled = torch.tensor([not labels.held_out for labels in self.labels]) & (self.truth >= 0).any(1)
        other = unlike(self.inference.collection.features, labelled)
        why, advice = "are unlike every labelled one", " Label some of them if they belong to it."
        if other is None:
            other = strangers(self.inference.likelihood)
            why, advice = "are much less likely than the others", ""
        if not other:
            return [], []
        listed = ", ".join(self.names[t] for t in other[:5]) + (" ..." if len(other) > 5 else "")
        first = f"{len(other)} of {len(self.names)} assets {why}, as if they were of another family: {listed}."
        return other, [first + advice]

    def _class_accuracy(self) -> dict[str, Any] | None:
        """Return how often the nearest neighbour by descriptor (L1) among all others has the same sub-class."""
        known = [t for t, labels in enumerate(self.labels) if labels.class_]
        if len(known) < 2:
            return None
        distance = torch.cdist(self._descriptors[known], self._descriptors[known], p=1)
        distance.fill_diagonal_(torch.inf)
        nearest = distance.argmin(1).tolist()
        same = [self.labels[known[i]].class_ == self.labels[known[j]].class_ for i, j in enumerate(nearest)]
        return {"assets": len(known), "nearest_neighbour": sum(same) / len(same)}

    @staticmethod
    def markers(points: NDArray[Any], labels: NDArray[np.int64]) -> list[Primitive]:
        """Return an octahedron for each point, coloured by part."""
        corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * _MARKER
        faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
        made = []
        for part in np.unique(labels):
            chosen = np.asarray(points[labels == part])
            verts = (chosen[:, None] + corners).reshape(-1, 3)
            rows = (faces[None] + 6 * np.arange(len(chosen))[:, None, None]).reshape(-1, 3)
            name = f"part {part + 1}"
            made.append(Primitive(verts, rows, name=name, material=name, base_color=COLOURS[part % len(COLOURS)]))
        return made


def _as_glb(name: str) -> str:
    return str(PurePosixPath(name).with_suffix(".glb"))


def _embedded(asset: Asset, parts: NDArray[np.uint8]) -> bytes:
    """Return the asset with the vertex attribute `_PART`: the part of a triangle at each vertex."""
    values = np.zeros(len(asset.surface.positions), np.float32)
    values[asset.surface.triangles.reshape(-1)] = np.repeat(parts, 3)
    return asset.with_vertex_values("_PART", values)


def packed_arrays(arrays: dict[str, NDArray[Any]]) -> bytes:
    """Write arrays as NPZ; equal arrays give equal bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            content = io.BytesIO()
            np.save(content, values, allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content.getvalue())
    return buffer.getvalue()
