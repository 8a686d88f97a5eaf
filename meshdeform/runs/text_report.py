"""Build the report of a `text_deform` run; its statements about the result are measured on the file, read back."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

import meshdeform
from meshdeform.assets import Asset, load_asset
from meshdeform.assets.limits import Limits
from meshdeform.assets.notices import up_axis_warnings
from meshdeform.assets.parts import Rig
from meshdeform.assets.subdivide import Subdivision
from meshdeform.deformation.checkpoint import fingerprint
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.rigid_bodies import Body
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.procrustes import closest_motion
from meshdeform.geometry.quality import MeshQuality, measure, measure_texture_stretch, texel_corners
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.priors.public_names import public_name
from meshdeform.requests.choices import AppearanceMode, Rigidity, RigMode
from meshdeform.requests.document import GuidanceKind, JobRequest, ResolvedParams
from meshdeform.runs.movement import HoldCounter, measure_movement
from meshdeform.runs.precision import precision_warnings
from meshdeform.runs.preparation import subdivision_warnings
from meshdeform.runs.recognition import Recognition
from meshdeform.runs.report import LossHistory, PhaseClock, sha256_hex, versions
from meshdeform.runs.shown import Shown
from meshdeform.runs.verdict import kept_structure, verdict

__all__ = [
    "RunFacts",
    "appearance_report",
    "build_report",
    "provenance",
    "read_result",
    "rig_warnings",
    "sees_colours",
]


@dataclass(frozen=True)
class RunFacts:
    """Facts about a run that are known before its first step."""

    request: JobRequest
    params: ResolvedParams
    asset_sha256: str
    asset_bytes: int
    filename: str
    guidance: dict[str, str]
    fingerprint: str
    device: str
    precision: str | None = None
    shape_id: str = ""
    subdivision: Subdivision | None = None
    recognised: Recognition | None = None


def provenance(facts: RunFacts, step: int) -> dict[str, Any]:
    """Return what `output.provenance` stores in a file with the shape of a step."""
    return {
        "version": meshdeform.__version__,
        "prompt": facts.request.prompt,
        **({"prompts": _weighted(facts.params)} if facts.params.prompts else {}),
        "seed": facts.params.seed,
        "preset": facts.params.preset.value,
        "step": step,
        "parameters_sha256": fingerprint(**facts.params.model_dump(mode="json")),
        "source_sha256": facts.asset_sha256,
    }


def _weighted(params: ResolvedParams) -> list[dict[str, Any]]:
    return [{"prompt": each.prompt, "weight": each.weight} for each in params.prompts]


def build_report(
    facts: RunFacts,
    *,
    asset: Asset,
    welded: WeldedMesh,
    verts: Tensor,
    deformation: Deformation,
    appearance: dict[str, Any],
    result: bytes,
    written: Asset,
    shown: Shown,
    history: LossHistory,
    holds: HoldCounter,
    rebuilt_normals: int,
    first_step: int,
    clock: PhaseClock,
    look: Appearance,
    drawn: NDArray[np.bool_],
    likeness: dict[str, Any] | None = None,
    fit: dict[str, Any] | None = None,
    silhouettes: Sequence[Mapping[str, Any]] | None = None,
    prompts: Sequence[Mapping[str, Any]] | None = None,
    bodies: Sequence[Body] = (),
    control: Mapping[str, Any] | None = None,
) -> bytes:
    """Return `report.json`.

    Parameters
    ----------
    facts : RunFacts
    asset : Asset
        The source.
    welded : WeldedMesh
    verts : (V, 3) float64
        Deformed welded world positions.
    deformation : Deformation
        After its last step.
    appearance : dict
        What the model saw of the asset's colours.
    result : bytes
        `result.glb`.
    written : Asset
        `result.glb`, read back, so that errors of the writer show.
    shown : Shown
        What viewers show of both.
    history : LossHistory
    holds : HoldCounter
    rebuilt_normals : int
        Normals that were replaced, since they would have pointed behind a face. The report adds those that the file
        had without a direction.
    first_step : int
        Number of steps done by earlier attempts.
    clock : PhaseClock
    look : Appearance
        Of the triangles that were drawn: what `preview.png` shows.
    drawn : (T,) bool
        Which triangles of the asset were drawn and deformed.
    likeness : dict, optional
        How much the result looks like its prompt, and the source (`before`).
    fit : dict, optional
        How well the result fits its target.
    silhouettes : sequence of mappings, optional
        How well the result fits each picture.
    prompts : sequence of mappings, optional
        Each of several prompts with what it pulled at (`prompts.prompt_reports`).
    bodies : sequence of Body
        What kept its shape.
    control : mapping, optional
        Members about regions, handles, symmetry and lengths (`control_report`).
    """
    with clock.phase("measure"):
        faces = welded.mesh.faces.numpy()
        quality = measure(welded.mesh.verts.numpy(), faces, verts.numpy())
        posed = measure(shown.source.verts.numpy(), faces, shown.result.verts.numpy()) if shown.posed else None
        invariants = _invariants(asset, written)
        movement = measure_movement(RestMesh.of(welded.mesh), verts, holds)
        triangles = asset.surface.triangles[drawn]
        corners = (shape.surface.positions[triangles] for shape in (asset, written))
        stretch = measure_texture_stretch(texel_corners(look), *corners)
        conclusion = None
        if likeness is not None and prompts is None:  # of several, none alone is what the result should be
            structure = kept_structure(shown.source, shown.result, (posed or quality).to_dict())
            conclusion = verdict(facts.request.prompt, likeness, structure)
    up_axis = up_axis_warnings(asset.surface.positions, triangles)
    losses = history.to_list()
    report: dict[str, Any] = {
        "kind": facts.request.kind.value,
        "prompt": facts.request.prompt,
        # Clients read the report: a model in a folder is named as the service names it.
        "params": facts.params.model_dump(mode="json") | {"model": public_name(facts.params.model)},
        "seed": facts.params.seed,
        "metadata": facts.request.metadata,
        "input": {
            "filename": facts.filename,
            "bytes": facts.asset_bytes,
            "sha256": facts.asset_sha256,
            "warnings": list(asset.summary.warnings),
        },
        "guidance": facts.guidance | {"id": public_name(facts.guidance["id"])},
        "fingerprint": facts.fingerprint,
        "device": facts.device,
        "precision": facts.precision,
        "versions": versions(),
        "result": {"bytes": len(result), "sha256": sha256_hex(result)},
        "mesh": {
            "source_vertices": len(asset.surface.positions),
            "source_triangles": len(asset.surface.triangles),
            "welded_vertices": welded.mesh.verts.shape[0],
            "welded_faces": welded.mesh.faces.shape[0],
            "optimized_faces": deformation.optimized_faces,
            "rebuilt_normals": rebuilt_normals + asset.repairs.normals,
            "rebuilt_tangents": asset.repairs.tangents,
            **invariants,
        },
        "quality": quality.to_dict(),
        "texture_stretch": None if stretch is None else stretch.to_dict(),
        "carrier": deformation.carrier,
        "source_noun": None if facts.recognised is None else facts.recognised.to_dict(),
        "orientation": deformation.orientation.to_dict(),
        "appearance": appearance,
        "movement": movement.to_dict(),
        "pulls": deformation.pulls.to_dict(),
        "warnings": [
            *movement.warnings,
            *deformation.warnings,
            *deformation.pulls.warnings,
            *_quality_warnings(quality, posed, len(faces)),
            *up_axis,
            *subdivision_warnings(facts.subdivision),
            *rig_warnings(asset.rig(), facts.request.output.rig),
            *precision_warnings(facts.precision),
        ],
        "skipped": {**welded.skipped, "primitives": asset.surface.skipped},
        "losses": losses,
        "resumed_from_step": first_step,
        "seconds": {k: round(v, 4) for k, v in clock.seconds.items()},
    }
    if posed is not None:
        report["posed_quality"] = posed.to_dict()
    if asset.rig():
        report["rig"] = {"mode": facts.request.output.rig.value, **asdict(asset.rig())}
    if bodies:
        report["rigid"] = _kept_shapes(bodies, asset, welded, written)
    if facts.subdivision is not None:
        report["subdivision"] = asdict(facts.subdivision)
    report |= control or {}
    if likeness is not None:
        report["likeness"] = likeness
    if conclusion is not None:
        report["verdict"] = conclusion
    if fit is not None:
        report["fit"] = fit
    if silhouettes is not None:
        report["silhouettes"] = list(silhouettes)
    if prompts is not None:
        report["prompts"] = list(prompts)
    if look.left_out:
        report["preview"] = {"left_out": look.left_out}
    return json.dumps(report, indent=2, allow_nan=False, default=str).encode()


def _quality_warnings(quality: MeshQuality, posed: MeshQuality | None, faces: int) -> list[str]:
    """Return the sentences about damage, for a skin in both poses."""
    if posed is None:
        return quality.warnings(faces)
    sentences = posed.warnings(faces, " in the pose that viewers show") + quality.warnings(faces, " in the bind pose")
    return list(dict.fromkeys(sentences))


def _kept_shapes(bodies: Sequence[Body], source: Asset, welded: WeldedMesh, result: Asset) -> dict[str, Any]:
    """Return how exactly the bodies kept their shape in the file, as a share of the source's diagonal."""
    before, after = source.surface.positions, result.surface.positions
    diagonal = float(np.linalg.norm(np.ptp(welded.mesh.verts.numpy(), axis=0)))
    owner = np.full(len(welded.mesh.verts) + 1, -1)  # the last one is for unused source vertices
    for number, body in enumerate(bodies):
        owner[body.verts] = number
    rows = np.flatnonzero(owner[welded.vertex_map] >= 0)
    rows = rows[np.argsort(owner[welded.vertex_map[rows]], kind="stable")]
    sizes = np.bincount(owner[welded.vertex_map[rows]], minlength=len(bodies))
    worst = max(
        closest_motion(before[chosen], after[chosen], scaled=body.mode is Rigidity.SIMILARITY).max_distance
        for body, chosen in zip(bodies, np.split(rows, np.cumsum(sizes)[:-1]), strict=True)
    )
    return {
        "bodies": len(bodies),
        "vertices": sum(len(body.verts) for body in bodies),
        "max_deviation": worst / diagonal,
    }


def read_result(result: bytes) -> Asset:
    """Read our own `result.glb` back, without the limits for sources."""
    return load_asset(result, "result.glb", Limits.unlimited())


def _invariants(source: Asset, result: Asset) -> dict[str, bool]:
    old, new = source.surface, result.surface
    return {
        "same_vertex_count": len(old.positions) == len(new.positions),
        "same_faces": bool(np.array_equal(old.triangles, new.triangles)),
        "same_uvs": source.texture_coordinates() == result.texture_coordinates(),
    }


def rig_warnings(rig: Rig, mode: RigMode) -> list[str]:
    """Return a sentence about morph targets and joints that did not follow the shape, if there are any."""
    if mode is RigMode.FOLLOW or not rig:
        return []
    counted = [(rig.joints, "joint"), (rig.morph_targets, "morph target")]
    what = " and ".join(f"{count} {name}{'s' if count > 1 else ''}" for count, name in counted if count)
    return [
        f"The asset has {what}, which stayed as they were: output.rig is keep. "
        "Set it to follow, so that the result animates as the source does."
    ]


_NO_COLOURS = "The asset has no colours, so the model saw it as clay."
_COLOURED = (AppearanceMode.TEXTURED, AppearanceMode.MIXED)


def sees_colours(params: ResolvedParams) -> bool:
    """Return whether the guidance is to see the asset's colours."""
    return params.guidance is GuidanceKind.SDS and params.appearance in _COLOURED


def appearance_report(params: ResolvedParams, deformation: Deformation) -> dict[str, Any]:
    """Return the report's `appearance`: what was `drawn`, where the `colours` come from, and a `notice`.

    `colours` is `asset`; `stand_in` if a simplified mesh was drawn with vertex colours sampled from the asset; or None.
    """
    wanted = sees_colours(params)
    coloured = wanted and deformation.shading != "lambert"
    return {
        "drawn": (AppearanceMode.CLAY if wanted and not coloured else params.appearance).value,
        "colours": ("stand_in" if deformation.simplified else "asset") if coloured else None,
        "notice": _NO_COLOURS if wanted and not coloured else "",
    }
