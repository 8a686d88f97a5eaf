"""Write the results of `family_fit`: arrays, the machine, the report, pictures, the wall, and the labelled assets."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform import __version__
from meshdeform.assets import Asset, Limits, Primitive, load_asset
from meshdeform.assets.codes import UNSIGNED_INT
from meshdeform.assets.collection import AssetLabels, CollectionFiles
from meshdeform.assets.container import Json
from meshdeform.assets.document import ELEMENT_ARRAY_BUFFER, Document
from meshdeform.assets.parted import PartLabels, parts_of, with_parts
from meshdeform.assets.surface import Surface
from meshdeform.errors import AssetError
from meshdeform.geometry.shapes import simplified
from meshdeform.kinds.families.boundary import without_strays
from meshdeform.kinds.families.collection import SampledShape
from meshdeform.kinds.families.family_file import FamilyFile, dump_family, surface_digest
from meshdeform.kinds.families.inference import Inference
from meshdeform.kinds.families.machine import BetaMachine
from meshdeform.kinds.families.matching import (
    NO_FAMILY,
    Correspondences,
    correspondences,
    descriptors,
    strangers,
    triangle_parts,
    unlike,
    unrelated,
    visible_points,
)
from meshdeform.kinds.families.members import turned
from meshdeform.kinds.families.params import FamilyParams, FamilySynthesisParams, SynthesisMode
from meshdeform.kinds.families.rows import without_seams
from meshdeform.runs.base import ArtifactData, JobRun, versions
from meshdeform.runs.sheets import COLOURS, assets_png, family_png, shown
from meshdeform.support.files import zipped

_PICTURED = 36
_MARKER = 0.008

_TRIANGLES, _OF_ONE = 150_000, 3_000
"""Triangles of a whole wall, and of one shape at most."""

_LEAST = 12
_POINTS = 0
_APART = 1.15
"""Distance of two shapes in widths or heights of the largest one."""


@dataclass(frozen=True)
class Unfinished:
    """How far a run came that was ended before its last step."""

    step: int
    total_steps: int

    @classmethod
    def of(cls, run: JobRun) -> Unfinished:
        """Return how far a run is."""
        return cls(run.step, run.total_steps)

    def told(self, what: str) -> str:
        """Return a sentence about results; `what` says in a sentence what they are."""
        return f"The run was ended after step {self.step} of {self.total_steps}. {what}"


def _told(unfinished: Unfinished | None) -> Json:
    """Return what a report says of a run that was ended; nothing of one that was not."""
    return {} if unfinished is None else {"unfinished": dataclasses.asdict(unfinished)}


@dataclass(frozen=True)
class FamilyResults:
    """Results of a fit. Attributes as in `FamilyFitRun`; all lists are in the order of `names`."""

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
    machine: BetaMachine | None  # None if the run was ended before it learned one
    best_error: float
    nouns: list[str]  # what each was read as, or empty
    unread: tuple[str, ...] = ()  # assets that a run did not come to, since it was ended
    unfinished: Unfinished | None = None

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
                    archive.writestr(zipfile.ZipInfo(path), _embedded(asset, found, self.parts))
        names = np.array(self.names)
        result = {
            "report.json": ArtifactData(self._report(accuracy, segments, digests), "application/json"),
            "preview.png": ArtifactData(family_png(pictures, self.parts), "image/png"),
            "wall.glb": wall(shapes, self.parts, self.inference.template.labels.numpy(), len(self.names)),
            "segmentation.npz": packed_arrays({"names": names, "parts": np.array(self.parts), **segments}),
            "correspondences.npz": packed_arrays({"names": names, **self._correspondence_arrays()}),
            "descriptors.npz": packed_arrays({"names": names, "descriptors": self._descriptors}),
        }
        if self.machine is not None:
            family = self._family(self.machine, digests, list(segments.values()))
            result["family.safetensors"] = ArtifactData(family, "application/octet-stream")
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
    def _descriptors(self) -> NDArray[np.float32]:
        return descriptors(self._points, self._matched.exists.numpy().astype(bool))

    @property
    def _points(self) -> NDArray[np.float64]:
        """The places of the template's points (T, K, 3) in the frame."""
        rows = torch.arange(len(self.shapes))[:, None]
        return self.inference.collection.points[rows, self._matched.samples].double().numpy()

    def _segment(self, t: int, asset: Asset) -> tuple[NDArray[np.uint8], float | None]:
        """Return the part of each triangle, given or found; and the accuracy by area where labels are held out."""
        shape, surface, labels = self.shapes[t], asset.surface, self.labels[t]
        corners = surface.positions[surface.triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(cross, axis=1)
        normals = cross / np.maximum(areas, 1e-300)[:, None]
        labels_found = triangle_parts(
            (corners.mean(1) - shape.centre) / shape.diagonal,
            normals,
            shape.points,
            shape.normals,
            self.inference.parts[t].numpy(),
        )
        labels_found = without_strays(surface.positions, surface.triangles, labels_found)
        if self.files.labels is None or self.parts[: len(self.files.labels.parts)] != self.files.labels.parts:
            return labels_found, None
        labels_given = labels_of(asset, self.names[t], labels, self.parts)
        known = labels_given >= 0
        if labels.held_out:
            weight = areas[known].sum()
            return labels_found, float(
                areas[known][labels_found[known] == labels_given[known]].sum() / weight
            ) if weight > 0 else None
        return np.where(known, labels_given, labels_found).astype(np.uint8), None

    def _wall_shape(self, t: int, asset: Asset, parts: NDArray[np.uint8], count: int) -> WallShape:
        shape, collection = self.shapes[t], self.inference.collection
        return wall_shape(
            self.names[t],
            asset.surface,
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

    def _family(self, machine: BetaMachine, digests: list[str], segments: list[NDArray[np.uint8]]) -> bytes:
        template, collection = self.inference.template, self.inference.collection
        family = FamilyFile(
            names=self.names,
            parts=self.parts,
            digests=digests,
            machine={name: value.numpy() for name, value in machine.weights.items()} | {"sees": machine.sees.numpy()},
            labels=template.labels.numpy(),
            scaling=self._visible[1].numpy(),
            points=self._points,
            triangles=self._correspondence_arrays()["triangles"],
            exists=self._matched.exists.numpy().astype(bool),
            centres=np.stack([shape.centre for shape in self.shapes]),
            diagonals=np.array([shape.diagonal for shape in self.shapes]),
            turns=collection.turns.double().numpy(),
            segments=segments,
        )
        more = {
            "template.points": template.points.numpy(),
            "template.features": template.features.numpy(),
            "box": collection.boxes.mean(0).numpy(),
        }
        return dump_family(family, more)

    def _report(
        self, accuracy: list[float | None], segments: dict[str, NDArray[np.uint8]], digests: list[str]
    ) -> bytes:
        likelihood = self.inference.likelihood
        other, warnings = self._strangers()
        machine, fit = self.machine, None
        if machine is not None:
            fit = machine.log_likelihood(self._visible[0], self._matched.exists)
        turns = torch.rad2deg(self.inference.collection.turns)
        assets = []
        for t, name in enumerate(self.names):
            used = np.unique(segments[f"{t:04d}"])
            truth = "given" if (self.truth[t] >= 0).any() else "none"
            assets.append(
                {
                    "name": name,
                    "labels": "held out" if self.labels[t].held_out else truth,
                    "parts": [self.parts[part] for part in used],
                    **({"noun": self.nouns[t]} if self.nouns[t] else {}),
                    "turn_deg": round(float(turns[t]), 3),
                    "log_likelihood": float(likelihood[t]),
                    **({} if fit is None else {"machine_log_likelihood": float(fit[t])}),
                    "points": int(self._matched.exists[t].sum()),
                    **({"accuracy": accuracy[t]} if accuracy[t] is not None else {}),
                }
            )
        spread, farthest = unrelated(self.inference.collection.features)
        if farthest:
            warnings.append(
                f"These assets seem to be no family: they are {spread:.2f} apart, and families at most {NO_FAMILY}. "
                f"Farthest from the others are: {_listed([self.names[t] for t in farthest])}."
            )
        copies = [self.names[t] for t, digest in enumerate(digests) if digest in digests[:t]]
        left_out = [name for name in self.files.assets if name not in {*self.names, *self.unread}]
        for names, what in ((left_out, "cannot be read and are left out"), (copies, "are copies of others")):
            if names:
                warnings.append(f"{len(names)} of {len(self.files.assets)} assets {what}: {_listed(names)}.")
        if turned := int((turns != 0).sum()):
            warnings.append(
                f"{turned} of {len(self.names)} assets were turned around the vertical axis to face as the others do."
            )
        if self.unfinished is not None:
            warnings.append(self.unfinished.told(self._what_is_there()))
        scores = [score for score in accuracy if score is not None]
        report = {
            "kind": "family_fit",
            "versions": versions(),
            "params": self.params.model_dump(mode="json"),
            "input": {"sha256": self.sha256, "assets": len(self.names)},
            "parts": self.parts,
            "assets": assets,
            "spread": spread,
            "strangers": [self.names[t] for t in other],
            "accuracy": {"held_out": len(scores), "parts": float(np.mean(scores))} if scores else None,
            "classes": self._class_accuracy(),
            "machine": None if machine is None else {"reconstruction_error": self.best_error},
            **_told(self.unfinished),
            "warnings": warnings,
        }
        return json.dumps(report, indent=1, allow_nan=False).encode()

    def _what_is_there(self) -> str:
        """Return a sentence about what a run that was ended has done."""
        count, every = len(self.names), len(self.names) + len(self.unread)
        if self.unread:
            return f"{count} of {every} assets are read, and have the parts that they were read with."
        if self.machine is None:
            return "Parts and correspondences are those so far; new shapes cannot be made of them."
        return "Parts and correspondences are whole; the machine is the best one so far."

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
        listed = _listed([self.names[t] for t in other])
        first = f"{len(other)} of {len(self.names)} assets {why}, as if they were of another family: {listed}."
        return other, [first + advice]

    def _class_accuracy(self) -> dict[str, Any] | None:
        """Return how often the nearest neighbour by descriptor (L1) among all others has the same sub-class."""
        known = [t for t, labels in enumerate(self.labels) if labels.class_]
        if len(known) < 2:
            return None
        looks = torch.from_numpy(self._descriptors[known])
        distance = torch.cdist(looks, looks, p=1)
        distance.fill_diagonal_(torch.inf)
        nearest = distance.argmin(1).tolist()
        same = [self.labels[known[i]].class_ == self.labels[known[j]].class_ for i, j in enumerate(nearest)]
        return {"assets": len(known), "nearest_neighbour": sum(same) / len(same)}

    @staticmethod
    def markers(points: NDArray[Any], labels: NDArray[np.int64]) -> list[Primitive]:
        """Return an octahedron for each point, coloured by part."""
        corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * _MARKER
        faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
        triangles = []
        for part in np.unique(labels):
            chosen = np.asarray(points[labels == part])
            verts = (chosen[:, None] + corners).reshape(-1, 3)
            rows = (faces[None] + 6 * np.arange(len(chosen))[:, None, None]).reshape(-1, 3)
            name = f"part {part + 1}"
            triangles.append(Primitive(verts, rows, name=name, material=name, base_color=COLOURS[part % len(COLOURS)]))
        return triangles


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (" ..." if len(names) > 5 else "")


def _as_glb(name: str) -> str:
    return str(PurePosixPath(name).with_suffix(".glb"))


def _embedded(asset: Asset, parts: NDArray[np.uint8], names: Sequence[str]) -> bytes:
    """Return the asset with the vertex attribute `_PART`; one that has no place for it as it is."""
    try:
        return with_parts(asset, PartLabels(tuple(names), parts.astype(np.int64) + 1))
    except AssetError:
        return asset.to_bytes()


def packed_arrays(arrays: dict[str, NDArray[Any]]) -> ArtifactData:
    """Write arrays as NPZ; equal arrays give equal bytes."""
    files = {}
    for name, values in arrays.items():
        content = io.BytesIO()
        np.save(content, values, allow_pickle=False)
        files[f"{name}.npy"] = content.getvalue()
    return ArtifactData(zipped(files), "application/x-npz")


def labels_of(asset: Asset, name: str, labels: AssetLabels, parts: list[str]) -> NDArray[np.int64]:
    """Return the part of each triangle (F,); -1 where none is given.

    Nodes come first, then materials, then single triangles, each over those before. An asset for which `labels` has
    none has those of its own attribute `_PART`. Raises AssetError: a node or a material does not exist, or there is not
    one label for each triangle.
    """
    numbers = {part: number for number, part in enumerate(parts)}
    count = len(asset.surface.triangles)
    result = np.full(count, -1, np.int64)
    if not labels.names_parts:
        for part, own in parts_of(asset).items():
            result[own] = numbers.get(part, -1)
        return result
    known = asset.pieces()
    for what, names_wanted, listed, flags in (
        ("node", labels.nodes, known.nodes, known.in_node),
        ("material", labels.materials, known.materials, known.of_material),
    ):
        places: dict[str, list[int]] = {}
        for each in listed:
            places.setdefault(each["name"], []).append(each["index"])
        for title, part in names_wanted.items():
            if title not in places:
                names = ", ".join(sorted(place for place in places if place)[:10]) or "none with a name"
                raise AssetError(f"labels.json: {name} has no {what} {title[:64]!r}.", advice=f"It has: {names}.")
            for index in places[title]:
                result[flags(index)] = numbers[part]
    if labels.triangles is not None:
        if len(labels.triangles) != count:
            raise AssetError(
                f"labels.json: {name} has {count} triangles, but {len(labels.triangles)} labels.",
                advice="Give one label for each triangle, in the file's order.",
            )
        result = np.array([numbers[part] for part in labels.triangles], np.int64)
    return result


def wall_shape(
    name: str,
    surface: Surface,
    parts: NDArray[np.uint8],
    points: NDArray[np.float64],
    confidence: NDArray[np.float32],
    *,
    centre: NDArray[np.float64],
    diagonal: float,
    turn: float,
    count: int,
) -> WallShape:
    """Return one of `count` shapes of a wall, with few triangles.

    `parts`, (F,) uint8: of the surface's triangles; `points`, (K, 3) float64: in the family's frame: turned, around 0,
    with the diagonal as unit; `confidence` is (K,) float32; `centre`, `diagonal` and `turn`: lead from the asset's
    units to that frame.
    """
    verts, triangles = turned((surface.positions - centre) / diagonal, turn), surface.triangles
    share = min(_OF_ONE, _TRIANGLES // count) / max(len(triangles), 1)
    pieces = []
    for part in np.unique(parts):
        piece = without_seams(verts, triangles[parts == part])
        fewest = max(int(share * len(piece.faces)), _LEAST)
        less = simplified(piece, fewest) if len(piece.faces) > fewest and share < 1 else piece
        pieces.append((less if len(less.faces) else piece, part))
    starts = np.cumsum([0, *(len(piece.verts) for piece, _ in pieces)])
    return WallShape(
        name,
        np.concatenate([piece.verts for piece, _ in pieces]),
        np.concatenate([piece.faces + start for (piece, _), start in zip(pieces, starts, strict=False)]),
        np.concatenate([np.full(len(piece.faces), part, np.uint8) for piece, part in pieces]),
        points,
        confidence,
    )


def nearest_members(
    family: FamilyFile, points: NDArray[np.float64], exists: NDArray[np.bool_], count: int
) -> list[dict[str, Any]]:
    """Return the members with the descriptors nearest (L1) to that of a shape (K, 3), (K,), nearest first."""
    members = family.points, family.exists
    distance = np.abs(descriptors(*members) - descriptors(points[None], exists[None], members)).sum(1)
    order = np.argsort(distance, kind="stable")[:count]
    return [{"name": family.names[member], "distance": float(distance[member])} for member in order]


@dataclass(frozen=True)
class SynthesisResults:
    """Results of a synthesis. Attributes as in `FamilySynthesisRun`."""

    family: FamilyFile
    params: FamilySynthesisParams
    limits: Limits
    digests: dict[str, str]
    members: list[int]
    energies: list[float]
    shapes: list[bytes]
    about: list[dict[str, Any]]
    drawn: list[tuple[NDArray[np.float64], NDArray[np.bool_]]]
    load: Callable[[int], Asset]
    unfinished: Unfinished | None = None

    def artifacts(self) -> dict[str, ArtifactData]:
        """Return all artifacts by name."""
        search = self.params.mode is SynthesisMode.SEARCH
        found = self._neighbours() if search else None
        artifacts: dict[str, ArtifactData] = {}
        if found is None:
            glb = "model/gltf-binary"
            artifacts["result.glb"] = ArtifactData(self.shapes[0], glb)
            files = {self._name(number): shape for number, shape in enumerate(self.shapes)}
            artifacts["shapes.zip"] = ArtifactData(zipped(files), "application/zip")
            points, exists = (np.stack([each[i] for each in self.drawn]) for i in (0, 1))
            arrays = {"points": points, "exists": exists, "part": self.family.labels}
            artifacts["points.npz"] = packed_arrays(arrays)
            titles = [str(number) for number in range(len(self.shapes))]
            shapes = [self._shape(number, self._made(number)) for number in range(len(self.shapes))]
            pictured = map(self._made, range(len(self.shapes)))
        else:
            rows = [self.members[0], *(self.family.names.index(each["name"]) for each in found)]
            titles = [self.family.names[row] for row in rows]
            shapes = [self._member(row, self.load(row), len(rows)) for row in rows]
            pictured = map(self.load, rows)
        artifacts["wall.glb"] = wall(shapes, self.family.parts, self.family.labels)
        # One by one: an asset takes many times the bytes of its file.
        artifacts["preview.png"] = ArtifactData(assets_png(pictured, titles), "image/png")
        artifacts["report.json"] = ArtifactData(self._report(found), "application/json")
        return artifacts

    def _made(self, number: int) -> Asset:
        return load_asset(self.shapes[number], self._name(number), self.limits)

    def _shape(self, number: int, asset: Asset) -> WallShape:
        parts, frame = asset.pieces(), self.about[number]["frame"]
        numbers = np.zeros(len(asset.surface.triangles), np.uint8)
        for node in parts.nodes:
            numbers[parts.in_node(node["index"])] = self.family.parts.index(node["name"])
        points, exists = self.drawn[number]
        return wall_shape(
            self._name(number),
            asset.surface,
            numbers,
            points,
            exists.astype(np.float32),
            centre=np.array(frame["centre"]),
            diagonal=frame["diagonal"],
            turn=0.0,
            count=len(self.shapes),
        )

    def _member(self, row: int, asset: Asset, count: int) -> WallShape:
        family = self.family
        return wall_shape(
            family.names[row],
            asset.surface,
            family.segments[row],
            family.points[row],
            family.exists[row].astype(np.float32),
            centre=family.centres[row],
            diagonal=float(family.diagonals[row]),
            turn=float(family.turns[row]),
            count=count,
        )

    @staticmethod
    def _name(number: int) -> str:
        return f"shape_{number:02d}.glb"

    def _neighbours(self) -> list[dict[str, Any]]:
        """Return the members nearest to the one that is searched for, without itself."""
        query = self.members[0]
        shape = self.family.points[query], self.family.exists[query]
        nearest = nearest_members(self.family, *shape, self.params.count + 1)
        return [each for each in nearest if each["name"] != self.family.names[query]][: self.params.count]

    def _report(self, neighbours: list[dict[str, Any]] | None) -> bytes:
        warnings = []
        for number, about in enumerate(self.about):
            if about["loose"]:
                warnings.append(f"{self._name(number)}: no member says where {', '.join(about['loose'])} would touch.")
        if self.unfinished is not None:
            warnings.append(self.unfinished.told(f"{len(self.shapes)} of {self.params.count} shapes are made."))
        report = {
            "kind": "family_synthesize",
            "versions": versions(),
            "params": self.params.model_dump(mode="json"),
            "input": {"sha256": self.digests, "members": len(self.family.names)},
            "parts": self.family.parts,
            "members": [
                {"name": name, "free_energy": energy}
                for name, energy in zip(self.family.names, self.energies, strict=True)
            ],
            "shapes": [{"name": self._name(number), **about} for number, about in enumerate(self.about)],
            "nearest_members": neighbours,
            **_told(self.unfinished),
            "warnings": warnings,
        }
        return json.dumps(report, indent=1, allow_nan=False).encode()


@dataclass(frozen=True)
class WallShape:
    """A shape of a wall."""

    name: str
    positions: NDArray[np.float64]  # (N, 3) float64: around 0, +Y up, all shapes in one unit
    triangles: NDArray[np.int64]  # (F, 3) int64
    parts: NDArray[np.uint8]  # (F,) uint8: the part of each triangle
    points: NDArray[np.float64]
    """(K, 3) float64: in the frame of the positions; point k of one shape corresponds to point k of any other."""
    confidence: NDArray[np.float32]  # (K,) float32: how sure each point is; 0 where the shape lacks it


def wall(
    shapes: Sequence[WallShape], parts: Sequence[str], labels: NDArray[np.int64], count: int | None = None
) -> ArtifactData:
    """Return `wall.glb`: a node for each shape, in rows from the top left.

    The mesh of a node has a primitive for each part, whose material has the part's name and colour, and one of points
    with the attribute `_CONFIDENCE`. `labels`, (K,) int64: the part of each point. `count`: number of shapes with those
    that are not shown. Default: all are shown.
    """
    points = [int(label) for label in labels]
    extras: Json = {"kind": "family_wall", "parts": list(parts), "points": points}
    extras["shapes"] = len(shapes) if count is None else count
    about: Json = {"version": "2.0", "generator": f"Meshdeform {__version__}", "extras": {"meshdeform": extras}}
    root: Json = {"asset": about, "scene": 0, "scenes": [{"nodes": list(range(len(shapes)))}]}
    root |= {"nodes": [], "meshes": [], "materials": []}
    document = Document(root, None, b"")
    for number, part in enumerate(parts):
        shading = {
            "baseColorFactor": list(COLOURS[number % len(COLOURS)]),
            "metallicFactor": 0.0,
            "roughnessFactor": 0.8,
        }
        root["materials"].append({"name": part, "pbrMetallicRoughness": shading})
    columns = max(math.ceil(math.sqrt(1.5 * len(shapes))), 1)
    sizes = np.array([np.ptp(shape.positions, axis=0) for shape in shapes])
    # A shape that is turned is as wide as it is deep.
    across, down = _APART * float(np.hypot(sizes[:, 0], sizes[:, 2]).max()), _APART * float(sizes[:, 1].max())
    for number, shape in enumerate(shapes):
        place = [number % columns * across, -(number // columns) * down, 0.0]
        root["nodes"].append({"name": shape.name, "mesh": number, "translation": place})
        primitives = [_surface(document, shape, int(part)) for part in np.unique(shape.parts)]
        root["meshes"].append({"name": shape.name, "primitives": [*primitives, _points(document, shape)]})
    return ArtifactData(document.to_bytes(), "model/gltf-binary")


def _surface(document: Document, shape: WallShape, part: int) -> dict[str, Any]:
    rows, corners = np.unique(shape.triangles[shape.parts == part], return_inverse=True)
    position = document.append_accessor(shape.positions[rows].astype(np.float32), bounds=True)
    view = document.append_view(corners.reshape(-1).astype("<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
    accessors = document.items("accessors")
    accessors.append({"bufferView": view, "componentType": UNSIGNED_INT, "count": corners.size, "type": "SCALAR"})
    return {"attributes": {"POSITION": position}, "indices": len(accessors) - 1, "material": part}


def _points(document: Document, shape: WallShape) -> dict[str, Any]:
    position = document.append_accessor(shape.points.astype(np.float32), bounds=True)
    sure = document.append_accessor(shape.confidence.astype(np.float32))
    return {"attributes": {"POSITION": position, "_CONFIDENCE": sure}, "mode": _POINTS}
