"""Run jobs of kind `surface_fit`: fit a neural displacement field to a surface."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, load_asset
from meshdeform.deformation.checkpoint import dump_checkpoint, fingerprint, load_checkpoint, load_shape
from meshdeform.errors import AssetError, AssetTooLargeError, ParameterError
from meshdeform.kinds.surface_fit.cleaning import CleanMesh, clean
from meshdeform.kinds.surface_fit.collapse import base_of
from meshdeform.kinds.surface_fit.colours import FieldColours
from meshdeform.kinds.surface_fit.container import EncodedBase, encode_base, write_field
from meshdeform.kinds.surface_fit.fitting import FieldFit, FieldFrame, FitOptions
from meshdeform.kinds.surface_fit.gluing import glue, topology
from meshdeform.kinds.surface_fit.intrinsic import IntrinsicMesh, delaunay
from meshdeform.kinds.surface_fit.learned_scalars import check_places, learned_scalars
from meshdeform.kinds.surface_fit.level_files import intrinsic_npz, level_glb
from meshdeform.kinds.surface_fit.measures import Reference, distances
from meshdeform.kinds.surface_fit.params import MAX_BASE_FACES, SurfaceFitParams
from meshdeform.kinds.surface_fit.patches import divided, level_of
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.scalar_fields import ScalarField
from meshdeform.kinds.surface_fit.scalar_files import SampledScalars, read_scalar_file
from meshdeform.kinds.surface_fit.scalar_sections import colours_at
from meshdeform.kinds.surface_fit.surface_files import (
    DistanceGrid,
    ImplicitNetwork,
    OrientedPoints,
    read_surface_file,
    warnings_about,
)
from meshdeform.kinds.surface_fit.surface_sources import SourceSurface, surface_of
from meshdeform.rendering.studio import comparison_png
from meshdeform.runs.base import ArtifactData, JobRun, RunInput, RunLog, params_of, sha256_hex, versions

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_GLB = "model/gltf-binary"
_BYTES = "application/octet-stream"
_SNAPSHOT_LEVEL = 1
_DRAWN_FACES = 10_000
_MOST_SIZES = 20.0
"""Times the surface's diagonal that the one of a base may be, or the other way round."""
_REVERSED, _UNCOVERED = 0.01, 0.01
"""Share of the area that may face the other way, and of the diagonal by which a hundredth of the input may be away."""
_SAID_OF_COLOURS = (
    "The .ndf has the colours of the asset as a small field, off by {off:.1%} of their range on average; sharp, as a "
    "texture, they are in level_{level}.glb alone, which is written with `-o FILE.glb` or `-o FOLDER`. Transparency, "
    "metalness, roughness, normal maps, rigs and animations are lost."
)
_SAID_OF_POSE = (
    "The asset has a rig: it is fitted in the pose of the file's nodes, which viewers show. For another one, "
    "`meshdeform convert FILE -o POSED.glb --pose CLIP@SECONDS` first."
)
_ANCHOR_SLACK = 0.1
"""Share of the diagonal by which an anchor may be outside of the bounding box."""


def start(job_input: RunInput) -> SurfaceFitRun:
    """Read the surface, make its base, and prepare the fit."""
    log, params = RunLog(), params_of(job_input.request, SurfaceFitParams, job_input.resolved)
    file = job_input.files["asset"]
    sha256 = file.digest
    with log.phase("read"):
        source, asset = _source(job_input)
        own = _own_base(job_input)
        surface = surface_of(source, params.base_faces if own is None else MAX_BASE_FACES)
    with log.phase("base"):
        around = surface.reference.verts
        if own is None:
            verts, faces = base_of(surface.reference, params.base_faces)
        else:
            verts, faces = base_of(own, len(own.faces))
            _check_base(verts, around)
            around = np.concatenate([around, verts])
        frame = FieldFrame.around(around)
        base = encode_base(np.clip(frame.enter(verts), -1, 1), faces)
    more = {"base": job_input.files["base"].digest} if own is not None else {}
    requested = params.model_dump(mode="json")
    shape = fingerprint(
        asset=sha256, **more, **params.model_dump(include={"base_faces", "features", "octaves", "width", "depth"})
    )
    run = fingerprint(kind="surface_fit", asset=sha256, **more, params=requested)
    options = FitOptions(**params.model_dump(include=set(FitOptions.__dataclass_fields__)))
    fit = FieldFit(
        surface,
        frame,
        base.verts,
        base.faces,
        options,
        checkpoint=load_checkpoint(job_input.checkpoint, run) if job_input.checkpoint is not None else None,
        initial=load_shape(job_input.initial, shape) if job_input.initial is not None else None,
        anchors=_anchors(params, frame, frame.leave(base.verts), surface.reference.verts),
    )
    warnings = [*warnings_about(source), *([_SAID_OF_POSE] if asset is not None and asset.rig() else [])]
    facts = {"filename": file.filename, "bytes": len(file.data), "sha256": sha256, "warnings": warnings}
    scalars = None
    if "scalars" in job_input.files:
        scalars = read_scalar_file(job_input.files["scalars"].data)
        check_places(surface.reference.verts, surface.reference.faces, scalars)
    return SurfaceFitRun(surface, frame, base, fit, params, facts, run, shape, log, scalars, asset, job_input.on_wait)


def _own_base(job_input: RunInput) -> CleanMesh | None:
    """Return the base that was sent, if there is one."""
    file = job_input.files.get("base")
    if file is None:
        return None
    surface = load_asset(file.data, file.filename, job_input.limits).surface
    if len(surface.triangles) > MAX_BASE_FACES:
        raise AssetTooLargeError(
            f"The base has {len(surface.triangles)} faces; the limit is {MAX_BASE_FACES}.", advice="Simplify it."
        )
    return clean(surface.positions, surface.triangles)


def _check_base(verts: _Floats, surface: _Floats) -> None:
    """Refuse a base of another size than the surface, or elsewhere: no projection leads from one to the other."""
    (low, high), (least, most) = ((each.min(0), each.max(0)) for each in (verts, surface))
    ours, theirs = float(np.linalg.norm(high - low)), float(np.linalg.norm(most - least))
    apart = float(np.linalg.norm((low + high - least - most) / 2))
    if not (theirs / _MOST_SIZES < ours < _MOST_SIZES * theirs and apart < ours + theirs):
        raise AssetError(
            f"The base (diagonal {ours:.4g}) lies elsewhere than the surface (diagonal {theirs:.4g}, {apart:.4g} away) "
            "or has another size.",
            advice="Send it in the coordinates of the asset, around the surface.",
        )


def _anchors(
    params: SurfaceFitParams, frame: FieldFrame, base: _Floats, surface: _Floats
) -> tuple[_Floats, _Floats] | None:
    if not params.anchors:
        return None
    pairs = np.array([[anchor.base, anchor.surface] for anchor in params.anchors], np.float64)
    for side, (name, verts) in enumerate((("base", base), ("surface", surface))):
        low, high = verts.min(0), verts.max(0)
        slack = _ANCHOR_SLACK * float(np.linalg.norm(high - low))
        outside = np.flatnonzero(((pairs[:, side] < low - slack) | (pairs[:, side] > high + slack)).any(1))
        if len(outside):
            raise ParameterError(
                f"Anchor {outside[0] + 1} names a point of the {name} that lies outside of it.",
                advice=f"Give points within {np.round(low, 4).tolist()} to {np.round(high, 4).tolist()}.",
            )
    return frame.enter(pairs[:, 0]), frame.enter(pairs[:, 1])


def _source(
    job_input: RunInput,
) -> tuple[CleanMesh | OrientedPoints | DistanceGrid | ImplicitNetwork, Asset | None]:
    """Return what the file describes, and the asset if that is a mesh."""
    file = job_input.files["asset"]
    surface = read_surface_file(file.data, file.filename, job_input.limits)
    if surface is not None:
        return surface, None
    asset = load_asset(file.data, file.filename, job_input.limits)
    return clean(asset.surface.positions, asset.surface.triangles), asset


def _said_of_size(faces: int, size: int) -> list[str]:
    """Return a warning if a mesh takes fewer bytes otherwise than the field."""
    if faces >= size:
        return []
    return [
        f"The asset has {faces} triangles. Compressed by Draco it takes about a byte for each, less than this field "
        f"({size} bytes), and keeps them all: as a file it is the better choice."
    ]


def _warnings(level: dict[str, Any], cleaned: dict[str, int]) -> list[str]:
    """Return what must be said of a result."""
    warnings, distance = [], level["distance"]
    if cleaned.get("turned_normals"):
        warnings.append("The normals of the points faced inside; they were turned.")
    if distance["reversed_faces"]:
        sentence = f"{distance['reversed_faces']} of {level['faces']} triangles face the other way than the surface"
        advice = "More steps, more anchors or a base that is more like the surface unfold it."
        warnings.append(f"{sentence}: it is folded. {advice}" if distance["reversed"] > _REVERSED else f"{sentence}.")
    if distance["from_input"]["p99"] > _UNCOVERED:
        warnings.append(
            f"A hundredth of the input is {distance['from_input']['p99']:.1%} of the diagonal or more away from the "
            "result: parts of it are missing. Set params.base_faces and params.steps higher, or send more points."
        )
    return warnings


class SurfaceFitRun(JobRun):
    """A run in progress, created by `start`."""

    def __init__(
        self,
        surface: SourceSurface,
        frame: FieldFrame,
        base: EncodedBase,
        fit: FieldFit,
        params: SurfaceFitParams,
        facts: dict[str, Any],
        run: str,
        shape: str,
        log: RunLog,
        scalars: SampledScalars | None,
        asset: Asset | None,
        on_wait: Callable[[], None],
    ) -> None:
        super().__init__(params.steps, fit.step, log)
        self._surface, self._frame, self._base, self._fit = surface, frame, base, fit
        self._params, self._facts, self._run, self._shape = params, facts, run, shape
        self._scalars, self._asset, self._on_wait = scalars, asset, on_wait

    def _steps(self) -> Iterator[dict[str, float]]:
        yield from self._fit

    def checkpoint(self) -> bytes:
        """Return the complete state of the run; call only between two steps."""
        return dump_checkpoint(self._fit.checkpoint(), self._run, self._shape)

    def snapshot(self) -> ArtifactData:
        """Return the field as it is, as a GLB of level 1."""
        level = level_of(self._fit.faces, len(self._fit.verts), min(_SNAPSHOT_LEVEL, self._params.level))
        verts = self._frame.leave(self._fit.positions(level.corners, level.weights))
        return ArtifactData(level_glb(verts, level.faces), _GLB)

    def finish(self) -> dict[str, ArtifactData]:
        """Return the container, the levels, the intrinsic triangulation, the report and the picture."""
        with self.log.phase("unfold"):
            provenance = {"source": self._facts["sha256"], "seed": self._params.seed, "steps": self.step}
            write = partial(
                write_field,
                self._base,
                self._fit.field,
                centre=self._frame.centre,
                scale=self._frame.scale,
                provenance=provenance,
                rounding=self._fit.rounding,
            )
            data = write()
            # Read back, so that everything else describes what is in the file.
            field = read_field(data)
        fields: list[ScalarField] = []
        learned: list[dict[str, Any]] = []
        if self._scalars is not None:
            with self.log.phase("scalars"):
                fields, learned = learned_scalars(field, self._scalars, seed=self._params.seed, on_step=self._on_wait)
        with self.log.phase("colours"):
            colours = FieldColours.of(self._asset, field) if self._asset is not None else None
            if colours is not None:
                colour, off = colours.learned(self._params.seed, self._on_wait)
                fields = [*fields, colour]
                self._facts["warnings"].append(_SAID_OF_COLOURS.format(off=off, level=self._params.level))
        if fields:
            data = write(scalars=fields)
            field = read_field(data)
        with self.log.phase("unfold"):
            artifacts = {"surface.ndf": ArtifactData(data, _BYTES)}
            levels: list[dict[str, Any]] = []
            meshes = []
            for k in range(self._params.level + 1):
                begin = time.perf_counter()
                verts, faces = field.unfold(k)
                seconds = time.perf_counter() - begin
                artifacts[f"level_{k}.glb"] = ArtifactData(level_glb(verts, faces, colours_at(field, k)), _GLB)
                levels.append({"level": k, "faces": len(faces), "vertices": len(verts), "unfold_s": seconds})
                meshes.append((verts, faces))
            mesh = delaunay(verts, faces)
            artifacts["intrinsic.npz"] = ArtifactData(intrinsic_npz(mesh, verts), _BYTES)
            if colours is not None:
                artifacts[f"level_{self._params.level}.glb"] = ArtifactData(colours.glb(self._params.level), _GLB)
        with self.log.phase("measure"):
            for level, (points, triangles) in zip(levels, meshes, strict=True):
                level["distance"] = distances(self._surface, points, triangles)
            compared = Reference(self._surface).compare(mesh, verts)
        self._facts["warnings"] += _warnings(levels[-1], self._surface.reference.cleaned)
        if self._surface.kind == "mesh":
            self._facts["warnings"] += _said_of_size(len(self._surface.reference.faces), len(data))
        with self.log.phase("draw"):
            artifacts["preview.png"] = ArtifactData(self._picture(artifacts, coloured=colours is not None), "image/png")
        report = self._report(data, levels, mesh, {"scalars": learned, **compared})
        artifacts["report.json"] = ArtifactData(json.dumps(report, indent=2).encode(), "application/json")
        return artifacts

    def _picture(self, artifacts: dict[str, ArtifactData], *, coloured: bool) -> bytes:
        mesh = self._surface.reference
        ours = artifacts[f"level_{self._params.level}.glb"].data
        if coloured and self._asset is not None:
            return comparison_png({"input": self._asset.to_bytes(), "field": ours})
        # Divided, or the smooth normals of a coarse mesh would hide its edges, which the field has.
        return comparison_png({"input": level_glb(*divided(mesh.verts, mesh.faces, _DRAWN_FACES)), "field": ours})

    def _report(
        self, data: bytes, levels: list[dict[str, Any]], mesh: IntrinsicMesh, compared: dict[str, Any]
    ) -> dict[str, Any]:
        reference = self._surface.reference
        return {
            "kind": "surface_fit",
            "fingerprint": self._run,
            "result": {"bytes": len(data), "sha256": sha256_hex(data)},
            "input": {
                **self._facts,
                "described_by": self._surface.kind,
                "faces": len(reference.faces),
                "components": reference.topology.components,
                "border_edges": reference.topology.border_edges,
                "genus": reference.topology.genus,
                "cleaned": reference.cleaned,
            },
            "params": self._params.model_dump(mode="json"),
            "steps": self.step,
            "resumed_from": self.first_step or None,
            "base": {
                "faces": len(self._base.faces),
                "vertices": len(self._base.verts),
                "genus": topology(self._base.faces, glue(self._base.verts, self._base.faces)).genus,
            },
            "levels": levels,
            "intrinsic": {"flips": mesh.flips, "all_delaunay": mesh.certified, "least_cotangent_sum": mesh.least},
            **compared,
            "losses": self.log.losses(),
            "seconds": {name: round(value, 3) for name, value in self.log.seconds.items()},
            "versions": versions(),
        }
